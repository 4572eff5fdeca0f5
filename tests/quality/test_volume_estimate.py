"""The volume's stand-in: follows the exact volume over grasps, and its scaling laws."""

import json
from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.volume_estimate import volume_estimate
from gpis_grasp_planner.quality.wrench_space import contact_wrenches, hull_quality


def wrenches(contacts, scale=1.0):
    return contact_wrenches(contacts, np.zeros(3), scale)


def test_logarithm_follows_the_exact_volume(random_grasps):
    exact, estimate = [], []
    for contacts in random_grasps(40):
        W = wrenches(contacts)
        exact.append(hull_quality(W).volume)
        estimate.append(volume_estimate(W, len(contacts)))
    correlation = np.corrcoef(np.log(exact), np.log(estimate))[0, 1]
    print("correlation", correlation)
    assert correlation > 0.98


def test_reference_grasps_are_within_a_factor_of_two():
    path = Path(__file__).parents[1] / "data" / "reference_grasps.json"
    for grasp in json.loads(path.read_text())["grasps"]:
        rows = np.array(grasp["contacts"])
        contacts = Contacts(
            rows[:, :3], rows[:, 3:6], rows[:, 6], np.zeros(len(rows), dtype=np.intp)
        )
        W = contact_wrenches(contacts, np.array(grasp["center_of_mass_mm"]), grasp["max_radius_mm"])
        assert 1 / 2 < volume_estimate(W, len(rows)) / grasp["volume"] < 2


def test_contacts_that_crowd_do_not_make_a_grasp_large(rng):
    # Two flat patches of nine contacts, opposite each other: spread in torques, thin in forces.
    patch = np.stack(np.meshgrid([-0.01, 0.0, 0.01], [-0.01, 0.0, 0.01]), axis=-1).reshape(-1, 2)
    side = np.repeat([-1.0, 1.0], 9)
    positions = np.column_stack([0.03 * side, np.tile(patch, (2, 1))])
    positions += 1e-4 * rng.standard_normal(positions.shape)
    normals = np.column_stack([-side, np.zeros(18), np.zeros(18)])
    contacts = Contacts(positions, normals, np.full(18, 0.3), np.zeros(18, dtype=np.intp))
    W = contact_wrenches(contacts, np.zeros(3), 0.1)
    ratio = volume_estimate(W, 18) / hull_quality(W).volume
    print("ratio", ratio)
    assert 1 / 2.5 < ratio < 2.5


def test_scales_as_the_volume_does_and_vanishes_with_it(random_grasps):
    contacts = random_grasps(1)[0]
    one, two = (volume_estimate(wrenches(contacts, s), len(contacts)) for s in (1.0, 2.0))
    assert two == pytest.approx(one / 8.0)
    assert volume_estimate(np.zeros((16, 6)), 2) == 0.0
