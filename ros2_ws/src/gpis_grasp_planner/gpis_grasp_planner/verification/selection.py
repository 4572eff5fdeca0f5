"""From finalists and reserve to the answer by what physics says of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.order import answer_rank
from gpis_grasp_planner.grasp.reserve import Reserve
from gpis_grasp_planner.grasp.trials import Trials
from gpis_grasp_planner.surroundings.clearance import clear_grasps
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import Surroundings
from gpis_grasp_planner.verification.cases import TrialCase
from gpis_grasp_planner.verification.finalist_trials import FinalistTrials, place_of


@dataclass(frozen=True, eq=False)
class Selection:
    """Grasps after their trials.

    Attributes
    ----------
    ranked : tuple of Grasp
        All finalists, and those of the reserve that held, best first (`answer_rank`), with exact
        quality.
    further : Reserve
        The rest of the reserve, with the trials of those that did not hold.
    """

    ranked: tuple[Grasp, ...]
    further: Reserve

    @property
    def held(self) -> tuple[Grasp, ...]:
        """Those that were seen to hold."""
        return tuple(g for g in self.ranked if g.trials is not None and g.trials.held)

    @property
    def n_tried(self) -> int:
        """How many were tried."""
        return len(self._tried)

    def split(self, n_grasps: int, only_held: bool) -> tuple[tuple[Grasp, ...], Reserve]:
        """An answer of at most `n_grasps`, and everything else as its reserve."""
        answer = (self.held if only_held else self.ranked)[:n_grasps]
        chosen = set(map(id, answer))
        rest = tuple(g for g in self.ranked if id(g) not in chosen)
        reserve = Reserve(
            (*rest, *self.further.estimates),
            self.further.center_of_mass,
            self.further.torque_scale,
            self.further.cone_edges,
        )
        return answer, reserve

    @property
    def note(self) -> str:
        """How many were tried, and how many of those held."""
        tried = self._tried
        untried = sum(grasp.trials is None for grasp in self.ranked)
        return (
            f"In physics {len(self.held)} of {len(tried)} grasps tried held; {untried} of the best "
            "were not tried within the budget."
        )

    @property
    def why_none(self) -> str:
        """Causes and their numbers, for the case that nothing held."""
        tried = self._tried
        if not tried:
            return "none could be tried within the budget"
        causes = Counter(grasp.trials.outcomes[0].cause for grasp in tried if grasp.trials)
        return ", ".join(f"{cause} {n}" for cause, n in causes.most_common())

    @property
    def known(self) -> dict[bytes, Trials]:
        """Trials by the grasp they were made of, for :func:`select`."""
        return {place_of(g): g.trials for g in self._tried if g.trials is not None}

    @property
    def _tried(self) -> list[Grasp]:
        return [g for g in (*self.ranked, *self.further.estimates) if g.trials is not None]


def select(
    trials: FinalistTrials,
    cases: Sequence[TrialCase],
    finalists: Sequence[Grasp],
    reserve: Reserve,
    volume_weight: float,
    deadline: float | None,
    should_stop: Callable[[], bool] | None = None,
    around: Surroundings | None = None,
    clearance: ClearanceSettings | None = None,
    known: Mapping[bytes, Trials] | None = None,
) -> Selection:
    """Try finalists, then the reserve, and rank them.

    Parameters
    ----------
    trials : FinalistTrials
    cases : sequence of TrialCase
    finalists : sequence of Grasp
        Best first, with exact quality.
    reserve : Reserve
    volume_weight : float
        Lambda of the ranking.
    deadline : float or None
        Time of ``time.monotonic``; None tries each finalist once, and nothing of the reserve.
    should_stop : callable, optional
    around : Surroundings, optional
        Of the part's present place, in its frame: grasps that are clear of it are tried first, all
        others only if there is time. (50 ms.)
    clearance : ClearanceSettings, optional
    known : mapping, optional
        :attr:`Selection.known` of an earlier choice: those grasps are not tried again.
    """
    known = known or {}
    candidates = [*finalists, *(reserve.estimates if deadline is not None else ())]
    order = list(range(len(candidates)))
    if around and candidates:
        found = clear_grasps(trials.hand, candidates, around, clearance or ClearanceSettings())
        order.sort(key=lambda i: not found[i].clear)
    of = {i: known.get(place_of(grasp)) for i, grasp in enumerate(candidates)}
    order = [i for i in order if of[i] is None]
    outcomes = trials.run(
        [candidates[i] for i in order],
        cases if deadline is not None else cases[:1],
        deadline,
        should_stop,
    )
    of.update(zip(order, outcomes, strict=True))
    n = len(finalists)
    ranked = [replace(grasp, trials=of[i]) for i, grasp in enumerate(finalists)]
    further: list[Grasp] = []
    for k, grasp in enumerate(reserve.estimates):
        of_grasp = of.get(n + k)
        if of_grasp is not None and of_grasp.held:
            ranked.append(replace(reserve.exact(k), trials=of_grasp))
        else:
            further.append(replace(grasp, trials=of_grasp))
    ranked.sort(key=lambda grasp: answer_rank(grasp, volume_weight))
    left = Reserve(tuple(further), reserve.center_of_mass, reserve.torque_scale, reserve.cone_edges)
    return Selection(tuple(ranked), left)
