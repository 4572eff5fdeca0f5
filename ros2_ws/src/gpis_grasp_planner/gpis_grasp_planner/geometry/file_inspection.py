"""Judge the bytes of a mesh file before any parser does: whole or not, and how large.

Mesh libraries load a truncated STL, a lying face count or an OBJ face index of 0 without an
error, so "it loaded" proves nothing. Each inspector here reads as much of its format as it
takes to tell how many triangles a whole file would give, and refuses the file if it holds
something else. Faces are counted from 1 in messages, as OBJ does.
"""

from __future__ import annotations

from collections.abc import Callable

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.inspection_checks import (
    Inspection,
    check_face_count,
    check_finite,
    check_polygon,
    to_integer,
    truncated,
)
from gpis_grasp_planner.geometry.ply_inspection import inspect_ply

STL_HEADER_BYTES = 84
STL_FACE_BYTES = 50


def inspect(data: bytes, suffix: str, name: str, max_faces: int) -> Inspection:
    """Judge the bytes of a mesh file by its format.

    Parameters
    ----------
    data : bytes
        The whole file.
    suffix : str
        Its lower-case ending with the dot; one of :data:`INSPECTORS`.
    name : str
        What messages call the file.
    max_faces : int
        More declared faces are refused before anything is parsed.

    Raises
    ------
    MeshError
        With the code of the defect.
    """
    return INSPECTORS[suffix](data, name, max_faces)


def inspect_stl(data: bytes, name: str, max_faces: int) -> Inspection:
    """Binary by length and count, ASCII by its facets and its ending."""
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[:1024]:
        return _inspect_ascii_stl(data, name, max_faces)
    if len(data) < STL_HEADER_BYTES:
        raise truncated(name, f"{len(data)} bytes, an STL header alone has {STL_HEADER_BYTES}")
    count = int.from_bytes(data[80:84], "little")
    check_face_count(count, name, max_faces)
    expected = STL_HEADER_BYTES + STL_FACE_BYTES * count
    if len(data) != expected:
        what = "is truncated" if len(data) < expected else "has bytes after its last face"
        raise MeshError(
            f"{name} {what}: its header promises {count} faces ({expected} bytes), the file "
            f"has {len(data)} bytes. Export or copy it again."
        )
    return Inspection(count)


def _inspect_ascii_stl(data: bytes, name: str, max_faces: int) -> Inspection:
    words = data.lower().split()
    facets, ends = words.count(b"facet"), words.count(b"endfacet")
    if b"endsolid" not in words:
        raise truncated(name, f"{facets} facets, but no 'endsolid' at the end")
    check_face_count(ends, name, max_faces)
    vertices = words.count(b"vertex")
    if facets != ends or vertices != 3 * facets:
        raise truncated(
            name, f"{facets} 'facet', {ends} 'endfacet' and {vertices} 'vertex' do not match"
        )
    return Inspection(facets)


def inspect_obj(data: bytes, name: str, max_faces: int) -> Inspection:
    """Count and check every vertex and every face index (negative ones count backwards)."""
    vertices = faces = triangles = 0
    last_index = 0
    last_face = (0, 0)
    for line_number, line in _obj_lines(data):
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            vertices += 1
            if len(words) < 4:
                raise truncated(name, f"vertex {vertices} (line {line_number}) has no 3 numbers")
            check_finite(words[1:4], name, f"vertex {vertices} (line {line_number})")
        elif words[0] == b"f":
            faces += 1
            where = f"face {faces} (line {line_number})"
            if len(words) < 4:
                raise truncated(name, f"{where} has {len(words) - 1} corners, it takes 3")
            for word in words[1:]:
                index = to_integer(word.split(b"/")[0], name, where)
                if index == 0 or index < -vertices:
                    raise MeshError(
                        f"{name}: {where} uses vertex index {index}; OBJ indices start at 1, or at "
                        f"-1 counting back over the {vertices} vertices so far. Export it again.",
                        ErrorCode.MESH_BAD_INDEX,
                    )
                if index > last_index:
                    last_index, last_face = index, (faces, line_number)
            triangles += len(words) - 3
    if last_index > vertices:
        raise MeshError(
            f"{name}: face {last_face[0]} (line {last_face[1]}) uses vertex index {last_index}, "
            f"the file has {vertices} vertices. It may be truncated; export it again.",
            ErrorCode.MESH_BAD_INDEX,
        )
    check_face_count(triangles, name, max_faces)
    return Inspection(triangles, data.endswith((b"\n", b"\r")))


def _obj_lines(data: bytes) -> list[tuple[int, bytes]]:
    lines = []
    pending = b""
    for number, line in enumerate(data.splitlines(), start=1):
        if line.rstrip().endswith(b"\\"):
            pending += line.rstrip()[:-1] + b" "
            continue
        lines.append((number, (pending + line).split(b"#")[0]))
        pending = b""
    return lines


def inspect_off(data: bytes, name: str, max_faces: int) -> Inspection:
    """Compare the counts at the head of an OFF file with the lines that follow."""
    lines = [s for s in (line.split(b"#")[0].split() for line in data.splitlines()) if s]
    if not lines or lines[0][0].upper() != b"OFF":
        raise MeshError(
            f"{name} does not start with 'OFF' (variants such as COFF or NOFF are not "
            "supported). Export plain OFF, or STL, OBJ or PLY.",
            ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
        )
    head = lines.pop(0)[1:] or (lines.pop(0) if lines else [])
    if len(head) < 2:
        raise truncated(name, "the line of counts after 'OFF' is missing")
    vertices = to_integer(head[0], name, "the vertex count")
    faces = to_integer(head[1], name, "the face count")
    check_face_count(faces, name, max_faces)
    if vertices < 0 or len(lines) != vertices + faces:
        raise truncated(
            name,
            f"its head promises {vertices} vertices and {faces} faces, {len(lines)} lines follow",
        )
    for i, words in enumerate(lines[:vertices], start=1):
        if len(words) < 3:
            raise truncated(name, f"vertex {i} has {len(words)} numbers")
        check_finite(words[:3], name, f"vertex {i}")
    triangles = 0
    for i, words in enumerate(lines[vertices:], start=1):
        triangles += check_polygon(words, i, vertices, name)
    return Inspection(triangles, data.endswith((b"\n", b"\r")))


def inspect_step(data: bytes, name: str, _max_faces: int) -> Inspection:
    """STEP has no count of faces; its frame at least must be whole."""
    if not data.lstrip().startswith(b"ISO-10303-21;"):
        raise MeshError(f"{name} does not start with 'ISO-10303-21;': not a STEP file.")
    if b"END-ISO-10303-21;" not in data[-2048:]:
        raise truncated(name, "'END-ISO-10303-21;' is missing at its end")
    return Inspection(None)


INSPECTORS: dict[str, Callable[[bytes, str, int], Inspection]] = {
    ".stl": inspect_stl,
    ".obj": inspect_obj,
    ".ply": inspect_ply,
    ".off": inspect_off,
    ".step": inspect_step,
    ".stp": inspect_step,
}
