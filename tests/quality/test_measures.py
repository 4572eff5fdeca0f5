"""Measures by name: ours, those of other distributions, and what is wrong with them."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from types import ModuleType

import numpy as np
import pytest

from gpis_grasp_planner import registered
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.quality.figures import Figure
from gpis_grasp_planner.quality.measure import HeldPart, Measure
from gpis_grasp_planner.quality.measures import GROUP, MEASURES, make_measure, measured
from gpis_grasp_planner.quality.settings import ObjectiveSettings

DEFAULT = ObjectiveSettings()


@pytest.fixture
def part(grasp_of) -> HeldPart:
    p = np.vstack([np.eye(3), -np.eye(3)])
    return HeldPart(grasp_of(p, -p, 0.5), np.zeros(3), 1.0, 8, np.eye(4), np.zeros(8))


@pytest.fixture
def offer(monkeypatch: pytest.MonkeyPatch):
    """Register a value as other distributions do, under a name."""

    def register(name: str, value: object) -> None:
        module = ModuleType("strangers_measures")
        module.value = value
        monkeypatch.setitem(sys.modules, "strangers_measures", module)
        point = EntryPoint(name, "strangers_measures:value", GROUP)
        monkeypatch.setattr(registered, "entry_points", lambda group: [point])

    return register


@pytest.mark.parametrize("name", list(MEASURES))
def test_ours_have_their_names_and_finite_figures(name: str, part: HeldPart) -> None:
    measure = make_measure(name, DEFAULT)
    figure = measure.figure
    assert figure.name == name
    assert figure.description.endswith(".")
    assert figure.source
    assert measured(part, [measure])[name] > 0.0


def test_a_strangers_measure_is_found_and_computed(offer, part: HeldPart) -> None:
    mine = Measure(Figure("n_touching", "", True, "", ""), lambda held: float(len(held.contacts)))
    offer("n_touching", mine)
    found = make_measure("n_touching", DEFAULT)
    assert found is mine
    assert measured(part, [found]) == {"n_touching": 6.0}


def test_ours_cannot_be_replaced(offer) -> None:
    offer("min_weight", Measure(Figure("min_weight", "", True, "", ""), lambda held: 1.0))
    assert make_measure("min_weight", DEFAULT) is MEASURES["min_weight"](DEFAULT)


def test_an_unknown_name_lists_the_known(offer) -> None:
    offer("mine", None)
    with pytest.raises(RequestError, match="min_weight, least_friction, task, mine") as caught:
        make_measure("nonsense", DEFAULT)
    assert GROUP in str(caught.value)


@pytest.mark.parametrize(
    "value", [3.0, Measure(Figure("another", "", True, "", ""), lambda held: 0.0)]
)
def test_what_is_no_measure_of_that_name_is_refused(offer, value: object) -> None:
    offer("mine", value)
    with pytest.raises(RequestError, match="must be a Measure whose figure is named 'mine'"):
        make_measure("mine", DEFAULT)


def test_a_module_names_one_that_nobody_registered(offer, part: HeldPart) -> None:
    mine = Measure(Figure("n_touching", "", True, "", ""), lambda held: float(len(held.contacts)))
    offer("another", mine)
    assert make_measure("strangers_measures:value", DEFAULT) is mine


@pytest.mark.parametrize("ours", ["epsilon", "task"])
def test_a_modules_measure_must_not_have_a_name_of_ours(offer, ours: str) -> None:
    offer("another", Measure(Figure(ours, "", True, "", ""), lambda held: 0.0))
    with pytest.raises(RequestError, match="with a name of its own"):
        make_measure("strangers_measures:value", DEFAULT)


def test_one_that_cannot_be_imported_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("mine", "no_such_module_anywhere:value", GROUP)
    monkeypatch.setattr(registered, "entry_points", lambda group: [point])
    with pytest.raises(RequestError, match=r"'mine' \(no_such_module_anywhere:value\)"):
        make_measure("mine", DEFAULT)


def test_one_that_raises_is_named(part: HeldPart) -> None:
    def broken(held: HeldPart) -> float:
        raise ZeroDivisionError("by hand")

    with pytest.raises(RequestError, match="'mine' raised ZeroDivisionError"):
        measured(part, [Measure(Figure("mine", "", True, "", ""), broken)])


def test_what_is_not_finite_is_left_out(part: HeldPart) -> None:
    assert measured(part, [Measure(Figure("mine", "", True, "", ""), lambda held: np.inf)]) == {}
