"""From a parsed cloud to a closed mesh that is planned on, and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.cloud.cleaning import inliers, noise_and_neighbours, thinned
from gpis_grasp_planner.geometry.cloud.closed_surface import CloudProcess, Grid, zero_level
from gpis_grasp_planner.geometry.cloud.normals import outward_normals
from gpis_grasp_planner.geometry.cloud.samples import observations
from gpis_grasp_planner.geometry.cloud.views import (
    MOST_CARVING,
    MOST_ORIENTING,
    View,
    spacing_of,
    spread,
)
from gpis_grasp_planner.geometry.defects import Judged, judge
from gpis_grasp_planner.geometry.formats.parsed_cloud import ParsedCloud
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.surface_samples import even_samples
from gpis_grasp_planner.geometry.uncertainty import SurfaceUncertainty
from gpis_grasp_planner.geometry.units import check_extent
from gpis_grasp_planner.thread_limits import limited_threads

Array = NDArray[np.float64]

_DRAW_CELLS = 0.65  # of the mean surface's, along an axis
_FLAT = 0.03  # thickness over the largest extent of what is no body but a sheet
_FLAT_IN_NOISE = 5.0
_DEVIATIONS = 800  # points at which the deviation is known
_GUESS = 0.25  # deviation over the samples' spacing, of surface that was not seen


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A cloud's mean surface as a judged mesh, how well it is known, and what was decided."""

    judged: Judged
    uncertainty: SurfaceUncertainty
    notes: tuple[str, ...]


@limited_threads()
def reconstruct(
    cloud: ParsedCloud, *, name: str, unit: str, settings: CatalogueSettings
) -> Reconstruction:
    """Close the surface of a cloud by a Gaussian process; 1.5 to 3 s, most of it Open3D's import.

    Parameters
    ----------
    cloud : ParsedCloud
        In metres.
    name : str
        What messages call the file.
    unit : str
        The unit that it was read in, for the advice on an implausible extent.
    settings : CatalogueSettings
        Its `cloud_...` settings.

    Raises
    ------
    MeshError
        For a cloud without a usable surface: too few points, mostly outliers, scattered, flat, or
        of an implausible size.
    """
    first = thinned(cloud.points)
    points = cloud.points[first]
    kept = inliers(points, name)
    points = points[kept]
    own = None if cloud.normals is None else cloud.normals[first][kept]
    check_extent(points, name, unit, settings)
    noise, neighbours = noise_and_neighbours(points, name)
    measured = settings.cloud_noise_m or noise
    _refuse_sheet(points, measured, name)
    spacing = spacing_of(points)
    orienting = spread(cloud.viewpoints, MOST_ORIENTING)
    views = [View.of(points, v, spacing, measured) for v in orienting]
    oriented = outward_normals(points, neighbours, own, views)
    seen = observations(points, oriented.normals_outward, measured, settings.cloud_samples)
    process = CloudProcess(seen)
    carving = spread(cloud.viewpoints, MOST_CARVING if settings.cloud_carving else 0)
    views = [View.of(points, v, spacing, measured) for v in carving]
    mean = zero_level(_carved(process.grid(settings.cloud_cells), views), name)
    faces = mean.faces.astype(np.int64)
    judged = judge(mean.vertices, faces, name=name, unit=unit, settings=settings)
    at = even_samples(judged.mesh, _DEVIATIONS, seed=0).points
    deviation = process.deviation(at)
    draws = _draws(process, judged.mesh, views, settings, name)
    n_out = len(first) - len(kept)
    guessed = float((deviation > _GUESS * spacing_of(seen.points)).mean())
    how = "as set" if settings.cloud_noise_m else "estimated"
    notes = (
        f"Reconstructed from a cloud of {len(cloud.points)} points ({n_out} outliers left out, "
        f"noise {1e3 * measured:.2g} mm {how}); of the closed surface about "
        f"{100.0 * guessed:.0f} % was not seen and is a guess.",
        oriented.note,
        *(_carving_note(len(views)) if views else ()),
    )
    return Reconstruction(judged, SurfaceUncertainty(at, deviation, draws), notes)


def _carving_note(n: int) -> tuple[str, ...]:
    return (
        f"What is outside the silhouette from {n} viewpoint{'s' if n > 1 else ''} was taken as "
        "empty: the cloud must be all that was seen (else set catalogue.cloud_carving to false).",
    )


def _refuse_sheet(points: Array, noise: float, name: str) -> None:
    _, axes = np.linalg.eigh(np.cov(points.T))
    along = points @ axes
    low, high = np.quantile(along, [0.01, 0.99], axis=0)
    thickness, largest = float((high - low)[0]), float((high - low)[2])
    limit = max(_FLAT * largest, _FLAT_IN_NOISE * noise)
    if thickness < limit:
        raise MeshError(
            f"{name} is a flat sheet: {1e3 * thickness:.2g} mm thick for a noise of "
            f"{1e3 * noise:.2g} mm and an extent of {1e3 * largest:.3g} mm; a body takes "
            f"{1e3 * limit:.2g} mm. Scan the part from a second side, without the table.",
            ErrorCode.MESH_DEGENERATE,
        )


def _carved(grid: Grid, views: list[View]) -> Grid:
    """The grid, with what the views know to be empty outside."""
    values = grid.values.reshape(-1).copy()
    nodes = grid.nodes()
    for view in views:
        rows = np.flatnonzero(values < grid.spacing)
        values[rows] = np.maximum(values[rows], view.emptiness(nodes[rows]))
    return replace(grid, values=values.reshape(grid.values.shape))


def _draws(
    process: CloudProcess,
    mean: TriangleMesh,
    views: list[View],
    settings: CatalogueSettings,
    name: str,
) -> tuple[TriangleMesh, ...]:
    """Surfaces drawn from the process."""
    grid = process.grid(max(8, int(_DRAW_CELLS * settings.cloud_cells)))
    near = np.abs(grid.values.reshape(-1)) < 0.5 * np.linalg.norm(mean.extent)
    nodes = grid.nodes()[near]
    drawn = []
    for shift in process.draws(settings.cloud_draws, mean.vertices, nodes, seed=0):
        values = grid.values.reshape(-1).copy()
        values[near] += shift
        one = replace(grid, values=values.reshape(grid.values.shape))
        drawn.append(zero_level(_carved(one, views), name))
    return tuple(drawn)
