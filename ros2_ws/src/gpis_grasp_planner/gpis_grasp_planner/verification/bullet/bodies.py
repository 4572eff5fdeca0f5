"""Hand and object as Bullet's dynamics takes them.

The fingers are one multi-body with a fixed base: their closing joints, no more is simulated. Palm
and knuckles do not move and are fixed bodies; the pre-shape is set before (its drive holds it).
PyBullet gives every link a collision margin of 1 mm that cannot be changed, so the links' hulls
are made 1 mm smaller: together they have the link's faces where they are, with edges rounded by
1 mm. A margin also keeps Bullet's contacts out of its deep-penetration case.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.compiled_cache import contents, write_kept
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import to_position_quat_xyzw
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.link_mesh import fewest_vertices
from gpis_grasp_planner.packed_arrays import pack, unpack
from gpis_grasp_planner.scene.arrays import hand_key
from gpis_grasp_planner.scene.bullet_world import BulletClient, hull_shape
from gpis_grasp_planner.verification.inertia import inertia_of

Array = NDArray[np.float64]

LINK_MARGIN_M = 0.001
# A link's hull may lose this much. Bullet's time goes into looking for extreme vertices, and
# moving the faces in leaves two corners where many faces met in one.
_HULL_TOLERANCE_M = 2e-5
OBJECT_MARGIN_M = 1e-5
_THINNEST_M = 1e-5  # half of what is left of a piece


@dataclass(frozen=True)
class HandBodies:
    """PyBullet's handles of a hand.

    Attributes
    ----------
    fingers : int
        The multi-body of the moving links.
    joint_of : dict
        Index of the hand's joint to PyBullet's joint; the pre-shape's have none.
    link_of : dict
        (body, PyBullet's link) to the hand's link.
    """

    fingers: int
    joint_of: dict[int, int]
    link_of: dict[tuple[int, int], int]


@lru_cache(maxsize=4)
def link_hulls(hand: HandDescription) -> tuple[tuple[Array, ...], ...]:
    """Hull vertices (n, 3) per link and piece, inset by :data:`LINK_MARGIN_M`.

    0.4 s, once per installation: they are kept beside the compiled code.
    """
    name = f"hulls-{hand_key(hand, 'verification/bullet/bodies.py')}.arrays"
    names = [[f"{i} {k}" for k in range(len(p))] for i, p in enumerate(hand.link_collision)]
    for content in contents(name):
        with contextlib.suppress(ValueError, KeyError):
            kept = unpack(bytearray(content))
            return tuple(tuple(kept[piece] for piece in pieces) for pieces in names)
    made = tuple(
        tuple(inset(piece, LINK_MARGIN_M) for piece in pieces) for pieces in hand.link_collision
    )
    packed = {
        piece: hull
        for pieces, hulls in zip(names, made, strict=True)
        for piece, hull in zip(pieces, hulls, strict=True)
    }
    write_kept(name, pack(packed))
    return made


def inset(piece: TriangleMesh, margin: float) -> Array:
    """Vertices (n, 3) of a convex polytope whose faces lie `margin` [m] further inside.

    Right to 0.02 mm, on the inner side. A piece that is no thicker than two margins keeps a tenth
    of its thickness: Bullet has it thicker than it is, by less than two margins. Some 10 ms.
    """
    hull = ConvexHull(piece.vertices)
    planes = hull.equations.copy()
    planes[:, 3] += margin
    # the point deepest in all half-spaces
    best = linprog(
        [0.0, 0.0, 0.0, -1.0],
        A_ub=np.column_stack([planes[:, :3], np.ones(len(planes))]),
        b_ub=-planes[:, 3],
        bounds=[(None, None)] * 4,
    )
    *middle, left = np.array(best.x, dtype=float)
    if left < _THINNEST_M:
        planes[:, 3] -= margin - 0.9 * (left + margin)
    corners = HalfspaceIntersection(planes, np.array(middle)).intersections
    return fewest_vertices(corners, _HULL_TOLERANCE_M)


def add_hand(
    client: BulletClient, hand: HandDescription, hulls: Sequence[Sequence[Array]], posture: Array
) -> HandBodies:
    """Put a hand into a client, its palm frame at the origin, fingers open.

    Its links do not collide with each other: the planner answers no grasp in which they would.

    Parameters
    ----------
    client : BulletClient
    hand : HandDescription
    hulls : hull vertices per link and piece
        Of :func:`link_hulls`.
    posture : (J,) array [rad]
        Of which only the pre-shape's joints count.
    """
    moving = [link for finger in hand.fingers for link in finger.links]
    joints = np.zeros(hand.n_joints)
    joints[hand.preshape.joints] = posture[hand.preshape.joints]
    poses = link_transforms(hand, joints)[0]
    link_of: dict[tuple[int, int], int] = {}
    for link in range(hand.n_links):
        if link in moving:
            continue
        position, quat_xyzw = to_position_quat_xyzw(poses[link])
        for hull in hulls[link]:
            body = client.createMultiBody(
                baseMass=0.0,
                baseCollisionShapeIndex=hull_shape(client, hull),
                basePosition=position,
                baseOrientation=quat_xyzw,
            )
            link_of[int(body), -1] = link
    positions: list[list[float]] = []
    orientations, parents, kinds = [], [], []
    for finger in hand.fingers:
        for number, link in enumerate(finger.links):
            T = hand.T_parent_joint[link]
            position, quat_xyzw = to_position_quat_xyzw(
                poses[finger.knuckle_link] @ T if number == 0 else T
            )
            parents.append(0 if number == 0 else len(positions))
            positions.append(position.tolist())
            orientations.append(quat_xyzw.tolist())
            slides = hand.joint_slides[hand.link_joint[link]]
            kinds.append(client.JOINT_PRISMATIC if slides else client.JOINT_REVOLUTE)
    n = len(moving)
    with ExitStack() as files:
        fingers = client.createMultiBody(
            baseMass=0.0,
            linkMasses=[float(hand.link_mass[link]) for link in moving],
            linkCollisionShapeIndices=[link_shape(client, hulls[link], files) for link in moving],
            linkVisualShapeIndices=[-1] * n,
            linkPositions=positions,
            linkOrientations=orientations,
            linkInertialFramePositions=[[0.0] * 3] * n,
            linkInertialFrameOrientations=[[0.0, 0.0, 0.0, 1.0]] * n,
            linkParentIndices=parents,
            linkJointTypes=kinds,
            linkJointAxis=[hand.joint_axis[link].tolist() for link in moving],
        )
    for body, _ in list(link_of):
        for index in range(n):
            client.setCollisionFilterPair(body, fingers, -1, index, 0)
    for index, link in enumerate(moving):
        link_of[int(fingers), index] = link
    joint_of = {int(hand.link_joint[link]): index for index, link in enumerate(moving)}
    return HandBodies(int(fingers), joint_of, link_of)


def link_shape(client: BulletClient, hulls: Sequence[Array], files: ExitStack) -> int:
    """The collision shape of a link: the hull of its vertices (n, 3), or a compound of several."""
    if len(hulls) == 1:
        return hull_shape(client, hulls[0])
    return files.enter_context(_compound(client, hulls, "link"))


@contextlib.contextmanager
def _compound(client: BulletClient, pieces: Sequence[Array], name: str) -> Iterator[int]:
    """A shape of several hulls; PyBullet reads its file again when it makes the body."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.obj"
        path.write_text(_obj_text(pieces))
        yield int(client.createCollisionShape(client.GEOM_MESH, fileName=str(path)))


def add_object(
    client: BulletClient, pieces: Sequence[Array], part: Part, mass: float, T_palm_object: Array
) -> int:
    """A movable body of convex pieces with a part's centre of mass and inertia, at a pose."""
    moments, axes = inertia_of(part)
    position = T_palm_object[:3, :3] @ part.center_of_mass + T_palm_object[:3, 3]
    quat_xyzw = Rotation.from_matrix(T_palm_object[:3, :3] @ axes).as_quat()
    moved = [(p - part.center_of_mass) @ axes for p in pieces]
    with _compound(client, moved, part.mesh.content_hash[:16]) as shape:
        body = client.createMultiBody(
            baseMass=mass,
            baseCollisionShapeIndex=shape,
            basePosition=position,
            baseOrientation=quat_xyzw,
        )
    set_mass(client, int(body), mass, moments)
    client.changeDynamics(
        body,
        -1,
        collisionMargin=OBJECT_MARGIN_M,
        linearDamping=0.0,
        angularDamping=0.0,
    )
    return int(body)


def set_mass(client: BulletClient, body: int, mass: float, moments: Array) -> None:
    """Give a body a mass [kg] and principal moments (3,) per mass [m^2]."""
    client.changeDynamics(body, -1, mass=mass, localInertiaDiagonal=(mass * moments).tolist())


def _obj_text(pieces: Sequence[Array]) -> str:
    """Wavefront text with one object per piece; PyBullet makes a hull of each."""
    lines, first = [], 1
    for index, piece in enumerate(pieces):
        lines.append(f"o piece_{index}")
        lines += [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in piece]
        faces = ConvexHull(piece, qhull_options="QJ").simplices + first
        lines += [f"f {a} {b} {c}" for a, b, c in faces]
        first += len(piece)
    return "\n".join(lines) + "\n"
