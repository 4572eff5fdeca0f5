"""What a page shows of a grasp document, as plain geometry: no browser and no viewer here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.arm.description import ArmDescription, load_arm
from gpis_grasp_planner.arm.kinematics import link_poses
from gpis_grasp_planner.arm.urdf import Body
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import apply, inverse, transform
from gpis_grasp_planner.grasp.funnel import Funnel
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.lost_palms import LostPalms
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.urdf import visual_shapes
from gpis_grasp_planner.plan.request import PlanResult
from gpis_grasp_planner.quality.wrench_space import contact_wrenches, weakest_direction
from gpis_grasp_planner.search.search_space import PalmSearchSpace
from gpis_grasp_planner.surface.atlas import SurfaceAtlas
from gpis_grasp_planner.surface.chart import tangent_basis
from gpis_grasp_planner.surroundings.obstacles import BoxObstacle, Surroundings
from gpis_grasp_planner.surroundings.place import Place
from gpis_grasp_planner.view.grasp_motion import MotionFrame, grasp_motion
from gpis_grasp_planner.view.shapes import cone, cylinder, disc_points, ellipsoid, slab

Array = NDArray[np.float64]

ORDERS = ("answer", "epsilon", "volume", "trials")
_CONE_LENGTH_M = 0.02
_SLAB_M = 0.01


@dataclass(frozen=True, eq=False)
class WeakestWrench:
    """The wrench that the hand can apply least, at the centre of mass, in the object's frame.

    Attributes
    ----------
    point : (3,) array [m]
    force, torque : (3,) arrays
        Together a unit wrench; the torque is over the torque scale.
    """

    point: Array
    force: Array
    torque: Array


@dataclass(frozen=True, eq=False)
class GraspScene:
    """A part with its grasps, and all that stands around it.

    Attributes
    ----------
    part : Part
    hand : HandDescription
    place : Place
    grasps : tuple of Grasp
    cone_edges : int
        Of the friction pyramids.
    lost_palms : LostPalms
    funnel : Funnel
        How many hands were lost by their causes.
    """

    part: Part
    hand: HandDescription
    place: Place
    grasps: tuple[Grasp, ...] = ()
    cone_edges: int = 8
    lost_palms: LostPalms = field(default_factory=LostPalms)
    funnel: Funnel = field(default_factory=Funnel)

    @staticmethod
    def of_result(
        part: Part,
        hand: HandDescription,
        result: PlanResult,
        load_mesh: Callable[[str], TriangleMesh] | None = None,
    ) -> GraspScene:
        """The scene of a plan; where it has no grasp, of its best attempt.

        Parameters
        ----------
        part : Part
        hand : HandDescription
        result : PlanResult
        load_mesh : callable, optional
            From an obstacle's source to its mesh.

        Raises
        ------
        RequestError
            For a mesh of an obstacle that is not there.
        """
        place = Place() if result.place is None else Place.from_mapping(result.place, load_mesh)
        best = result.best_attempt
        grasps = result.grasps or (() if best is None else (best,))
        return GraspScene(
            part, hand, place, grasps, result.cone_edges, result.lost_palms, result.funnel
        )

    @cached_property
    def link_shapes(self) -> tuple[tuple[TriangleMesh, ...], ...]:
        """What each link of the hand looks like, in its own frame."""
        return visual_shapes(self.hand.urdf_path, self.hand, self.hand.palm_turn)

    @cached_property
    def arm(self) -> ArmDescription | None:
        """The arm of the grasps' motions."""
        names = {grasp.arm.arm for grasp in self.grasps if grasp.arm is not None}
        return load_arm(names.pop()) if names else None

    @property
    def T_arm(self) -> Array:
        """The arm's frame in the world's."""
        return np.eye(4) if self.place.T_world_arm is None else self.place.T_world_arm

    def motion(self, grasp: Grasp) -> tuple[MotionFrame, ...]:
        """The way to a grasp and up from it."""
        T_object_arm = inverse(self.place.T_world_object) @ self.T_arm
        return grasp_motion(self.hand, grasp, self.arm, T_object_arm)

    def link_poses(self, frame: MotionFrame) -> Array:
        """Poses (L, 4, 4) of the hand's links in the object's frame."""
        return np.asarray(frame.T_object_palm @ link_transforms(self.hand, frame.joints)[0])

    def arm_poses(self, frame: MotionFrame) -> Array:
        """Poses (n + 1, 4, 4) of the arm's links in the world's frame; none without an arm."""
        if self.arm is None or frame.arm_joints is None:
            return np.empty((0, 4, 4))
        T_base_link = link_poses(self.arm.chain, frame.arm_joints)[0][:-1]
        return np.asarray(self.T_arm @ self.arm.T_arm_base @ T_base_link)

    def weakest(self, grasp: Grasp) -> WeakestWrench | None:
        """The weakest direction of the grasp wrench space; None where it is flat."""
        if not len(grasp.contacts):
            return None
        center = self.part.center_of_mass
        wrench = weakest_direction(
            contact_wrenches(grasp.contacts, center, self.part.max_radius, self.cone_edges)
        )
        return None if wrench is None else WeakestWrench(center, wrench[:3], wrench[3:])

    def surroundings(self) -> dict[str, TriangleMesh]:
        """Meshes of support and obstacles in the world's frame, by name."""
        return surrounding_meshes(
            self.place.surroundings,
            apply(self.place.T_world_object, self.part.mesh.vertices),
        )


def friction_cones(grasp: Grasp) -> list[TriangleMesh]:
    """One per contact, from the contact into the object; its slope is the friction."""
    contacts = grasp.contacts
    return [
        cone(point, normal, float(friction), _CONE_LENGTH_M)
        for point, normal, friction in zip(
            contacts.positions, contacts.normals_inward, contacts.friction, strict=True
        )
    ]


def arm_shape(body: Body) -> TriangleMesh:
    """A body of the arm in the frame of its link."""
    if body.shape == "cylinder":
        return cylinder(body.T_link_shape, *body.size)
    if body.shape == "sphere":
        return ellipsoid(body.T_link_shape[:3, 3], [body.size[0]] * 3)
    return slab(body.T_link_shape, body.size)


def surrounding_meshes(around: Surroundings, part_points: Array) -> dict[str, TriangleMesh]:
    """The support as a slab under the part's points (n, 3) [m], boxes and meshes; all by name."""
    meshes = {}
    middle = part_points.mean(axis=0)
    size = 2.0 * float(np.linalg.norm(np.ptp(part_points, axis=0)))
    for number, thing in enumerate(around.obstacles):
        if isinstance(thing, BoxObstacle):
            mesh = slab(thing.pose, thing.size)
        else:
            mesh = TriangleMesh(apply(thing.pose, thing.mesh.vertices), thing.mesh.faces)
        meshes[f"{number} {thing.name}"] = mesh
    if around.support is not None:
        plane = around.support
        foot = middle - ((middle - plane.point) @ plane.normal + 0.5 * _SLAB_M) * plane.normal
        R = np.column_stack([tangent_basis(plane.normal), plane.normal])
        meshes[plane.name] = slab(transform(R, foot), [size, size, _SLAB_M])
    return meshes


def sorted_indices(grasps: Sequence[Grasp], order: str) -> list[int]:
    """Numbers of the grasps, best first by one of :data:`ORDERS`; equal ones as they were."""
    figures: dict[str, Callable[[int], float]] = {
        "answer": lambda i: -i,
        "epsilon": lambda i: grasps[i].epsilon,
        "volume": lambda i: grasps[i].volume,
        "trials": lambda i: _passed_share(grasps[i]),
    }
    return sorted(range(len(grasps)), key=figures[order], reverse=True)


def _passed_share(grasp: Grasp) -> float:
    """Share of the trials passed, -1 for a grasp that was not tried."""
    if grasp.trials is None or not grasp.trials.outcomes:
        return -1.0
    return grasp.trials.n_passed / len(grasp.trials.outcomes)


def trials_text(grasp: Grasp) -> str:
    """Trials passed of those made."""
    if grasp.trials is None or not grasp.trials.outcomes:
        return "not tried"
    return f"{grasp.trials.n_passed} of {len(grasp.trials.outcomes)}"


def search_model(
    scene: GraspScene, atlas: SurfaceAtlas, palm_clearance_m: float
) -> tuple[list[TriangleMesh], list[Array]]:
    """The two ellipsoids between which palms are sought, and charts of the surface as rings.

    The charts (24, 3) [m] are those nearest to the first grasp's contacts; without a grasp, of
    12 of the atlas' points.
    """
    space = PalmSearchSpace(scene.part.mesh.bounds, palm_clearance_m)
    if scene.grasps and len(scene.grasps[0].contacts):
        chosen = np.unique(atlas.nearest(scene.grasps[0].contacts.positions)[0])
    else:
        chosen = np.linspace(0, len(atlas.points) - 1, 12).astype(np.intp)
    charts = [atlas.chart(int(index)) for index in chosen]
    radius = 0.08 * scene.part.mesh.diagonal
    return (
        [ellipsoid(space.center, axes) for axes in (space.inner_axes, space.outer_axes)],
        [disc_points(chart.center, chart.normal_outward, radius) for chart in charts],
    )
