"""STEP files made by hand: solids, surfaces, curves, assemblies, units."""

from __future__ import annotations

import numpy as np
from mesh_dialects import Solid

HEAD = (
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
    "FILE_NAME('part','2024-01-01T00:00:00',(''),(''),'','','');\n"
    "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
)
TAIL = "ENDSEC;\nEND-ISO-10303-21;\n"
MILLIMETRE = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))"


class StepText:
    """Entities, numbered as they are added, and the frame around them."""

    def __init__(self, inches: bool = False):
        self.lines: list[str] = []
        length = self.add(MILLIMETRE)
        if inches:
            size = self.add(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),{length})")
            exponents = self.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
            length = self.add(
                f"(CONVERSION_BASED_UNIT('INCH',{size})LENGTH_UNIT()NAMED_UNIT({exponents}))"
            )
        angle = self.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
        space = self.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
        fuzz = self.add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-05),{length},'','')")
        self.context = self.add(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3)"
            f"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({fuzz}))"
            f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{space}))"
            "REPRESENTATION_CONTEXT('',''))"
        )
        self.application = self.add("APPLICATION_CONTEXT('automotive design')")

    def add(self, text: str) -> str:
        self.lines.append(f"#{len(self.lines) + 1}={text};")
        return f"#{len(self.lines)}"

    def triple(self, kind: str, v) -> str:
        return self.add(f"{kind}('',({float(v[0])},{float(v[1])},{float(v[2])}))")

    def axes(self, origin=(0, 0, 0), z=(0, 0, 1), x=(1, 0, 0)) -> str:
        point = self.triple("CARTESIAN_POINT", origin)
        return self.add(
            f"AXIS2_PLACEMENT_3D('',{point},{self.triple('DIRECTION', z)},"
            f"{self.triple('DIRECTION', x)})"
        )

    def faces(self, solid: Solid) -> list[str]:
        points = [self.triple("CARTESIAN_POINT", v) for v in solid.vertices]
        found = []
        for polygon in solid.polygons:
            a, b, c = (solid.vertices[i] for i in polygon[:3])
            normal = np.cross(b - a, c - b)
            along = (b - a) / np.linalg.norm(b - a)
            plane = self.add(f"PLANE('',{self.axes(a, normal / np.linalg.norm(normal), along)})")
            loop = self.add(f"POLY_LOOP('',({','.join(points[i] for i in polygon)}))")
            bound = self.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
            found.append(self.add(f"FACE_SURFACE('',({bound}),{plane},.T.)"))
        return found

    def brep(self, solid: Solid) -> str:
        shell = self.add(f"CLOSED_SHELL('',({','.join(self.faces(solid))}))")
        return self.add(f"FACETED_BREP('',{shell})")

    def product(self, name: str, items: list[str], kind: str) -> tuple[str, str]:
        """A product with a representation of items; its definition and the representation."""
        shape = self.add(f"{kind}('',({','.join(items)}),{self.context})")
        mechanical = self.add(f"PRODUCT_CONTEXT('',{self.application},'mechanical')")
        product = self.add(f"PRODUCT('{name}','{name}','',({mechanical}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        design = self.add(
            f"PRODUCT_DEFINITION_CONTEXT('part definition',{self.application},'design')"
        )
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{design})")
        owner = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION({owner},{shape})")
        return definition, shape

    def text(self) -> bytes:
        return (HEAD + "\n".join(self.lines) + "\n" + TAIL).encode()


def part(*solids: Solid, name: str = "part", inches: bool = False) -> bytes:
    step = StepText(inches)
    items = [step.axes(), *(step.brep(s) for s in solids)]
    step.product(name, items, "FACETED_BREP_SHAPE_REPRESENTATION")
    return step.text()


def mapped_copy(
    solid: Solid, scale: float | None, axes: np.ndarray, in_parts: bool = False
) -> bytes:
    """A solid, and a copy of it by an operator with axes (3, 3) as rows, 100 mm along x."""
    step = StepText()
    origin = step.axes()
    items = f"({origin},{step.brep(solid)})"
    source = step.add(f"FACETED_BREP_SHAPE_REPRESENTATION('',{items},{step.context})")
    mapping = step.add(f"REPRESENTATION_MAP({origin},{source})")
    first, second, third = (step.triple("DIRECTION", axis) for axis in axes)
    point = step.triple("CARTESIAN_POINT", (100, 0, 0))
    size = "$" if scale is None else repr(scale)
    if in_parts:
        target = step.add(
            f"(CARTESIAN_TRANSFORMATION_OPERATOR({first},{second},{point},{size})"
            f"CARTESIAN_TRANSFORMATION_OPERATOR_3D({third})"
            "FUNCTIONALLY_DEFINED_TRANSFORMATION('','')GEOMETRIC_REPRESENTATION_ITEM()"
            "REPRESENTATION_ITEM(''))"
        )
    else:
        target = step.add(
            f"CARTESIAN_TRANSFORMATION_OPERATOR_3D('','',$,{first},{second},{point},{size},{third})"
        )
    copies = [step.add(f"MAPPED_ITEM('',{mapping},{where})") for where in (origin, target)]
    step.product("whole", [step.axes(), *copies], "SHAPE_REPRESENTATION")
    return step.text()


def assembly(placed: list[tuple[str, Solid, tuple[float, float, float]]]) -> bytes:
    """Named parts at positions; parts of one name are one product, placed several times."""
    step = StepText()
    products: dict[str, tuple[str, str, str]] = {}
    for name, solid, _ in placed:
        if name not in products:
            origin = step.axes()
            items = [origin, step.brep(solid)]
            kind = "FACETED_BREP_SHAPE_REPRESENTATION"
            products[name] = (*step.product(name, items, kind), origin)
    targets = [step.axes(position) for _, _, position in placed]
    root, root_shape = step.product("whole", [step.axes(), *targets], "SHAPE_REPRESENTATION")
    for number, ((name, _, _), target) in enumerate(zip(placed, targets, strict=True)):
        definition, shape, origin = products[name]
        usage = step.add(
            f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{number}','{name}','',{root},{definition},$)"
        )
        owner = step.add(f"PRODUCT_DEFINITION_SHAPE('','',{usage})")
        move = step.add(f"ITEM_DEFINED_TRANSFORMATION('','',{origin},{target})")
        relation = step.add(
            f"(REPRESENTATION_RELATIONSHIP('','',{shape},{root_shape})"
            f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION({move})"
            "SHAPE_REPRESENTATION_RELATIONSHIP())"
        )
        step.add(f"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION({relation},{owner})")
    return step.text()


def surfaces(solid: Solid, faces: int | None = None) -> bytes:
    """A surface model of the first faces, without a solid."""
    step = StepText()
    shown = Solid(solid.vertices, solid.polygons[:faces], 0.0)
    shell = step.add(f"OPEN_SHELL('',({','.join(step.faces(shown))}))")
    model = step.add(f"SHELL_BASED_SURFACE_MODEL('',({shell}))")
    step.product("sheet", [step.axes(), model], "MANIFOLD_SURFACE_SHAPE_REPRESENTATION")
    return step.text()


def curves() -> bytes:
    step = StepText()
    points = [step.triple("CARTESIAN_POINT", p) for p in ((0, 0, 0), (50, 0, 0), (0, 50, 0))]
    line = step.add(f"POLYLINE('',({','.join(points)}))")
    curve_set = step.add(f"GEOMETRIC_CURVE_SET('',({line}))")
    step.product("wire", [step.axes(), curve_set], "SHAPE_REPRESENTATION")
    return step.text()
