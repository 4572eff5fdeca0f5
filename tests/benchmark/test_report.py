from __future__ import annotations

import re

import pytest

from gpis_grasp_benchmark.report import Illustrations, report

ORIGINAL_MUG = [0.1335, 0.1, 0.1047]


def rows(text: str, heading: str) -> list[list[str]]:
    """Cells of the table below a heading."""
    block = text.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = [line for line in block.splitlines() if line.startswith("|")]
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines if "---" not in line
    ]


@pytest.fixture
def records(make_record) -> list[dict]:
    originals = {"extent_m": ORIGINAL_MUG}
    return [
        make_record([0.10] * 20, seed=0, **originals),
        make_record([0.12] * 20, seed=1, **originals),
        make_record([0.04] * 5, seed=0, planner="eigengrasp", **originals),
        make_record([0.02] * 5, seed=1, planner="eigengrasp", **originals),
        make_record([], seed=0, planner="random", **originals),
        make_record([], seed=1, planner="random", **originals),
    ]


def test_mean_of_the_best_with_ratios_and_the_figures_of_others(records: list[dict]) -> None:
    text = report(records, "gpis-grasp-benchmark")
    heads, hpp, eigen, by_chance = rows(text, "Mean of the 20 best")
    assert heads[-1] == "measured in another simulator: eps / vol"
    column = heads.index("eps / eigengrasp's")
    # t(0.975, 1) = 12.706; standard error of 0.10 and 0.12: 0.01
    assert hpp[2] == "0.1100 ± 0.1271"
    assert float(eigen[2].split()[0]) == pytest.approx(0.0075, abs=5e-5)
    assert float(hpp[column]) == pytest.approx(0.11 / 0.0075, rel=5e-3)
    assert hpp[heads.index("eps / random's")] == "∞"
    assert by_chance[2] == "0.0000 ± 0.0000"
    assert hpp[-1] == "HPP-Opt 0.0555 / 0.0097"
    assert (
        eigen[-1] == "EigenGrasp 0.0002 / 0.0007; simulator EigenGrasp 0.0039 / 0.0015 (2.4 found)"
    )
    assert "each missing grasp counts\n  as 0" in text
    assert "not ours" in text


def test_best_of_the_twenty(records: list[dict]) -> None:
    _, hpp, eigen, _ = rows(report(records, "c"), "Best of the 20")
    assert hpp[2].startswith("0.1100")
    assert hpp[4] == "0.1200"
    assert hpp[-1] == "HPP-Opt 0.1039 / 0.0151"
    assert eigen[-1] == "EigenGrasp 0.0065 / 0.0011; simulator EigenGrasp 0.0936"


def test_speed_and_success(records: list[dict]) -> None:
    _, hpp, eigen, by_chance = rows(report(records, "c"), "Speed and success")
    assert hpp[2:] == ["20.0 of 20", "2 of 2", "5000", "250"]
    assert eigen[2] == "5.0 of 20"
    assert by_chance[2:4] == ["0.0 of 20", "0 of 2"]


def test_ratios_are_over_the_objects_that_both_were_tried_on(
    records: list[dict], make_record
) -> None:
    more = [*records, make_record([0.5] * 20, object_id="gear")]
    for given in (records, more):
        heads, hpp, *_ = rows(report(given, "c"), "Ratios over all objects")
        ratio = float(hpp[heads.index("eps / eigengrasp's")])
        assert ratio == pytest.approx(0.11 / 0.0075, rel=5e-3)


def test_other_objects_of_the_same_name_stand_beside_nothing(make_record) -> None:
    text = report([make_record([0.1])], "c")
    assert "another simulator" not in text
    assert "0.0555" not in text


def test_how_it_was_made_is_said(records: list[dict]) -> None:
    text = report(records, "gpis-grasp-benchmark --seeds 2")
    assert "    gpis-grasp-benchmark --seeds 2" in text
    assert "6 runs: 1 objects, planners hpp, eigengrasp, random, seeds 0, 1; 20.0 s per run" in text
    assert "mug 0.3 / 0.2" in text
    assert records[0]["settings_hash"] in text
    assert "states of the sources" not in text


def test_mixed_sources_and_a_busy_machine_are_told(make_record) -> None:
    first, second = make_record([0.1]), make_record([0.1], seed=1, cpu_s=9.0)
    second["environment"] = {**second["environment"], "source": "bb"}
    text = report([first, second], "c")
    assert "2 states of the sources" in text
    assert "1 runs had the core for less than 90 %" in text


def test_equal_evaluations_are_told(make_record) -> None:
    text = report([make_record([0.1], max_evaluations=500)], "c")
    assert "equal evaluations: 500 per run" in text


def test_plots_and_pictures_are_linked(records: list[dict]) -> None:
    drawn = Illustrations({"mug": "plots/mug.png"}, {"mug": "pictures/mug.png"})
    links = re.findall(r"!\[[^]]*\]\(([^)]*)\)", report(records, "c", drawn))
    assert links == ["plots/mug.png", "pictures/mug.png"]
