"""Shapes of a URDF's links as meshes in metres: boxes, cylinders, spheres and mesh files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote, urlparse
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError, RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.mesh_file import READERS
from gpis_grasp_planner.geometry.topology import find_edges
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.hand.link_mesh import MOST_CORNERS, convex_hull, fewest_vertices
from gpis_grasp_planner.hand.urdf_origin import numbers, origin_of

Array = NDArray[np.float64]

# Corners of a cylinder's and a sphere's circles: their faces lie 0.5 and 1.2 per cent inside.
_ROUND, _OF_BALL = 32, 20
_RINGS = 12
_MOST_FACES = 1_000_000
_HULL_TOLERANCE_M = 5e-5
_PRIMITIVES = ("box", "cylinder", "sphere")
_SHAPES = "a box, a cylinder, a sphere or a mesh file (" + ", ".join(READERS) + ")"


def link_shapes(
    path: Path, links: Sequence[ET.Element], kind: str, hulls: bool = False
) -> tuple[tuple[TriangleMesh, ...], ...]:
    """The `collision` or `visual` shapes of links, in the links' frames.

    Collision shapes are taken as convex; with `hulls` their convex hulls are, of 256 corners at
    most.

    Raises
    ------
    RequestError
        For a shape of another kind, or one for collisions that has too many corners.
    MeshError
        For a mesh file that is not there, damaged, or of another format.
    """
    known: dict[bytes, TriangleMesh] = {}
    result = []
    for link in links:
        pieces = []
        for shape in link.findall(kind):
            geometry = shape.find("geometry")
            key = b"" if geometry is None else ET.tostring(geometry)
            if key not in known:
                known[key] = _shape(path, link, kind, geometry)
                if kind == "collision":
                    known[key] = _solid(known[key], hulls, f"link '{link.get('name')}' of '{path}'")
            piece, T_link_piece = known[key], origin_of(shape)
            if not np.array_equal(T_link_piece, np.eye(4)):
                piece = TriangleMesh(apply(T_link_piece, piece.vertices), piece.faces)
            pieces.append(piece)
        result.append(tuple(pieces))
    return tuple(result)


def is_readable(link: ET.Element) -> bool:
    """Whether :func:`link_shapes` knows the kinds of all of a link's visual shapes."""
    for shape in link.findall("visual"):
        mesh = shape.find("geometry/mesh")
        if mesh is None:
            if all(shape.find(f"geometry/{name}") is None for name in _PRIMITIVES):
                return False
        elif Path(mesh.get("filename", "")).suffix.lower() not in READERS:
            return False
    return True


def mesh_path(urdf_path: Path, name: str) -> Path:
    """Where a mesh file is that a URDF names: beside it, by ``file://``, or by ``package://``.

    A package is looked for among the folders above the URDF and beside them, and where
    ``AMENT_PREFIX_PATH`` says.

    Raises
    ------
    MeshError
        If there is no such package.
    """
    uri = urlparse(name)
    if uri.scheme == "file":
        return Path(unquote(uri.path))
    if uri.scheme != "package":
        return urdf_path.parent / name
    inside = unquote(uri.path).lstrip("/")
    above = urdf_path.resolve().parents
    folders = [folder for folder in above if folder.name == uri.netloc]
    folders += [folder / uri.netloc for folder in above]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders += [Path(prefix) / "share" / uri.netloc for prefix in prefixes if prefix]
    for folder in folders:
        if (folder / inside).exists():
            return folder / inside
    raise MeshError(
        f"'{urdf_path}' names the mesh '{name}', which is in no folder above the URDF and in no "
        "package of AMENT_PREFIX_PATH. Source the workspace that has the package, or name the mesh "
        "relative to the URDF.",
        ErrorCode.MESH_UNREADABLE,
    )


def read_link_mesh(path: Path, *, solid: bool = True) -> TriangleMesh:
    """A mesh file in its own numbers, which URDF takes as metres; equal corners are one.

    A file that may have been cut off (many writers of OBJ put no newline at the end) is whole
    where its surface is closed, and an OBJ file, whose faces come last, where they use all of its
    vertices. For one that is only looked at (not `solid`) that is no matter.

    Raises
    ------
    MeshError
        If it is missing, damaged, or of another format.
    """
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise MeshError(
            f"Link mesh '{path}' is not of a known format; give {_SHAPES}.",
            ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(
            f"Cannot read the link mesh '{path}': {error.strerror}. Reinstall the package or "
            "correct the mesh name in the hand's URDF.",
            ErrorCode.MESH_UNREADABLE,
        ) from error
    parsed = READERS[suffix](data, path.name, _MOST_FACES)
    corners = parsed.vertices[parsed.faces.ravel()]
    vertices, merged = np.unique(corners, axis=0, return_inverse=True)
    faces = merged.reshape(-1, 3).astype(np.int32)
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)  # not a line or a point
    mesh = TriangleMesh(vertices, faces[whole])
    all_used = suffix == ".obj" and len(np.unique(parsed.faces)) == len(parsed.vertices)
    if solid and parsed.doubt and not all_used and not _is_closed(mesh):
        raise MeshError(
            f"Link mesh '{path}' is probably not whole: {parsed.doubt}, and its surface is open. "
            "Export it again, or close it.",
            ErrorCode.MESH_UNREADABLE,
        )
    return mesh


def _is_closed(mesh: TriangleMesh) -> bool:
    return bool((find_edges(mesh.faces).uses == 2).all())


def _shape(path: Path, link: ET.Element, kind: str, geometry: ET.Element | None) -> TriangleMesh:
    given = [] if geometry is None else list(geometry)
    shape = given[0] if given else ET.Element("nothing")
    if shape.tag == "mesh":
        return _scaled(
            read_link_mesh(mesh_path(path, shape.get("filename", "")), solid=kind == "collision"),
            numbers(shape.get("scale", "1 1 1")),
        )
    if shape.tag == "box":
        return _box(_size(shape, "size", 3))
    if shape.tag == "cylinder":
        half = 0.5 * float(_size(shape, "length")[0])
        ring = _size(shape, "radius") * _circle(_ROUND)
        return convex_hull([(x, y, z) for x, y in ring for z in (-half, half)])
    if shape.tag == "sphere":
        height = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _RINGS + 1)
        points = [(*(np.cos(h) * xy), np.sin(h)) for h in height[1:-1] for xy in _circle(_OF_BALL)]
        ends = [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]
        return convex_hull(_size(shape, "radius") * np.array([*points, *ends]))
    raise RequestError(
        f"Link '{link.get('name')}' of '{path}' has a {kind} shape that is '{shape.tag}'; "
        f"give {_SHAPES}."
    )


def _solid(mesh: TriangleMesh, hulls: bool, where: str) -> TriangleMesh:
    if hulls:
        corners = _hull(mesh.vertices, where).vertices
        return convex_hull(fewest_vertices(corners, _HULL_TOLERANCE_M, MOST_CORNERS))
    if len(mesh.vertices) > MOST_CORNERS:
        raise RequestError(
            f"A collision shape of {where} has {len(mesh.vertices)} corners; the convex pieces of "
            f"a hand have {MOST_CORNERS} at most. Divide it into convex pieces, or take the "
            "convex hull of every shape by 'collision_hulls: true' in the hand's YAML file."
        )
    if not _is_closed(mesh):
        raise RequestError(
            f"A collision shape of {where} is not closed. Close it, or take the convex hull of "
            "every shape by 'collision_hulls: true' in the hand's YAML file."
        )
    return mesh


def _hull(points: Array, where: str) -> TriangleMesh:
    from scipy.spatial import QhullError

    try:
        return convex_hull(points)
    except QhullError as error:
        raise RequestError(
            f"A collision shape of {where} has no volume; correct its size or its mesh."
        ) from error


def _size(shape: ET.Element, key: str, n: int = 1) -> Array:
    """The sizes (n,) [m] of a box, cylinder or sphere."""
    size = numbers(shape.get(key, "0"))
    if len(size) != n or not np.isfinite(size).all() or not (size > 0.0).all():
        raise RequestError(
            f"A {shape.tag} of the hand's URDF has the {key} '{shape.get(key)}'; give {n} "
            f"{'number' if n == 1 else 'numbers'} above 0, in metres."
        )
    return size


def _scaled(mesh: TriangleMesh, scale: Array) -> TriangleMesh:
    if (scale == 1.0).all():
        return mesh
    scale = np.broadcast_to(scale, 3)
    # A mirrored mesh has its faces turned, to look outwards again.
    faces = mesh.faces if np.prod(scale) > 0.0 else mesh.faces[:, ::-1]
    return TriangleMesh(mesh.vertices * scale, np.ascontiguousarray(faces))


def _circle(n: int) -> Array:
    """Points (n, 2) of the unit circle."""
    turn = 2.0 * np.pi * np.arange(n) / n
    return np.column_stack([np.cos(turn), np.sin(turn)])


def _box(size: Array) -> TriangleMesh:
    """A box (3,) [m] about the origin."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    # counter-clockwise seen from outside; corner 4 i + 2 j + k
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [(a, b, c) for a, b, c, _ in sides] + [(a, c, d) for a, _, c, d in sides]
    return TriangleMesh(corners * size, np.array(faces, dtype=np.int32))
