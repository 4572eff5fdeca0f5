"""What the text of a STEP file promises: solids, shells and faces, for the shape to be held to.

OpenCASCADE drops what it cannot read and goes on, so that a damaged file comes out as another
shape. The text says how many faces its shells have.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.formats.parsed_mesh import truncated
from gpis_grasp_planner.geometry.formats.recognise import BYTE_ORDER_MARK, refuse_foreign
from gpis_grasp_planner.geometry.formats.step_copies import refuse_changed_copies

_START = re.compile(rb"(?:\s|/\*.*?\*/)*(ISO-10303-21\s*;)", re.DOTALL)
_END = b"END-ISO-10303-21"
_COMMENT = re.compile(rb"/\*.*?\*/", re.DOTALL)
_SOLIDS = rb"MANIFOLD_SOLID_BREP|BREP_WITH_VOIDS|FACETED_BREP|SOLID_BREP"
# Behind a semicolon, wherever strings start and end: one lost quote must not hide the rest.
_ENTITY = re.compile(
    rb";\s*#(\d+)\s*=\s*(" + _SOLIDS + rb"|CLOSED_SHELL|OPEN_SHELL|ADVANCED_FACE|FACE_SURFACE|"
    rb"SHELL_BASED_SURFACE_MODEL|NEXT_ASSEMBLY_USAGE_OCCURRENCE|GEOMETRIC_CURVE_SET|"
    rb"TESSELLATED_SOLID|TESSELLATED_SHELL)\s*\(((?:[^;']|'(?:[^';]|'')*')*)"
)
_MOST_BEFORE = 100_000
_MOST_DEPTH = 64
_STRING = re.compile(rb"'[^']*'")
_REFERENCE = re.compile(rb"#(\d+)")


@dataclass(frozen=True)
class StepPromise:
    """What a STEP text declares.

    Attributes
    ----------
    body : bytes
        From its first word to its last, for the reader.
    solids, faces, parts : int
        Solids; faces of shells, or defined anywhere; placed parts of assemblies, at least 1.
    closed_faces : int
        Faces of the closed shells.
    smallest_shell : int
        Faces of the closed shell that has the fewest.
    missing_shells : int
        Shells that solids name and that are not there.
    has_voids : bool
    surfaces, curves : bool
        Whether there are surface models, and sets of curves (wireframes).
    after_the_end : int
        Bytes after the end mark that are no blanks.
    """

    body: bytes
    solids: int
    faces: int
    parts: int
    closed_faces: int
    smallest_shell: int
    missing_shells: int
    has_voids: bool
    surfaces: bool
    curves: bool
    after_the_end: int


def read_promise(data: bytes, name: str) -> StepPromise:
    """Check that a STEP text is whole and can be read as it is meant, and count what it declares.

    About 0.1 s for 10 MB.
    """
    text = data.removeprefix(BYTE_ORDER_MARK)
    start = _START.match(text[:_MOST_BEFORE])
    if start is None:
        refuse_foreign(data, name, "STEP")
        raise MeshError(
            f"{name} does not start with 'ISO-10303-21;': not a STEP file, or a damaged one."
        )
    end = text.rfind(_END)
    stop = text.find(b";", end)
    if end < 0 or stop < 0:
        raise truncated(name, "'END-ISO-10303-21;' is missing at its end")
    body = text[start.start(1) : stop + 1]
    plain = _COMMENT.sub(b"", body)
    refuse_changed_copies(plain, name)
    kinds: dict[bytes, list[tuple[int, list[int]]]] = {}
    for number, kind, rest in _ENTITY.findall(plain):
        references = [int(r) for r in _REFERENCE.findall(_STRING.sub(b"", rest))]
        kinds.setdefault(kind, []).append((int(number), references))
    closed = dict(kinds.get(b"CLOSED_SHELL", []))
    shells = closed | dict(kinds.get(b"OPEN_SHELL", []))
    faces = {n for kind in (b"ADVANCED_FACE", b"FACE_SURFACE") for n, _ in kinds.get(kind, [])}
    faces |= {f for references in shells.values() for f in references}
    solids = [s for kind in _SOLIDS.split(b"|") for s in kinds.get(kind, [])]
    # Voids are named by oriented shells, which are not looked up here.
    outer = [references[0] for _, references in solids if references]
    return StepPromise(
        body=body + b"\n",
        solids=len(solids) + len(kinds.get(b"TESSELLATED_SOLID", [])),
        faces=len(faces),
        parts=_placed_parts(kinds.get(b"NEXT_ASSEMBLY_USAGE_OCCURRENCE", [])),
        closed_faces=len({f for references in closed.values() for f in references}),
        smallest_shell=min((len(f) for f in closed.values()), default=0),
        missing_shells=sum(1 for shell in outer if shell not in shells),
        has_voids=b"BREP_WITH_VOIDS" in kinds,
        surfaces=b"SHELL_BASED_SURFACE_MODEL" in kinds,
        curves=b"GEOMETRIC_CURVE_SET" in kinds,
        after_the_end=len(b"".join(text[stop + 1 :].split())),
    )


def _placed_parts(usages: list[tuple[int, list[int]]]) -> int:
    """Leaves of the tree of assemblies; each usage names an assembly and what it places there."""
    placed: dict[int, list[int]] = {}
    for _, references in usages:
        if len(references) >= 2:
            placed.setdefault(references[0], []).append(references[1])
    known: dict[int, int] = {}

    def leaves(product: int, depth: int) -> int:
        if product not in placed or depth > _MOST_DEPTH:
            return 1
        if product not in known:
            known[product] = sum(leaves(p, depth + 1) for p in placed[product])
        return known[product]

    children = {c for products in placed.values() for c in products}
    return max(1, sum(leaves(p, 0) for p in placed if p not in children))
