"""The policy on defects of a mesh: what is refused, what is repaired and reported, what is noted.

The table of it is in ``docs/meshes.md``. Nothing is repaired without a note, and a note is
part of every answer about the part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import QhullError

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.mass_properties import hull, signed_volume, volume_and_center
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.topology import bodies, faces_to_flip, find_edges
from gpis_grasp_planner.geometry.units import check_extent
from gpis_grasp_planner.geometry.winding import winding_numbers

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
RawFaces = NDArray[np.int64]  # as parsed: an index may be anything until it is checked

ABSURD_COORDINATE_M = 1e6
THIN_FACE = 1e-7  # altitude of a face without area, relative to the part's largest extent
WELD = 1e-6  # distance of vertices that may be meant as one, relative to the largest extent
FLAT = 1e-7  # volume of the hull of a part without thickness, relative to its extent cubed
OVERLAP_PROBES = 200
OVERLAP_PAIRS = 4_000_000  # probes are cut so that a large mesh is judged in about a second
MAX_BODIES = 200


@dataclass(frozen=True, eq=False)
class Judged:
    """A mesh that may be planned on, and what was found on the way.

    Attributes
    ----------
    mesh : TriangleMesh
    watertight : bool
        Closed and with a volume.
    volume : float
        Enclosed volume [m^3]; of the convex hull where the mesh is not watertight.
    center_of_volume : (3,) array
        Centre of that volume [m].
    bodies : int
        Connected pieces.
    notes : tuple of str
        Repairs and assumptions, one sentence each.
    """

    mesh: TriangleMesh
    watertight: bool
    volume: float
    center_of_volume: Array
    bodies: int
    notes: tuple[str, ...]


def judge(
    vertices: Array,
    parsed_faces: RawFaces,
    *,
    name: str,
    unit: str,
    settings: CatalogueSettings,
    drop_degenerate: bool = False,
) -> Judged:
    """Refuse, repair or note the defects of a parsed mesh.

    Parameters
    ----------
    vertices : (n, 3) array [m]
    parsed_faces : (m, 3) int array
    name : str
        What messages call the file.
    unit : str
        The unit the file was read in, for the advice on an implausible extent.
    settings : CatalogueSettings
    drop_degenerate : bool
        Drop faces without area whatever the settings say (tessellations of STEP files, which
        their author cannot mend).

    Raises
    ------
    MeshError
        MESH_EMPTY, MESH_BAD_INDEX, MESH_NOT_FINITE, MESH_EXTENT_IMPLAUSIBLE, MESH_DEGENERATE.
    """
    notes: list[str] = []
    _check_content(vertices, parsed_faces, name)
    check_extent(vertices[np.unique(parsed_faces)], name, unit, settings)
    vertices, faces = _merge_equal(vertices, parsed_faces)
    drop = drop_degenerate or settings.degenerate_faces == "drop"
    faces = _without_degenerate(vertices, faces, name, drop, notes)
    vertices, faces = _weld_if_that_closes(vertices, faces, notes)
    faces = _without_duplicates(faces, notes)
    vertices, faces = _used_only(vertices, faces)
    faces = _wind_consistently(faces, notes)
    faces = _face_outwards(vertices, faces, name, notes)
    return _measure(TriangleMesh(vertices, faces), name, notes)


def _check_content(vertices: Array, faces: RawFaces, name: str) -> None:
    if len(faces) == 0 or len(vertices) == 0:
        raise MeshError(
            f"{name} has no faces. Export it again, as triangles.", ErrorCode.MESH_EMPTY
        )
    wrong = (faces < 0) | (faces >= len(vertices))
    if wrong.any():
        face, corner = np.argwhere(wrong)[0]
        raise MeshError(
            f"{name}: face {face + 1} uses vertex index {faces[face, corner]}, the file has "
            f"{len(vertices)} vertices. Export it again.",
            ErrorCode.MESH_BAD_INDEX,
        )
    worst = np.abs(vertices).max(axis=1)
    corners = worst[faces].max(axis=1)  # NaN stays NaN
    not_finite = np.flatnonzero(~np.isfinite(corners))
    if not_finite.size:
        raise MeshError(
            f"{name}: face {not_finite[0] + 1} has a vertex that is not finite "
            f"({not_finite.size} such faces of {len(faces)}). Repair the mesh and export it again.",
            ErrorCode.MESH_NOT_FINITE,
        )
    absurd = np.flatnonzero(corners > ABSURD_COORDINATE_M)
    if absurd.size:
        raise MeshError(
            f"{name}: face {absurd[0] + 1} has a coordinate of {corners[absurd[0]]:.3g} m, the "
            f"limit is {ABSURD_COORDINATE_M:.0e} m. The file is damaged; export it again.",
            ErrorCode.MESH_EXTENT_IMPLAUSIBLE,
        )


def _merge_equal(vertices: Array, faces: RawFaces) -> tuple[Array, Faces]:
    # + 0.0 turns -0.0 into 0.0, which are equal but not the same bytes.
    merged, index = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    return merged, index.reshape(-1)[faces].astype(np.int32)


def _altitudes(vertices: Array, faces: Faces) -> Array:
    triangles = vertices[faces]
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    double_area = np.linalg.norm(
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
    )
    return np.divide(double_area, sides, out=np.zeros_like(sides), where=sides > 0)


def _without_degenerate(
    vertices: Array, faces: Faces, name: str, drop: bool, notes: list[str]
) -> Faces:
    limit = THIN_FACE * float(np.ptp(vertices, axis=0).max())
    thin = _altitudes(vertices, faces) <= limit
    if not thin.any():
        return faces
    if not drop:
        first = int(np.flatnonzero(thin)[0])
        raise MeshError(
            f"{name}: face {first + 1} has no area ({int(thin.sum())} such faces of "
            f"{len(faces)}). Repair the mesh, or set degenerate_faces to 'drop'.",
            ErrorCode.MESH_DEGENERATE,
        )
    if thin.all():
        raise MeshError(
            f"{name}: none of its {len(faces)} faces has an area.", ErrorCode.MESH_DEGENERATE
        )
    notes.append(f"{int(thin.sum())} faces without area were dropped.")
    return faces[~thin]


def _weld_if_that_closes(vertices: Array, faces: Faces, notes: list[str]) -> tuple[Array, Faces]:
    """Join vertices within a hair's breadth, but only where it turns an open mesh into a closed."""
    if find_edges(faces).open == 0:
        return vertices, faces
    distance = WELD * float(np.ptp(vertices, axis=0).max())
    _, first, index = np.unique(
        np.round(vertices / distance), axis=0, return_index=True, return_inverse=True
    )
    welded = index.reshape(-1)[faces].astype(np.int32)
    collapsed = (welded == np.roll(welded, 1, axis=1)).any(axis=1)
    welded = welded[~collapsed]
    if len(welded) == 0 or find_edges(welded).open > 0:
        return vertices, faces
    notes.append(f"Vertices closer than {1e6 * distance:.2g} um were joined to close the surface.")
    return vertices[first], welded


def _without_duplicates(faces: Faces, notes: list[str]) -> Faces:
    start = faces.argmin(axis=1)
    turned = np.take_along_axis(faces, (start[:, None] + np.arange(3)) % 3, axis=1)
    _, first = np.unique(turned, axis=0, return_index=True)
    if len(first) == len(faces):
        return faces
    notes.append(f"{len(faces) - len(first)} duplicate faces were dropped.")
    return faces[np.sort(first)]


def _used_only(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    used, index = np.unique(faces, return_inverse=True)
    return vertices[used], index.reshape(faces.shape).astype(np.int32)


def _wind_consistently(faces: Faces, notes: list[str]) -> Faces:
    edges = find_edges(faces)
    if edges.agree.all():
        return faces
    flip, possible = faces_to_flip(edges, len(faces))
    if not possible:
        notes.append("The surface is one-sided (not orientable); its faces were left as they are.")
        return faces
    notes.append(f"{int(flip.sum())} faces that wound against their neighbours were turned.")
    faces = faces.copy()
    faces[flip] = faces[flip][:, ::-1]
    return faces


def _face_outwards(vertices: Array, faces: Faces, name: str, notes: list[str]) -> Faces:
    count, body = bodies(faces)
    if count > MAX_BODIES:
        raise MeshError(
            f"{name} falls into {count} unconnected pieces, the limit is {MAX_BODIES}. Join its "
            "vertices or remove loose pieces.",
            ErrorCode.MESH_DEGENERATE,
        )
    triangles = vertices[faces]
    turned = np.zeros(len(faces), dtype=bool)
    for b in range(count):
        mine = body == b
        if not find_edges(faces[mine]).closed:
            turned[mine] = _mostly_inward(triangles[mine])
            continue
        if signed_volume(triangles[mine]) >= 0.0:
            continue
        # An inward-facing piece inside another is the wall of a cavity, which is right.
        others = triangles[~mine]
        probe = triangles[mine].reshape(-1, 3)[:1]
        if count == 1 or abs(winding_numbers(others, probe)[0]) < 0.5:
            turned[mine] = True
    if not turned.any():
        return faces
    what = "The faces" if turned.all() else f"{int(turned.sum())} faces"
    notes.append(f"{what} looked inwards and were turned (inverted mesh).")
    faces = faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    return faces


def _mostly_inward(triangles: Array) -> bool:
    """Whether an open piece, closed by a fan to its mean corner, encloses a negative volume."""
    return signed_volume(triangles - triangles.reshape(-1, 3).mean(axis=0)) < 0.0


def _measure(mesh: TriangleMesh, name: str, notes: list[str]) -> Judged:
    edges = find_edges(mesh.faces)
    count, _ = bodies(mesh.faces)
    least_volume = FLAT * float(mesh.extent.max()) ** 3
    if edges.non_manifold:
        notes.append(f"{edges.non_manifold} edges have more than two faces (non-manifold).")
    if count > 1:
        notes.append(f"{count} separate bodies are planned on as one rigid part.")
    volume, center = volume_and_center(mesh.triangles)
    watertight = edges.closed and volume > least_volume
    if not watertight:
        volume, center = _hull_volume_and_center(mesh, least_volume, name)
        what = f"is open at {edges.open} edges" if edges.open else "encloses no volume"
        notes.append(f"The surface {what}; volume and centre of mass are those of its convex hull.")
    elif share := _overlap_share(mesh):
        notes.append(
            f"The surface intersects itself or its bodies overlap (about {100 * share:.0f} % of "
            "it); overlaps count twice in volume and centre of mass."
        )
    return Judged(mesh, watertight, volume, center, count, tuple(notes))


def _hull_volume_and_center(
    mesh: TriangleMesh, least_volume: float, name: str
) -> tuple[float, Array]:
    try:
        volume, center = volume_and_center(hull(mesh).triangles)
    except QhullError:
        volume, center = 0.0, np.zeros(3)
    if volume <= least_volume:
        raise MeshError(
            f"{name} is flat: its convex hull has no volume. Give the part a thickness.",
            ErrorCode.MESH_DEGENERATE,
        )
    return volume, center


def _overlap_share(mesh: TriangleMesh) -> float:
    """Share of probed faces with a winding number other than 0 before and 1 behind them."""
    count = min(OVERLAP_PROBES, max(8, OVERLAP_PAIRS // (2 * len(mesh.faces))))
    share = mesh.face_areas / mesh.face_areas.sum()
    chosen = np.random.default_rng(0).choice(len(share), size=count, p=share)
    centers = mesh.triangles[chosen].mean(axis=1)
    # A step of a hundredth of the face's own size stays well on its side of the neighbours.
    step = 1e-2 * np.sqrt(mesh.face_areas[chosen]).clip(max=1e-2 * mesh.diagonal)
    step = step[:, None] * mesh.face_normals_outward[chosen]
    before = winding_numbers(mesh.triangles, centers + step)
    behind = winding_numbers(mesh.triangles, centers - step)
    wrong = (np.abs(before) > 0.5) | (np.abs(behind - 1.0) > 0.5)
    return float(wrong.mean())
