"""Which grasp is tried next, so that the trials go where they decide the order of an answer.

A race in the manner of best-arm identification: each grasp is an arm with a Beta posterior over
its probability to hold, and the arm with the highest upper bound is tried (Bayes-UCB, E. Kaufmann
et al., AISTATS 2012, with a constant quantile). Every other trial goes to a grasp that was not
tried yet, for an answer has more than one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gpis_grasp_planner.verification.hold_model import BetaPosterior

# Quantile of the upper bound. In simulated races 0.6 to 0.95 find equally good grasps.
_UPPER = 0.8


@dataclass(frozen=True, eq=False)
class Arm:
    """A grasp in the race.

    Attributes
    ----------
    posterior : BetaPosterior
        Over its probability to hold.
    n_made, n_left : int
        Cases that were made, and were not; none is left where it is out of the race.
    busy : bool
        A trial of it runs.
    """

    posterior: BetaPosterior
    n_made: int
    n_left: int
    busy: bool = False


def next_arm(arms: Sequence[Arm], turn: int) -> int | None:
    """Index of the arm that is tried next; None where there is nothing to try.

    Parameters
    ----------
    arms : sequence of Arm
        Best first by what else is known: the first of equals is taken.
    turn : int
        Counts trials: odd ones are of arms that were not tried yet, where there are any.
    """
    ready = [i for i, arm in enumerate(arms) if arm.n_left and not arm.busy]
    if not ready:
        return None
    if turn % 2:
        for i in ready:
            if not arms[i].n_made:
                return i
    return min(ready, key=lambda i: (-arms[i].posterior.quantile(_UPPER), i))
