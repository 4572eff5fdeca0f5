"""PLY, ASCII and binary of either order: a header of elements, and what it describes."""

from __future__ import annotations

import re

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.formats.parsed_cloud import (
    ParsedCloud,
    check_point_count,
    check_points,
    own_normals,
)
from gpis_grasp_planner.geometry.formats.parsed_mesh import (
    Index,
    ParsedMesh,
    bad_index,
    check_face_count,
    truncated,
)
from gpis_grasp_planner.geometry.formats.ply_elements import (
    PLY_TYPES,
    Element,
    Property,
    Table,
    read_ascii,
    read_binary,
)
from gpis_grasp_planner.geometry.formats.polygons import triangulate
from gpis_grasp_planner.geometry.formats.recognise import BYTE_ORDER_MARK, refuse_foreign

_CORNER_LISTS = ("vertex_indices", "vertex_index")
_END_HEADER = re.compile(rb"[\r\n][ \t]*(end_header)[ \t]*(?=[\r\n])")
_MOST_HEADER_BYTES = 1_000_000
_RESTART = -1
_NORMALS = ("nx", "ny", "nz")
_VIEW = ("view_px", "view_py", "view_pz")  # as the Point Cloud Library writes it


def has_faces(data: bytes, name: str) -> bool:
    """Whether the header of a PLY file declares any face or strip.

    Raises
    ------
    MeshError
        Where the header cannot be read.
    """
    _, elements, _ = _header(data, name)
    return any(e.count for e in elements if e.name in ("face", "tristrips"))


def read_ply_points(data: bytes, name: str, most: int) -> ParsedCloud:
    """Read the vertices of a PLY file as a cloud, with their normals and the camera's place."""
    encoding, elements, start = _header(data, name)
    by_name = {e.name: e for e in elements}
    vertex = by_name.get("vertex")
    missing = [axis for axis in "xyz" if vertex is None or axis not in vertex.scalars]
    if vertex is None or missing:
        raise MeshError(f"{name}: its vertices have no property '{missing[0]}'. Export it again.")
    check_point_count(vertex.count, name, most)
    whole = all(n in vertex.scalars for n in _NORMALS)
    camera = by_name.get("camera")
    placed = camera is not None and camera.count and all(v in camera.scalars for v in _VIEW)
    wanted = {"vertex": ("x", "y", "z", *(_NORMALS if whole else ()))}
    if placed:
        wanted["camera"] = _VIEW
    if encoding == "ascii":
        tables, extra, _ = read_ascii(data, start, elements, wanted, name)
    else:
        order = "<" if encoding == "binary_little_endian" else ">"
        tables, extra, _ = read_binary(data, start, elements, wanted, order, name)
    values = tables["vertex"].scalars
    check_points(values[:, :3], name)
    viewpoints = tables["camera"].scalars if placed else np.zeros((0, 3))
    return ParsedCloud(
        np.ascontiguousarray(values[:, :3]),
        own_normals(values[:, 3:6]) if whole else None,
        viewpoints,
        (f"{extra} after what the header describes were ignored.",) if extra else (),
    )


def read_ply(data: bytes, name: str, max_faces: int) -> ParsedMesh:
    """Read a PLY file: polygons of the element 'face', strips of the element 'tristrips'."""
    encoding, elements, start = _header(data, name)
    by_name = {e.name: e for e in elements}
    vertex, face, strips = (by_name.get(n) for n in ("vertex", "face", "tristrips"))
    if vertex is None or (face is None and strips is None):
        raise MeshError(
            f"{name} declares no {'vertices' if vertex is None else 'faces'}; a point cloud is "
            "not a mesh. Export triangles.",
            ErrorCode.MESH_EMPTY,
        )
    if not any(e and e.count and e.lists(_CORNER_LISTS) for e in (face, strips)):
        check_face_count(sum(e.count for e in (face, strips) if e), name, max_faces)
        raise MeshError(f"{name}: its faces have no list 'vertex_indices'. Export it again.")
    missing = [axis for axis in "xyz" if axis not in vertex.scalars]
    if missing:
        raise MeshError(f"{name}: its vertices have no property '{missing[0]}'. Export it again.")
    if strips is None or not strips.count:
        check_face_count(face.count if face else 0, name, max_faces)
    wanted = {"vertex": ("x", "y", "z"), "face": _CORNER_LISTS, "tristrips": _CORNER_LISTS}
    if encoding == "ascii":
        tables, extra, doubt = read_ascii(data, start, elements, wanted, name)
    else:
        order = "<" if encoding == "binary_little_endian" else ">"
        tables, extra, doubt = read_binary(data, start, elements, wanted, order, name)
    vertices = tables["vertex"].scalars
    corners, counts = _polygons(tables, len(vertices), name)
    check_face_count(int(counts.sum()) - 2 * len(counts), name, max_faces)
    faces, _, skewed = triangulate(vertices, corners, counts, name)
    notes = (f"{extra} after what the header describes were ignored.",) if extra else ()
    return ParsedMesh(vertices, faces, notes=(*notes, *skewed), doubt=doubt)


def _header(data: bytes, name: str) -> tuple[str, list[Element], int]:
    """The encoding, the elements, and where their data starts."""
    head = data[:_MOST_HEADER_BYTES]
    if head.removeprefix(BYTE_ORDER_MARK).lstrip()[:3].lower() != b"ply":
        refuse_foreign(data, name, "PLY")
        raise MeshError(f"{name} does not start with 'ply': not a PLY file, or a damaged one.")
    end_mark = _END_HEADER.search(head)
    if end_mark is None:
        raise truncated(name, "its header has no 'end_header' on a line of its own")
    end = end_mark.start(1)
    encoding = ""
    elements: list[Element] = []
    for line in head[:end].decode("ascii", "replace").splitlines():
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            encoding = words[1]
        elif words[:1] == ["element"] and len(words) == 3:
            elements.append(Element(words[1], _count(words, name)))
        elif words[:1] == ["property"] and len(words) >= 3 and elements:
            elements[-1].properties.append(_property(words[1:], line, name))
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise MeshError(f"{name} has the unknown PLY format '{encoding[:40]}'.")
    line_end = end_mark.end()
    # '\r\n' is one end of line; but a '\n' after '\r' is data where the header's ends are '\r'.
    two = head[line_end : line_end + 2] == b"\r\n" and b"\n" in head[:end]
    return encoding, elements, line_end + (2 if two else 1)


def _count(words: list[str], name: str) -> int:
    try:
        count = int(words[2])
    except ValueError:
        count = -1
    if count < 0:
        raise MeshError(
            f"{name} declares {words[2][:20]!r} of element {words[1][:20]}; it must be a whole "
            "number. Export it again."
        )
    return count


def _property(words: list[str], line: str, name: str) -> Property:
    types = words[1:3] if words[0] == "list" else words[:1]
    if any(t not in PLY_TYPES for t in types) or len(words) < 1 + len(types):
        raise MeshError(f"{name} has a property of unknown type: '{line.strip()[:60]}'.")
    if words[0] == "list" and PLY_TYPES[types[0]][0] == "f":
        raise MeshError(f"{name} has a list whose length is no integer: '{line.strip()[:60]}'.")
    return Property(
        words[-1], PLY_TYPES[types[-1]], PLY_TYPES[types[0]] if words[0] == "list" else ""
    )


def _polygons(tables: dict[str, Table], n_vertices: int, name: str) -> tuple[Index, Index]:
    corners: list[Index] = []
    counts: list[Index] = []
    faces = tables.get("face")
    if faces is not None and len(faces.counts):
        few = np.flatnonzero(faces.counts < 3)
        if few.size:
            raise truncated(
                name, f"face {few[0] + 1} has {faces.counts[few[0]]} corners, it takes 3"
            )
        wrong = np.flatnonzero((faces.values < 0) | (faces.values >= n_vertices))
        if wrong.size:
            face = int(np.searchsorted(np.cumsum(faces.counts), wrong[0], side="right"))
            raise bad_index(name, face + 1, int(faces.values[wrong[0]]), n_vertices)
        corners.append(faces.values)
        counts.append(faces.counts)
    strips = tables.get("tristrips")
    if strips is not None and len(strips.counts):
        triangles = _strip_triangles(strips)
        wrong = np.flatnonzero((triangles < 0) | (triangles >= n_vertices))
        if wrong.size:
            raise bad_index(
                name, int(wrong[0]) // 3 + 1, int(triangles.reshape(-1)[wrong[0]]), n_vertices
            )
        corners.append(triangles.reshape(-1))
        counts.append(np.full(len(triangles), 3))
    if not corners:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return np.concatenate(corners), np.concatenate(counts)


def _strip_triangles(strips: Table) -> Index:
    """Triangles (t, 3) of strips; -1 starts a new strip, every second triangle is turned."""
    values = np.append(strips.values, _RESTART)
    breaks = np.zeros(len(values), dtype=bool)
    breaks[np.cumsum(strips.counts)] = True  # a list ends before this entry
    starts_anew = breaks | (values == _RESTART)
    # Entries since the strip began, which is behind a restart, or where another list begins.
    number = np.arange(len(values))
    begin = np.where(values == _RESTART, number + 1, np.where(breaks, number, 0))
    rank = number - np.maximum.accumulate(np.where(starts_anew, begin, 0))
    last = np.flatnonzero((rank >= 2) & (values != _RESTART))
    triangles = np.stack([values[last - 2], values[last - 1], values[last]], axis=1)
    odd = (rank[last] % 2).astype(bool)
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]  # joints between strips have no area
