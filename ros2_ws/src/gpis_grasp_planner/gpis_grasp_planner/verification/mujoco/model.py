"""Hand and part as a MuJoCo model, made from the hand's description.

The world's frame is the palm. Knuckles are bodies of their own, so that a model that is compiled
once takes every pre-shape: their poses are set in the model. Each moving joint has a motor that
goes at a speed with a torque at most, and friction for gears that hold. Hand links do not meet each
other: the planner answers no grasp in which they would.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.transforms import to_position_quat_xyzw
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.preshape import SLIDING_LEVER_M

Array = NDArray[np.float64]

# Soft contacts of this time constant [s] sink in by some hundredths of a millimetre under the
# forces of a hand; a stiffer one needs shorter steps.
_CONTACT_TIME_S = 0.004
_CONTACT_IMPEDANCE = (0.95, 0.99, 0.0005, 0.5, 2.0)
# Friction is this much stiffer than contact, so that a held part does not creep.
_FRICTION_STIFFNESS = 20.0
_NO_SLIP_ITERATIONS = 5
# Inertia of a motor and its gears at the joint [kg m^2]: a rotor of some 1e-6 behind a ratio of
# 100. A link of grams between two contacts would be no well-posed problem.
_ARMATURE = 0.01
_HAND, _PART, _PLANE = 1, 2, 4


def link_body(link: int) -> str:
    """Name of a link's body."""
    return f"link {link}"


PART_BODY = "part"
PLANE_GEOM = "plane"
FAR_BELOW = (0.0, 0.0, -1e3)  # where nothing meets the plane: what may meet is fixed for good
# MuJoCo remembers of a geom that is parallel to its body that it is, and then never turns it.
_NOT_PARALLEL = (0.9987502604, 0.05, 0.0, 0.0)


def build_model(
    hand: HandDescription,
    pieces: Sequence[Array],
    moments: Array,
    step_s: float,
    hull: Array | None = None,
) -> mujoco.MjModel:
    """Compile a model of a hand and of a free part of 1 kg.

    Parameters
    ----------
    hand : HandDescription
    pieces : sequence of (n, 3) arrays [m]
        Convex pieces of the part, in the frame of its principal axes at the centre of mass.
    moments : (3,) array [m^2]
        Principal moments of inertia per mass.
    step_s : float
    hull : (k, 3) array [m], optional
        Corners of the whole part's hull, in the pieces' frame: with it there is a plane, which
        nothing but the hull meets. It must have a volume.

    Returns
    -------
    mujoco.MjModel
        Bodies :func:`link_body` and :data:`PART_BODY`; motors in the order of the moving joints.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = step_s
    spec.option.gravity = (0.0, 0.0, 0.0)
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.impratio = _FRICTION_STIFFNESS
    spec.option.noslip_iterations = _NO_SLIP_ITERATIONS
    bodies: list[mujoco.MjsBody] = []
    for link in range(hand.n_links):
        parent = int(hand.link_parent[link])
        body = (spec.worldbody if parent < 0 else bodies[parent]).add_body(name=link_body(link))
        bodies.append(body)
        if parent >= 0:
            _set_pose(body, hand.T_parent_joint[link])
        for number, piece in enumerate(hand.link_collision[link]):
            name = f"link {link}, {number}"
            _add_hull(spec, body, name, piece.vertices, _HAND)
        joint = int(hand.link_joint[link])
        if joint >= 0 and joint not in hand.preshape.joints:
            _add_joint(spec, body, hand, link)
    part = spec.worldbody.add_body(name=PART_BODY)
    part.add_freejoint()
    part.explicitinertial = True
    part.mass, part.inertia = 1.0, moments
    for number, points in enumerate(pieces):
        _add_hull(spec, part, f"piece {number}", points, _PART)
    if hull is not None:
        _add_plane(spec, part, hull)
    return spec.compile()


def _add_plane(spec: mujoco.MjSpec, part: mujoco.MjsBody, hull: Array) -> None:
    """A plane far away. What lies on it touches it with corners of its hull, not with pieces."""
    _add_hull(spec, part, "hull", hull, _PLANE)
    spec.worldbody.add_geom(
        name=PLANE_GEOM,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(0.0, 0.0, 1.0),
        pos=FAR_BELOW,
        quat=_NOT_PARALLEL,
        contype=0,
        conaffinity=_PLANE,
        condim=3,
        priority=2,
        solref=(_CONTACT_TIME_S, 1.0),
        solimp=_CONTACT_IMPEDANCE,
    )


def _set_pose(body: mujoco.MjsBody, T: Array) -> None:
    position, quat_xyzw = to_position_quat_xyzw(T)
    body.pos, body.quat = position, np.roll(quat_xyzw, 1)


def _add_joint(spec: mujoco.MjSpec, body: mujoco.MjsBody, hand: HandDescription, link: int) -> None:
    joint = int(hand.link_joint[link])
    name = hand.joint_names[joint]
    slides = bool(hand.joint_slides[joint])
    # a rotor behind a pinion of the lever that counts as 1 rad
    armature = _ARMATURE / SLIDING_LEVER_M**2 if slides else _ARMATURE
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
        axis=hand.joint_axis[link],
        armature=armature,
    )
    body.explicitinertial = True
    body.mass = float(hand.link_mass[link])
    body.inertia = np.full(3, 1e-6)
    motor = spec.add_actuator(
        name=name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=name,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        forcelimited=True,
        forcerange=(-1.0, 1.0),
    )
    # At most what turns the rotor to its speed in one step: a motor at its limit does not chatter.
    motor.gainprm[0] = armature / spec.option.timestep
    motor.biasprm[2] = -motor.gainprm[0]


def _add_hull(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, points: Array, group: int
) -> None:
    spec.add_mesh(
        name=name,
        uservert=np.asarray(points, dtype=float).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        contype=group,
        conaffinity=0 if group == _PLANE else _HAND + _PART - group,
        condim=3,
        priority=int(group == _HAND),  # the friction of the pair is the link's
        solref=(_CONTACT_TIME_S, 1.0),
        solimp=_CONTACT_IMPEDANCE,
        density=0.0,
    )
