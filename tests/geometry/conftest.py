"""Shapes with known volumes, and writers of mesh files that can be told to lie."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

BOX_QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
BOX_SIZE = np.array([0.06, 0.05, 0.04])


def box_arrays(size=BOX_SIZE, center=(0.0, 0.0, 0.0)):
    """Vertices (8, 3) [m] and faces (12, 3) of a box that faces outwards."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    faces = [f for a, b, c, d in BOX_QUADS for f in ((a, b, c), (a, c, d))]
    return (corners - 0.5) * np.asarray(size) + np.asarray(center), np.array(faces)


def binary_stl(vertices, faces, count=None) -> bytes:
    """A binary STL; `count` is the face count its header claims."""
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *np.asarray(vertices)[list(f)].reshape(-1), 0) for f in faces
    )
    claimed = len(faces) if count is None else count
    return b"made by a test".ljust(80) + struct.pack("<I", claimed) + body


def ascii_stl(vertices, faces) -> bytes:
    lines = ["solid test"]
    for f in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {} {} {}".format(*vertices[i]) for i in f]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid test", ""]).encode()


def obj(vertices, faces) -> bytes:
    lines = ["v {} {} {}".format(*v) for v in vertices]
    lines += ["f " + " ".join(str(i + 1) for i in f) for f in faces]
    return "\n".join([*lines, ""]).encode()


def off(vertices, faces) -> bytes:
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += ["{} {} {}".format(*v) for v in vertices]
    lines += [f"{len(f)} " + " ".join(map(str, f)) for f in faces]
    return "\n".join([*lines, ""]).encode()


def _ply_header(encoding: str, vertices: int, faces: int) -> bytes:
    return (
        f"ply\nformat {encoding} 1.0\nelement vertex {vertices}\nproperty double x\n"
        f"property double y\nproperty double z\nelement face {faces}\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()


def ascii_ply(vertices, faces) -> bytes:
    body = off(vertices, faces).split(b"\n", 2)[2]
    return _ply_header("ascii", len(vertices), len(faces)) + body


def binary_ply(vertices, faces, order="<") -> bytes:
    name = "binary_little_endian" if order == "<" else "binary_big_endian"
    body = b"".join(struct.pack(order + "3d", *v) for v in vertices)
    body += b"".join(struct.pack(f"{order}B{len(f)}i", len(f), *f) for f in faces)
    return _ply_header(name, len(vertices), len(faces)) + body


def step_box(size, unit=".MILLI.") -> bytes:
    """A box as a faceted B-rep; `size` are the file's numbers, `unit` its SI prefix or $."""
    vertices, _ = box_arrays(size)
    lines: list[str] = []

    def add(text: str) -> str:
        lines.append(f"#{len(lines) + 1}={text};")
        return f"#{len(lines)}"

    def triple(kind: str, v) -> str:
        return add(f"{kind}('',({float(v[0])},{float(v[1])},{float(v[2])}))")

    points = [triple("CARTESIAN_POINT", v) for v in vertices]
    faces = ",".join(_step_face(add, triple, vertices, points, quad) for quad in BOX_QUADS)
    shell = add(f"CLOSED_SHELL('',({faces}))")
    brep = add(f"FACETED_BREP('',{shell})")
    length = add(f"(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({unit},.METRE.))")
    angle = add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    fuzz = add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-05),{length},'','')")
    context = add(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3)"
        f"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({fuzz}))"
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle}))REPRESENTATION_CONTEXT('',''))"
    )
    shape = add(f"FACETED_BREP_SHAPE_REPRESENTATION('',({brep}),{context})")
    app = add("APPLICATION_CONTEXT('automotive design')")
    mechanical = add(f"PRODUCT_CONTEXT('',{app},'mechanical')")
    product = add(f"PRODUCT('box','box','',({mechanical}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    design = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{app},'design')")
    definition = add(f"PRODUCT_DEFINITION('design','',{formation},{design})")
    owner = add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    add(f"SHAPE_DEFINITION_REPRESENTATION({owner},{shape})")
    head = (
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
        "FILE_NAME('box','2024-01-01T00:00:00',(''),(''),'','','');\n"
        "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
    )
    return (head + "\n".join(lines) + "\nENDSEC;\nEND-ISO-10303-21;\n").encode()


def _step_face(add, triple, vertices, points, quad) -> str:
    a, b, c = (vertices[i] for i in quad[:3])
    normal = np.cross(b - a, c - b)
    origin = triple("CARTESIAN_POINT", a)
    z_axis = triple("DIRECTION", normal / np.linalg.norm(normal))
    x_axis = triple("DIRECTION", (b - a) / np.linalg.norm(b - a))
    place = add(f"AXIS2_PLACEMENT_3D('',{origin},{z_axis},{x_axis})")
    plane = add(f"PLANE('',{place})")
    corners = ",".join(points[i] for i in quad)
    loop = add(f"POLY_LOOP('',({corners}))")
    bound = add(f"FACE_OUTER_BOUND('',{loop},.T.)")
    return add(f"FACE_SURFACE('',({bound}),{plane},.T.)")


class MeshWriters:
    """The writers above, for tests to use by name."""

    box_size = BOX_SIZE
    box_arrays = staticmethod(box_arrays)
    binary_stl = staticmethod(binary_stl)
    ascii_stl = staticmethod(ascii_stl)
    obj = staticmethod(obj)
    off = staticmethod(off)
    ascii_ply = staticmethod(ascii_ply)
    binary_ply = staticmethod(binary_ply)
    step_box = staticmethod(step_box)


@pytest.fixture(scope="session")
def write() -> type[MeshWriters]:
    """Writers of mesh files."""
    return MeshWriters


@pytest.fixture
def mesh_path(tmp_path: Path) -> Callable[[bytes, str], Path]:
    """Put bytes into a file of a fresh directory and return its path."""

    def put(data: bytes, name: str = "part.stl") -> Path:
        path = tmp_path / name
        path.write_bytes(data)
        return path

    return put
