"""An answer's grasps as a table: quality, trials, approach, contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.cli.tables import Column

if TYPE_CHECKING:
    from gpis_grasp_planner.grasp.grasp import Grasp
    from gpis_grasp_planner.hand.description import HandDescription
    from gpis_grasp_planner.hand.finger import Finger
    from gpis_grasp_planner.plan.request import PlanResult

PALM = "P"
LEGEND = "Contacts: P palm, F1 first finger; its links k knuckle, i inner, d distal."
# Causes that are too long for a column.
_SHORT = {"lost while closing": "lost", "too few touch": "few touch"}


def grasp_columns(
    hand: HandDescription, grasps: Sequence[Grasp], verified: bool, objective: str = ""
) -> list[Column]:
    """One row per grasp.

    `verified`: trials were asked for, also where none was made. `objective`: the name of the
    measure that the search went by, whose column is kept before those of others.
    """
    trials = [trial_cells(grasp) for grasp in grasps]
    columns = [
        Column("#", [str(i) for i in range(len(grasps))]),
        Column("epsilon", [f"{grasp.epsilon:.4f}" for grasp in grasps]),
        Column("volume", [f"{grasp.volume:.4f}" for grasp in grasps], 2),
    ]
    measured = measured_columns(grasps)
    columns += [replace(measured.pop(objective), priority=2)] if objective in measured else []
    if verified:
        columns += [
            Column("holds", [holds for holds, _ in trials], 1, left=True),
            Column("slip [mm]", [slip for _, slip in trials], 5),
        ]
    if any(_hold_probability(grasp) is not None for grasp in grasps):
        columns.append(Column("P(hold)", [_probability(grasp) for grasp in grasps], 1))
    columns.append(Column("approach", [_vector(g.approach_direction, 5, 2) for g in grasps], 3))
    positions = [_vector(1e3 * grasp.T_object_palm[:3, 3], 6, 1) for grasp in grasps]
    if any(grasp.arm is not None for grasp in grasps):
        columns.append(Column("arm", [_manipulability(grasp) for grasp in grasps], 2))
    return [
        *columns,
        Column("contacts", [contact_code(hand, g.contacts.links) for g in grasps], 4, left=True),
        Column("palm at [mm]", positions, 6),
        Column("points", [str(len(grasp.contacts)) for grasp in grasps], 7),
        *measured.values(),
    ]


def measured_columns(grasps: Sequence[Grasp]) -> dict[str, Column]:
    """One column for each figure beside epsilon and volume that any of the grasps has."""
    names = dict.fromkeys(name for grasp in grasps for name in grasp.quality.measured)
    return {
        name: Column(name.replace("_", " "), [_figure(grasp, name) for grasp in grasps], 8)
        for name in names
    }


def _figure(grasp: Grasp, name: str) -> str:
    value = grasp.quality.measured.get(name)
    return "" if value is None else f"{value:.3f}"


def order_text(result: PlanResult) -> str:
    """By what the rows are ordered, see ``grasp.order.answer_rank``; and how they are counted."""
    rules = []
    if result.request.verification != "none":
        rules.append("held in physics")
    if any(_hold_probability(grasp) is not None for grasp in result.grasps):
        rules.append("P(hold)")
    weight = result.settings["hpp"]["volume_weight"]  # documents before figures had names
    objective = result.objective or f"epsilon + {weight:g} volume"
    balanced = result.settings["hpp"].get("balance_friction_share", 0.0) > 0.0
    rules.append(f"({objective}) x balance" if balanced else objective)
    return f"Best first by {', '.join(rules)}; # counts from 0."


def trials_text(grasps: Sequence[Grasp]) -> str:
    """What the column "holds" counts, and which trial decides; empty where nothing was tried."""
    names = [grasp.trials.outcomes[0].name for grasp in grasps if grasp.trials is not None]
    return (
        f"Holds: trials passed of those made; the first one decides: {names[0]}." if names else ""
    )


def trial_cells(grasp: Grasp) -> tuple[str, str]:
    """What physics said: trials passed of those made, or the cause; and the largest slip."""
    trials = grasp.trials
    if trials is None:
        return "not tried", ""
    if not trials.held:
        cause = trials.outcomes[0].cause
        return _SHORT.get(cause, cause), ""
    return f"{trials.n_passed} of {len(trials.outcomes)}", f"{1e3 * trials.largest_slip_m:.1f}"


def contact_code(hand: HandDescription, links: NDArray[np.integer]) -> str:
    """Which links touch, such as ``P F1d F2id``: palm, then each finger with its links.

    Links of no finger are written by their names, a finger of one link by its own alone.
    """
    touching = {int(link) for link in links}
    words = []
    for link in sorted(touching):
        name = hand.link_names[link]
        if name == hand.palm_link:
            words.append(PALM)
        elif not any(link in _links(finger) for finger in hand.fingers):
            words.append(name)
    for finger in hand.fingers:
        found = [link in touching for link in _links(finger)]
        if any(found):
            letters = _letters(len(finger.links))
            touched = [letter for letter, here in zip(letters, found, strict=True) if here]
            words.append(finger.name + "".join(touched))
    return " ".join(words)


def _letters(n_links: int) -> list[str]:
    """Of a finger's knuckle and links; links between the first and the last are numbered."""
    if n_links == 1:
        return ["k", ""]
    between = ["m"] if n_links == 3 else [f"m{k}" for k in range(1, n_links - 1)]
    return ["k", "i", *between, "d"]


def _links(finger: Finger) -> tuple[int, ...]:
    return finger.knuckle_link, *finger.links


def _vector(values: NDArray[np.float64], width: int, digits: int) -> str:
    # Adding 0 after rounding: no minus before a zero.
    return " ".join(f"{round(float(x), digits) + 0.0:{width}.{digits}f}" for x in values)


def _hold_probability(grasp: Grasp) -> float | None:
    """By trials where there is an estimate, else by the contacts under the pose's covariance."""
    estimate = grasp.hold_estimate
    return grasp.hold_probability if estimate is None else estimate.probability


def _probability(grasp: Grasp) -> str:
    probability = _hold_probability(grasp)
    return "" if probability is None else f"{probability:.2f}"


def _manipulability(grasp: Grasp) -> str:
    """Share of the arm's largest manipulability."""
    return "" if grasp.arm is None else f"{grasp.arm.manipulability:.2f}"
