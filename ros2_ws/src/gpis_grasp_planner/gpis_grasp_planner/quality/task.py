"""Task wrench spaces: how much of a wanted task a grasp can do.

A task is the hull of a few loads that act on the part in the hand: its weight, what a hole pushes
back with, what a screw turns back with. The figure is the largest multiple of the task's loads that
contact forces with normal parts of 1 in sum balance, the worst of the loads counting (Borst,
Fischer and Hirzinger, Grasp Planning: How to Choose a Suitable Task Wrench Space, ICRA 2004,
for the L1 wrench space):

``min over loads l of max t,  sum_i a_i w_i = -t l,  sum_i a_i = 1,  a_i >= 0``

A load of F newtons thus takes F / margin newtons of normal forces in sum.

Written as ``KIND X Y Z [at X Y Z]``, several joined by `+`:

- ``lift 0 0 1``: the part is carried, up is (0, 0, 1); the load is its weight
- ``insert 0 0 -1 at 0 0 -0.04``: the part is pushed along the axis; what it is pushed into pushes
  back at that point
- ``turn 0 0 1``: the part is turned about the axis; the load turns back
- ``screw 0 0 1 at 0 0 0.05``: pushed along and turned about the axis

All in the part's frame; `at` is a point of it [m], without it the centre of mass. The unit load of
a torque is 1 N at the part's largest radius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.quality.figures import Figure
from gpis_grasp_planner.quality.linear_programme import OPTIMAL, solve
from gpis_grasp_planner.quality.measure import HeldPart, Measure

Array = NDArray[np.float64]

FIGURE = Figure(
    "task",
    "N/N",
    True,
    "Largest load of the wanted task (objective.task) that the contacts balance, over their "
    "normal forces in sum.",
    "Ray shooting in the L1 wrench space; Borst, Fischer and Hirzinger, ICRA 2004.",
)
# Whether the load has a force against the axis, and a torque against it.
KINDS = {"lift": (True, False), "insert": (True, False), "turn": (False, True),
         "screw": (True, True)}  # fmt: skip
_FORM = "'KIND X Y Z' or 'KIND X Y Z at X Y Z', joined by '+', such as 'lift 0 0 1'"


@dataclass(frozen=True)
class Task:
    """One wanted action on the part.

    Attributes
    ----------
    kind : str
        One of ``KINDS``.
    axis : (3,) tuple
        Unit vector in the part's frame.
    at : (3,) tuple [m] or None
        Where the load acts; None: at the centre of mass.
    """

    kind: str
    axis: tuple[float, float, float]
    at: tuple[float, float, float] | None = None

    def loads(self, center_of_mass: Array, torque_scale: float) -> list[Array]:
        """Wrenches (6,) about the centre of mass that the grasp has to balance."""
        against = -np.array(self.axis)
        has_force, has_torque = KINDS[self.kind]
        arm = np.zeros(3) if self.at is None else np.array(self.at) - center_of_mass
        found = []
        if has_force:
            found.append(np.concatenate([against, np.cross(arm, against) / torque_scale]))
        if has_torque:
            found.append(np.concatenate([np.zeros(3), against]))
        return found


def read_tasks(text: str) -> tuple[Task, ...]:
    """The actions of a text; see the module's text for its form.

    Raises
    ------
    RequestError
        INVALID_SETTING with the part of the text that is wrong.
    """
    return tuple(_read(part.strip(), text) for part in text.split("+"))


def _read(part: str, text: str) -> Task:
    words = part.split()
    if not words or words[0] not in KINDS:
        raise _wrong(text, f"'{part}' begins with none of {', '.join(KINDS)}")
    kind, *rest = words
    with_point = len(rest) == 7 and rest[3] == "at"
    if len(rest) != 3 and not with_point:
        raise _wrong(text, f"'{part}' is not of that form")
    try:
        numbers = [float(word) for word in rest if word != "at"]
    except ValueError as error:
        raise _wrong(text, str(error)) from None
    if not all(math.isfinite(number) for number in numbers):
        raise _wrong(text, f"'{part}' has a number that is not finite")
    length = math.hypot(*numbers[:3])
    if length < 1e-9:
        raise _wrong(text, f"the axis of '{part}' has no length")
    x, y, z = (number / length for number in numbers[:3])
    at = (numbers[3], numbers[4], numbers[5]) if with_point else None
    return Task(kind, (x, y, z), at)


def _wrong(text: str, why: str) -> RequestError:
    return RequestError(f"The task is '{text}': {why}. Write it as {_FORM}.")


def margin_of(wrenches: Array, loads: list[Array]) -> float:
    """Largest multiple of all loads (6,) that wrenches (n, 6) balance; 0 where they do not."""
    n = len(wrenches)
    A = np.zeros((7, n + 1))
    A[:6, :n] = wrenches.T
    A[6, :n] = 1.0
    b, c = np.zeros(7), np.zeros(n + 1)
    b[6] = c[n] = 1.0
    least = math.inf
    for load in loads:
        A[:6, n] = load
        status, value, _ = solve(A, b, c)
        least = min(least, value if status == OPTIMAL else 0.0)
    return least


def task_measure(text: str) -> Measure:
    """The measure of a task by its text."""
    tasks = read_tasks(text)

    def of(held: HeldPart) -> float:
        loads = [
            load for task in tasks for load in task.loads(held.center_of_mass, held.torque_scale)
        ]
        return margin_of(held.wrenches, loads)

    return Measure(FIGURE, of)
