"""A part to be grasped: its mesh, and the facts of mechanics that the mesh does not hold."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.uncertainty import SurfaceUncertainty

FRICTION_RANGE = (0.01, 5.0)  # of every coefficient, wherever it is given


@dataclass(frozen=True)
class Friction:
    """Coulomb coefficients of the pairs (hand link, object): finger links and palm may differ."""

    finger: float
    palm: float


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh with its centre of mass and what the sidecar file said, in the mesh file's own frame.

    Attributes
    ----------
    mesh_id : str
    mesh : TriangleMesh
    center_of_mass : (3,) array [m]
    mass : float [kg]
    volume : float [m^3]
    watertight : bool
    friction : Friction or None
        From the sidecar; None where it says nothing and the settings decide.
    notes : tuple of str
        What was repaired or assumed, for the answer to report.
    simplified : TriangleMesh or None
        Of a large mesh, one of fewer triangles for surface, distance field, PyBullet and convex
        pieces; a note says how far it is from the mesh. Contacts are decided on the mesh.
    simplified_apart_m : float [m]
        How far that is at most, of some thousand points.
    mass_assumed : bool
        Whether the mass is by a density that nobody stated.
    uncertainty : SurfaceUncertainty or None
        Of a mesh that was reconstructed from a point cloud; None for a mesh file.
    """

    mesh_id: str
    mesh: TriangleMesh
    center_of_mass: NDArray[np.float64]
    mass: float
    volume: float
    watertight: bool
    friction: Friction | None = None
    notes: tuple[str, ...] = field(default=())
    simplified: TriangleMesh | None = None
    mass_assumed: bool = False
    uncertainty: SurfaceUncertainty | None = None
    simplified_apart_m: float = 0.0

    @property
    def drawn(self) -> tuple[Part, ...]:
        """The part with each of the surfaces that it may have; none of a mesh file."""
        surfaces = () if self.uncertainty is None else self.uncertainty.draws
        return tuple(
            replace(self, mesh=surface, simplified=None, uncertainty=None) for surface in surfaces
        )

    @property
    def working_mesh(self) -> TriangleMesh:
        """The mesh that search and physics work with: the simplified one of a large mesh."""
        return self.simplified or self.mesh

    @property
    def max_radius(self) -> float:
        """Distance of the farthest vertex from the centre of mass [m]: the scale of torques."""
        return float(np.linalg.norm(self.mesh.vertices - self.center_of_mass, axis=1).max())
