"""The table lift: the closed hand takes the part 0.2 m up under gravity and shakes it by 3 cm.

In the frame of the palm, where the simulation runs, a moving hand is an acceleration of the part:
gravity minus the palm's own acceleration, and nothing else as long as the palm does not turn. The
table itself is not simulated; the part stands on it until the hand has closed.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.verification.motion import NO_MOTION
from gpis_grasp_planner.verification.protocol import Verifier
from gpis_grasp_planner.verification.trial_world import TrialWorld

Array = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
_LIFT_S = 1.0
_HOLD_S = 1.0
_SHAKE_S = 0.5
_INTERVAL_S = 1.0 / 60.0


@dataclass(frozen=True)
class LiftResult:
    """Whether the part stayed in the hand, and how far it went relative to the palm."""

    held: bool
    cause: str
    slip_m: float
    rotation_rad: float
    simulated_s: float
    elapsed_s: float


def lift_accelerations(up: Array, lift_m: float, shake_m: float) -> Array:
    """Acceleration (n, 3) [m/s^2] of the part in the palm's frame, every 1/60 s.

    A lift ``h = H (s - sin(2 pi s) / (2 pi))`` along `up` in 1 s and a rest of 1 s, then along
    each of three axes, the first of them `up`, a shake ``x = A / 2 (1 - cos(4 pi s))``: twice out
    by A and back in 0.5 s, 9.5 m/s^2 at most for 3 cm. All begin and end at rest.
    """
    up = up / np.linalg.norm(up)
    side = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    n_lift, n_hold, n_shake = (round(t / _INTERVAL_S) for t in (_LIFT_S, _HOLD_S, _SHAKE_S))
    s = (np.arange(n_lift) + 0.5) / n_lift
    lift = 2.0 * np.pi * lift_m / _LIFT_S**2 * np.sin(2.0 * np.pi * s)
    s = (np.arange(n_shake) + 0.5) / n_shake
    shake = 0.5 * shake_m * (4.0 * np.pi / _SHAKE_S) ** 2 * np.cos(4.0 * np.pi * s)
    palm = np.concatenate(
        [
            lift[:, None] * up,
            np.zeros((n_hold, 3)),
            *(shake[:, None] * axis for axis in (up, side, np.cross(up, side))),
        ]
    )
    return -GRAVITY_M_S2 * up - palm


def verify_lift(verifier: Verifier, grasp: Grasp, up_in_part: Array) -> LiftResult:
    """Lift a part by a grasp and shake it, in each of the verifier's engines.

    Parameters
    ----------
    verifier : Verifier
        Entered, of the part.
    grasp : Grasp
    up_in_part : (3,) array
        Which way is up, in the part's frame.
    """
    results = []
    for world in verifier.worlds:
        results.append(_lift_in(world, verifier, grasp, up_in_part))
        if not results[-1].held:
            break
    return results[-1]


def _lift_in(world: TrialWorld, verifier: Verifier, grasp: Grasp, up_in_part: Array) -> LiftResult:
    start, settings = time.perf_counter(), verifier.settings
    failed = LiftResult(False, "not closed", 0.0, 0.0, 0.0, 0.0)
    if not verifier.close_on(world, grasp.T_object_palm, grasp):
        return replace(failed, elapsed_s=time.perf_counter() - start)
    world.release()
    before = world.part_pose()
    up = grasp.T_object_palm[:3, :3].T @ np.asarray(up_in_part, dtype=float)
    largest, simulated = NO_MOTION, 0.0
    cause = ""
    for acceleration in lift_accelerations(up, settings.lift_m, settings.shake_m):
        simulated += world.run(_INTERVAL_S, acceleration)
        now = world.motion_since(before)
        largest = largest.larger(now)
        if not now.within(settings):
            cause = "slipped"
            break
    return LiftResult(
        held=not cause,
        cause=cause,
        slip_m=largest.slip_m,
        rotation_rad=largest.rotation_rad,
        simulated_s=simulated,
        elapsed_s=time.perf_counter() - start,
    )
