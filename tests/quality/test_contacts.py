"""Contacts: shapes are checked where they are made."""

import numpy as np
import pytest

from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.quality.contacts import Contacts


def arrays(k):
    return np.zeros((k, 3)), np.zeros((k, 3)), np.zeros(k), np.zeros(k, dtype=np.intp)


def test_length_is_the_number_of_contacts():
    assert len(Contacts(*arrays(4))) == 4
    assert len(Contacts.none()) == 0


@pytest.mark.parametrize(
    ("index", "wrong"),
    [
        (0, np.zeros((3, 2))),
        (0, np.zeros((2, 3))),
        (1, np.zeros((2, 3))),
        (1, np.zeros(9)),
        (2, np.zeros(2)),
        (3, np.zeros(4, dtype=np.intp)),
    ],
)
def test_arrays_that_do_not_fit_each_other_are_refused(index, wrong):
    parts = list(arrays(3))
    parts[index] = wrong
    with pytest.raises(GraspPlannerError, match=r"[cC]ontacts"):
        Contacts(*parts)
