"""The table of an answer's grasps: every figure readable in 80 columns and in pipes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from terminal_sessions import in_pipe, in_terminal

from gpis_grasp_planner.cli.grasp_table import (
    LEGEND,
    contact_code,
    grasp_columns,
    order_text,
    trial_cells,
    trials_text,
)
from gpis_grasp_planner.cli.main import main
from gpis_grasp_planner.cli.tables import fitting, table_text
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.document import read_document
from gpis_grasp_planner.plan.request import PlanResult

HAND = load_hand()
CAUSES = (
    "collision", "penetration", "not closed", "too few touch", "lost while closing", "slipped",
)  # fmt: skip

QUICK = (
    *("plan", "sphere", "--planner", "random-adaption", "--evaluations", 192, "--time", 120),
    *("--grasps", 2, "--friction", 0.8),
)


def tried(passed: bool, cause: str = "", slip_m: float = 0.0) -> Trials:
    return Trials((TrialOutcome("strict", passed, cause, slip_m),) * (4 if passed else 1))


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> PlanResult:
    file = tmp_path_factory.mktemp("table") / "grasps.json"
    assert main([*map(str, QUICK), "--verify", "none", "--json", str(file)]) == 0
    return read_document(file).result


@pytest.fixture(scope="module")
def grasps(result: PlanResult) -> tuple[Grasp, ...]:
    """Twelve variants of a planned grasp with the widest cells that there are."""
    grasp = result.grasps[0]
    verdicts = [None, tried(True, slip_m=0.0248), *(tried(False, cause) for cause in CAUSES)]
    turn = np.eye(4)
    turn[:3, 3] = (-0.1234, -0.2345, -0.0001)
    return (
        tuple(
            replace(grasp, trials=verdict, hold_probability=0.25, T_object_palm=turn)
            for verdict in verdicts
        )
        + (grasp,) * 4
    )


def cells(text: str, heading: str) -> list[str]:
    """The cells under a heading, cut where the rule under it says."""
    lines = text.splitlines()
    [span] = [
        m.span() for m in re.finditer("-+", lines[1]) if heading in lines[0][slice(*m.span())]
    ]
    return [line[slice(*span)].strip() for line in lines[2:]]


@pytest.mark.parametrize("verified", [False, True])
@pytest.mark.parametrize("width", [79, 99, 139, None])
def test_every_figure_is_whole_in_every_width(
    grasps: tuple[Grasp, ...], width: int | None, verified: bool
) -> None:
    columns = grasp_columns(HAND, grasps, verified)
    text = table_text(columns, width)
    lines = text.splitlines()
    assert "…" not in text
    assert len(lines) == 2 + len(grasps)
    assert all(line == line.rstrip() for line in lines)
    assert width is None or max(map(len, lines)) <= width
    assert cells(text, "#") == [str(i) for i in range(len(grasps))]
    for heading, values in [
        ("epsilon", [f"{g.epsilon:.4f}" for g in grasps]),
        ("volume", [f"{g.volume:.4f}" for g in grasps]),
    ]:
        assert cells(text, heading) == values
    directions = [[float(x) for x in cell.split()] for cell in cells(text, "approach")]
    assert np.allclose(directions, [g.approach_direction for g in grasps], atol=0.0051)
    if verified:
        assert cells(text, "holds")[:2] == ["not tried", "4 of 4"]


def test_eighty_columns_have_what_one_chooses_by(grasps: tuple[Grasp, ...]) -> None:
    certain = tuple(replace(grasp, hold_probability=None) for grasp in grasps)
    shown = {column.heading for column in fitting(grasp_columns(HAND, certain, True), 79)}
    assert shown >= {"#", "epsilon", "volume", "holds", "approach", "contacts"}


def test_a_wide_terminal_and_a_pipe_have_everything(grasps: tuple[Grasp, ...]) -> None:
    columns = grasp_columns(HAND, grasps, True)
    assert fitting(columns, 169) == fitting(columns, None) == columns
    assert fitting(columns, 139) == columns[:-1]  # but what is the last of what is reported
    assert [column.heading for column in columns[-2:]] == ["min weight", "least friction"]


def test_the_objectives_figure_is_kept_before_others(grasps: tuple[Grasp, ...]) -> None:
    columns = grasp_columns(HAND, grasps, True, "least_friction")
    shown = {column.heading: column for column in fitting(columns, 79)}
    assert "min weight" not in shown
    expected = [f"{grasp.quality.measured['least_friction']:.3f}" for grasp in grasps]
    assert shown["least friction"].cells == expected


def test_signs_stand_below_each_other(grasps: tuple[Grasp, ...]) -> None:
    [position] = [c for c in grasp_columns(HAND, grasps, False) if c.heading == "palm at [mm]"]
    assert position.cells[0] == "-123.4 -234.5   -0.1"
    assert len({len(cell) for cell in position.cells}) == 1
    assert "-0.00" not in " ".join(
        cell for c in grasp_columns(HAND, grasps, False) for cell in c.cells
    )


@pytest.mark.parametrize(
    ("links", "code"),
    [
        (["bh_palm_link"], "P"),
        (["bh_finger_3_knuckle_link", "bh_finger_1_distal_link"], "F1d F3k"),
        (["bh_finger_2_distal_link", "bh_palm_link", "bh_finger_2_inner_link"], "P F2id"),
    ],
)
def test_contacts_as_code(links: list[str], code: str) -> None:
    numbers = np.array([HAND.link_names.index(link) for link in links] * 2)
    assert contact_code(HAND, numbers) == code


def test_a_link_of_no_finger_has_its_name() -> None:
    names = (*HAND.link_names[:-1], "guard")
    fingers = tuple(replace(finger, links=(1, 1)) for finger in HAND.fingers)
    hand = replace(HAND, link_names=names, fingers=fingers)
    assert contact_code(hand, np.array([len(names) - 1])) == "guard"


@pytest.mark.parametrize("cause", CAUSES)
def test_a_cause_is_said_in_the_column(cause: str, grasps: tuple[Grasp, ...]) -> None:
    word, slip = trial_cells(replace(grasps[0], trials=tried(False, cause)))
    assert word in cause
    assert len(word) <= 11
    assert slip == ""


def test_the_trial_that_decides_is_named(grasps: tuple[Grasp, ...]) -> None:
    assert trials_text([replace(grasp, trials=None) for grasp in grasps]) == ""
    assert trials_text(grasps) == (
        "Holds: trials passed of those made; the first one decides: strict."
    )


def test_the_command_in_a_terminal_of_80_columns() -> None:
    code, text = in_terminal(80, *QUICK)
    assert code == 0
    lines = text.splitlines()
    assert "…" not in text
    assert max(map(len, lines)) < 80
    assert cells("\n".join(lines[:4]), "#") == ["0", "1"]
    assert all(re.fullmatch(r"0\.\d{4}", cell) for cell in cells("\n".join(lines[:4]), "epsilon"))
    assert lines[4] == ""
    assert lines[5].startswith("Best first by held in physics, P(hold), (epsilon + ")
    assert LEGEND in lines


def test_the_command_in_a_pipe() -> None:
    done = in_pipe(*QUICK, "--verify", "none")
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert all(line == line.rstrip() for line in lines)
    assert "holds" not in lines[0]
    assert cells("\n".join(lines[:4]), "points")
    assert lines[5].startswith("Best first by (epsilon + ")
    assert "\x1b" not in done.stdout + done.stderr


def test_the_order_names_what_counts(result: PlanResult) -> None:
    uncertain = tuple(replace(g, hold_probability=0.5) for g in result.grasps)
    weight = result.settings["hpp"]["volume_weight"]
    assert order_text(replace(result, grasps=uncertain)) == (
        f"Best first by P(hold), (epsilon + {weight:g} volume) x balance; # counts from 0."
    )
