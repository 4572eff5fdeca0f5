"""A box to hold, hand states, and the hand's frames walked again."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gpis_grasp_benchmark.rivals.hand_states import HandStates

HALF_BOX = np.array([0.03, 0.02, 0.04])


@pytest.fixture(scope="session")
def box(oracle):
    """A box of 60 x 40 x 80 mm about the origin."""
    return oracle.make_part("box", trimesh.creation.box(extents=2.0 * HALF_BOX))


@pytest.fixture
def random_states():
    """Draw states (n, dim) round an object, postures included."""

    def draw(context, rng, n, reach=0.12):
        variables = HandStates(context).variables
        states = rng.uniform(variables.lower, variables.upper, (n, len(variables.lower)))
        direction = rng.standard_normal((n, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        states[:, :3] = direction * rng.uniform(0.02, reach, (n, 1))
        states[:, 6] = rng.uniform(-1.1, 2.0, n)
        states[:, 7] = rng.uniform(-0.8, 1.0, n)
        return states

    return draw


@pytest.fixture
def link_frames(oracle):
    """Poses (L, 4, 4) of the links, joint by joint."""

    def frames(hand, T_object_palm, joints):
        T = []
        for link, parent in enumerate(hand.link_parent):
            here = T_object_palm if parent < 0 else T[parent] @ hand.T_parent_joint[link]
            if hand.link_joint[link] >= 0:
                turn = np.eye(4)
                turn[:3, :3] = oracle.rotation_about(
                    hand.joint_axis[link], joints[hand.link_joint[link]]
                )
                here = here @ turn
            T.append(here)
        return np.stack(T)

    return frames
