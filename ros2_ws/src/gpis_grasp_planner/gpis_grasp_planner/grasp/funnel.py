"""Where grasps get lost: from the hands that were proposed to the grasps that held, by cause.

The steps are in the order in which a hand meets them. Only the losses are counted; how many are
left after a step is what was proposed less all that was lost until then, so that the steps add up
and no step can have more than the one before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum


class Step(StrEnum):
    """What a hand has to pass, in this order.

    The surroundings are asked as soon as a grasp has force closure, before it is known whether it
    is one of the answer's: therefore `CLEAR` comes before `DISTINCT`.
    """

    PROPOSED = "proposed"
    PALM_FREE = "palm free"
    CLOSED = "closed"
    ENOUGH_CONTACTS = "enough contacts"
    FORCE_CLOSURE = "force closure"
    CLEAR = "clear"
    DISTINCT = "distinct"
    CONFIRMED = "confirmed"
    TRIED = "tried"
    HELD = "held"


class Loss(StrEnum):
    """Causes that are no constraint's, no obstacle's and no trial's."""

    DEEP = "no free place along the normal"
    PALM = "open hand in the part"
    ITSELF = "hand meets itself"
    NOTHING = "nothing touched"
    ONE = "only one contact"
    SLACK = "no force closure"
    WAY_BACK = "part in the way back"
    NEAR = "near a better one"
    BEYOND = "beyond those looked at"
    INEXACT = "no force closure, exactly"
    MARGIN = "too near to the surroundings"
    SCENE = "PyBullet's scene disagrees"
    NO_TIME = "no time left"


# Of the palm, by the part itself; other causes of that step are names of constraints.
_BY_PART = frozenset({str(Loss.DEEP), str(Loss.PALM)})


@dataclass(frozen=True)
class Funnel:
    """How many hands passed each step, and why the others did not.

    Attributes
    ----------
    proposed : int
        Palm poses; the same hand moved a little, to be freed, is another proposal.
    lost : mapping of (Step, cause) to int
    last : Step
        The last that was asked for: `CONFIRMED` without trials, `CLEAR` for an answer from memory.

    Raises
    ------
    ValueError
        Where more was lost than there was, or something at no step.
    """

    proposed: int = 0
    lost: Mapping[tuple[Step, str], int] = field(default_factory=dict)
    last: Step = Step.CONFIRMED

    def __post_init__(self) -> None:
        order = list(Step)
        if any(
            n <= 0 or step is Step.PROPOSED or order.index(step) > order.index(self.last)
            for (step, _), n in self.lost.items()
        ):
            raise ValueError(f"Losses are positive, and of the steps up to '{self.last}'.")
        if self.proposed < sum(self.lost.values()):
            raise ValueError(
                f"{sum(self.lost.values())} were lost of {self.proposed} that were proposed."
            )

    @property
    def steps(self) -> tuple[Step, ...]:
        """Those that were asked for, in their order."""
        order = list(Step)
        return tuple(order[: order.index(self.last) + 1])

    def left(self, step: Step) -> int:
        """How many passed this step and all before it."""
        done = self.steps[: self.steps.index(step) + 1]
        return self.proposed - sum(n for (at, _), n in self.lost.items() if at in done)

    def causes(self, step: Step) -> dict[str, int]:
        """Why hands were lost at a step, most frequent first."""
        found = [(cause, n) for (at, cause), n in self.lost.items() if at is step]
        return dict(sorted(found, key=lambda pair: (-pair[1], pair[0])))

    @property
    def table(self) -> tuple[tuple[Step, int, dict[str, int]], ...]:
        """Each step, how many passed it, and the causes of the others."""
        return tuple((step, self.left(step), self.causes(step)) for step in self.steps)

    @classmethod
    def of_table(cls, table: Iterable[tuple[str, int, Mapping[str, int]]]) -> Funnel:
        """From :attr:`table`.

        Raises
        ------
        ValueError
            For steps that are unknown, out of order or missing, and counts that do not add up.
        """
        rows = list(table)
        order = list(Step)[: len(rows)]
        if not rows or [step for step, _, _ in rows] != order:
            raise ValueError(f"The steps are {', '.join(Step)}, in this order from the first.")
        lost = {(Step(step), cause): n for step, _, causes in rows for cause, n in causes.items()}
        funnel = cls(rows[0][1], lost, order[-1])
        for step, left, _ in rows:
            if funnel.left(Step(step)) != left:
                raise ValueError(
                    f"{left} are said to be left at '{step}', {funnel.left(Step(step))} are left "
                    "by the losses."
                )
        return funnel

    @property
    def blocked(self) -> dict[str, int]:
        """Grasps with force closure that the surroundings or the request forbid, by cause."""
        found = self.causes(Step.CLEAR)
        return {cause: n for cause, n in found.items() if cause != Loss.WAY_BACK}

    @property
    def screened(self) -> dict[str, int]:
        """Hands that a constraint did not let close, by its name."""
        found = self.causes(Step.PALM_FREE)
        return {cause: n for cause, n in found.items() if cause not in _BY_PART}

    @property
    def main_loss(self) -> tuple[Step, str] | None:
        """The step that the smallest share passed, and its main cause; None where all passed.

        Not of those that only choose (`DISTINCT`, `TRIED`), unless nothing passed them.
        """
        worst: tuple[float, Step] | None = None
        for before, step in zip(self.steps, self.steps[1:], strict=False):
            had, has = self.left(before), self.left(step)
            if not had or (has and step in (Step.DISTINCT, Step.TRIED)):
                continue
            if has < had and (worst is None or has / had < worst[0]):
                worst = (has / had, step)
        if worst is None:
            return None
        return worst[1], next(iter(self.causes(worst[1])))
