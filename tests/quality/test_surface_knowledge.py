"""What an uncertain contact costs: half at the setting, nothing where all is known."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.quality.measure import HeldPart
from gpis_grasp_planner.quality.objective import EpsilonVolume, worth
from gpis_grasp_planner.quality.surface_knowledge import KnownContacts, contact_deviation

MEASURE = contact_deviation(lambda points: 0.01 * np.abs(points[:, 0]))
OBJECTIVE = KnownContacts(EpsilonVolume(0.5), MEASURE, 0.004)


def quality(deviation):
    measured = {} if deviation is None else {"contact_deviation": deviation}
    return Quality(0.2, 0.1, None, measured)


def test_the_figure_is_the_root_mean_square_over_the_contacts():
    p = np.array([[0.3, 0.0, 0.0], [-0.4, 0.0, 0.0]])
    n = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    contacts = Contacts(p, n, np.full(2, 0.5), np.zeros(2, dtype=np.intp))
    held = HeldPart(contacts, np.zeros(3), 0.05, 8, np.eye(4), np.zeros(8))
    assert MEASURE.of(held) == pytest.approx(0.01 * np.sqrt((0.09 + 0.16) / 2.0))


@pytest.mark.parametrize(("deviation", "share"), [(None, 1.0), (0.0, 1.0), (0.004, 0.5)])
def test_the_objective_is_less_by_the_deviation(deviation, share):
    assert worth(OBJECTIVE, quality(deviation)) == pytest.approx(share * 0.25)


def test_more_deviation_is_never_better(rng):
    deviations = np.sort(rng.uniform(0.0, 0.05, 50))
    values = [float(worth(OBJECTIVE, quality(d))) for d in deviations]
    assert (np.diff(values) < 0.0).all()
    assert "contact_deviation" in OBJECTIVE.text
    assert OBJECTIVE.measures == (MEASURE,)
