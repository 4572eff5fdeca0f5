"""A small part and a posture of the hand around it."""

import subprocess
import sys
import warnings

import numpy as np
import pytest

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.drive import joints_from_motors
from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.view.picture import GraspView

with warnings.catch_warnings():
    # The generator's parser, which rclpy loads with the first message type, uses sre_parse.
    warnings.simplefilter("ignore", DeprecationWarning)
    import rosidl_generator_py  # noqa: F401


@pytest.fixture
def grasp():
    """A block of 60 x 60 x 80 mm, the palm 20 mm above it, looking down."""
    block = convex_hull(
        [[x, y, z] for x in (-0.03, 0.03) for y in (-0.03, 0.03) for z in (-0.04, 0.04)]
    )
    hand = load_hand()
    T_object_palm = np.diag([1.0, -1.0, -1.0, 1.0])
    T_object_palm[2, 3] = 0.04 + 0.0793 + 0.02
    joints = joints_from_motors(hand, [0.9], np.radians([[75.0] * 3]))[0]
    contacts = Contacts(
        positions=np.array([[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]]),
        normals_inward=np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        friction=np.array([0.4, 0.4]),
        links=np.array([7, 8]),
    )
    return GraspView(block, hand, T_object_palm, joints, contacts)


@pytest.fixture(scope="session")
def mug_document(tmp_path_factory):
    """Grasps of the mug on a table, planned by the command line as a user would."""
    path = tmp_path_factory.mktemp("view") / "mug.json"
    options = "--support lowest --seed 3 --evaluations 1500 --time 60 --verify none --json"
    subprocess.run(
        [
            sys.executable,
            *("-m", "gpis_grasp_planner.cli.main", "plan", "mug"),
            *options.split(),
            path,
        ],
        check=True,
    )
    return path
