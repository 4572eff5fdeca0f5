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
from gpis_grasp_planner.geometry.inner_faces import inner_walls, repeats
from gpis_grasp_planner.geometry.mass_properties import (
    fans_across_holes,
    hull,
    volume_and_center,
)
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.orientation import Oriented, orient
from gpis_grasp_planner.geometry.ray_crossings import crossing_numbers
from gpis_grasp_planner.geometry.slivers import altitudes, without_slivers
from gpis_grasp_planner.geometry.topology import Edges, bodies, find_edges
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.geometry.units import check_extent
from gpis_grasp_planner.geometry.welding import merge_equal, weld

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
RawFaces = NDArray[np.int64]  # as parsed: an index may be anything until it is checked

ABSURD_COORDINATE_M = 1e6
THIN_FACE = 1e-7  # altitude of a face without area, relative to the part's largest extent
FLAT = 1e-7  # volume of the hull of a part without thickness, relative to its extent cubed
SMALL_HOLES = 0.1  # share of the surface that fans across its holes may make up
TIGHT = 0.98  # share of single rays that must find the surface closed for gaps not to matter
SHEET = 0.5  # share of the area without inside and outside that makes a sheet
PROBES = 200


@dataclass(frozen=True, eq=False)
class Judged:
    """A mesh that may be planned on, and what was found on the way.

    Attributes
    ----------
    mesh : TriangleMesh
    watertight : bool
        Closed and with a volume.
    volume : float
        Enclosed volume [m^3]; where the mesh is open, a note says how it was found.
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
    check_extent(_used_points(vertices, parsed_faces), name, unit, settings)
    vertices, faces = merge_equal(vertices, parsed_faces)
    drop = drop_degenerate or settings.degenerate_faces == "drop"
    faces = _without_degenerate(vertices, faces, name, drop, notes)
    faces = _welded(vertices, faces, notes)
    faces = _without_repeats(faces, notes)
    vertices, faces = _used_only(vertices, faces)
    edges = find_edges(faces)
    oriented = _without_inner_walls(vertices, orient(vertices, faces, edges), notes)
    _note_turned(oriented, notes)
    vertices, kept = _used_only(vertices, oriented.faces)
    if oriented.turned.any() or len(kept) < len(faces):
        edges = find_edges(kept)
    mesh = TriangleMesh(vertices, kept)
    return _measure(mesh, edges, oriented, name, notes)


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


def _without_degenerate(
    vertices: Array, faces: Faces, name: str, drop: bool, notes: list[str]
) -> Faces:
    limit = THIN_FACE * float(np.ptp(vertices, axis=0).max())
    thin = altitudes(vertices, faces) <= limit
    if not thin.any():
        return faces
    count = int(thin.sum())
    if thin.all():
        raise MeshError(
            f"{name}: none of its {len(faces)} faces has an area.", ErrorCode.MESH_DEGENERATE
        )
    if not drop:
        first = int(np.flatnonzero(thin)[0])
        raise MeshError(
            f"{name}: face {first + 1} has no area ({count} such faces of {len(faces)}). Repair "
            "the mesh, or set degenerate_faces to 'drop'.",
            ErrorCode.MESH_DEGENERATE,
        )
    faces, left_out = without_slivers(vertices, faces, limit)
    what = f"{count} faces without area were dropped"
    notes.append(f"{what}, {left_out} of them without closing up." if left_out else f"{what}.")
    return faces


def _welded(vertices: Array, faces: Faces, notes: list[str]) -> Faces:
    edges = find_edges(faces)
    if edges.open == 0:
        return faces
    faces, distance = weld(vertices, faces, edges)
    if distance > 0.0:
        still = find_edges(faces).open
        what = f"; {still} of {edges.open} open edges are left" if still else ""
        notes.append(
            f"Vertices closer than {1e6 * distance:.2g} um were joined to close the surface{what}."
        )
    return faces


def _without_repeats(faces: Faces, notes: list[str]) -> Faces:
    duplicates, behind = repeats(faces)
    if duplicates.any():
        notes.append(f"{int(duplicates.sum())} duplicate faces were dropped.")
    if behind.any():
        notes.append(f"{int(behind.sum())} faces that repeat others from behind were dropped.")
    dropped = duplicates | behind
    return faces[~dropped] if dropped.any() else faces


def _without_inner_walls(vertices: Array, oriented: Oriented, notes: list[str]) -> Oriented:
    walls = inner_walls(vertices, oriented)
    if not walls.any():
        return oriented
    notes.append(f"{int(walls.sum())} faces inside the body (inner walls) were dropped.")
    kept = ~walls
    return Oriented(
        oriented.faces[kept],
        oriented.turned[kept],
        oriented.wound,
        oriented.one_sided[kept],
        oriented.undecided[kept],
    )


def _used_points(vertices: Array, faces: RawFaces) -> Array:
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    return vertices[used]


def _used_only(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if used.all():
        return vertices, faces
    index = np.cumsum(used, dtype=np.int32) - 1
    return vertices[used], index[faces].astype(np.int32)


def _note_turned(oriented: Oriented, notes: list[str]) -> None:
    turned = int(oriented.turned.sum())
    if turned == len(oriented.turned):
        notes.append("The faces looked inwards and were turned (inverted mesh).")
    elif turned and oriented.wound:
        notes.append(f"{turned} faces that wound against their neighbours were turned.")
    elif turned:
        notes.append(f"{turned} faces looked inwards and were turned.")
    if oriented.one_sided.any():
        what = "The surface is" if oriented.one_sided.all() else "A part of the surface is"
        notes.append(f"{what} one-sided (not orientable); its faces were left as they were.")
    if unknown := int(oriented.undecided.sum()):
        notes.append(
            f"For {unknown} faces nothing tells outside from inside; they look the way the file "
            "has them."
        )


def _measure(
    mesh: TriangleMesh, edges: Edges, oriented: Oriented, name: str, notes: list[str]
) -> Judged:
    count, _ = bodies(mesh.faces)
    least_volume = FLAT * float(mesh.extent.max()) ** 3
    if edges.non_manifold:
        notes.append(f"{edges.non_manifold} edges have more than two faces (non-manifold).")
    if count > 1:
        what = "separate bodies" if edges.closed else "unconnected pieces of surface"
        notes.append(f"{count} {what} are planned on as one rigid part.")
    volume, center = volume_and_center(mesh.triangles)
    watertight = edges.closed and volume > least_volume
    if not watertight:
        volume, center = _open_volume(mesh, edges, oriented, least_volume, name, notes)
    elif (found := _wrong_share(mesh, rays=3)) > 0.0:
        notes.append(
            f"The surface intersects itself or its bodies overlap (about {100 * found:.0f} % of "
            "it); overlaps count twice in volume and centre of mass."
        )
    return Judged(mesh, watertight, volume, center, count, tuple(notes))


def _open_volume(
    mesh: TriangleMesh,
    edges: Edges,
    oriented: Oriented,
    least_volume: float,
    name: str,
    notes: list[str],
) -> tuple[float, Array]:
    """Volume and centre of a surface that is open, or closed round nothing; a note says of what."""
    area = mesh.face_areas
    if edges.open:
        fans = fans_across_holes(mesh.vertices, edges)
        vectors = np.cross(fans[:, 1] - fans[:, 0], fans[:, 2] - fans[:, 0])
        added = 0.5 * float(np.linalg.norm(vectors, axis=1).sum())
        volume, center = volume_and_center(np.concatenate([mesh.triangles, fans]))
        if added <= SMALL_HOLES * float(area.sum()) and volume > least_volume:
            notes.append(
                f"The surface is open at {edges.open} edges; volume and centre of mass are those "
                f"of it with its holes closed ({100 * added / float(area.sum()):.2g} % of it)."
            )
            return volume, center
        volume, center = volume_and_center(mesh.triangles)
        if volume > least_volume and _wrong_share(mesh, rays=1) <= 1.0 - TIGHT:
            notes.append(
                f"The surface is open at {edges.open} edges by gaps between its faces; volume and "
                "centre of mass are those of the faces without the gaps."
            )
            return volume, center
    what = f"is open at {edges.open} edges" if edges.open else "encloses no volume"
    if float(area[oriented.undecided].sum()) > SHEET * float(area.sum()):
        what = f"is a sheet that bounds no solid ({edges.open} open edges)"
    volume, center = _hull_volume_and_center(mesh, least_volume, name)
    notes.append(f"The surface {what}; volume and centre of mass are those of its convex hull.")
    return volume, center


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


def _wrong_share(mesh: TriangleMesh, rays: int) -> float:
    """Share of probed faces with a winding number other than 0 before and 1 behind them."""
    share = mesh.face_areas / mesh.face_areas.sum()
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(share), size=PROBES, p=share)
    # Anywhere on a face but at its rim: a large face may lie in another body with a corner only.
    weights = rng.dirichlet(np.ones(3), size=PROBES)
    weights = 0.9 * weights + 0.1 / 3.0
    centers = np.einsum("nk,nkd->nd", weights, mesh.triangles[chosen])
    # A step of a thousandth of the face's own size stays well on its side of the neighbours.
    step = 1e-3 * np.sqrt(mesh.face_areas[chosen]).clip(max=1e-2 * mesh.diagonal)
    step = step[:, None] * mesh.face_normals_outward[chosen]
    tree = TriangleTree.of(mesh)
    before = crossing_numbers(tree, centers + step, rays)
    behind = crossing_numbers(tree, centers - step, rays)
    return float(((before != 0) | (behind != 1)).mean())
