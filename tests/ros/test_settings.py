"""The node's own settings."""

from __future__ import annotations

import pytest

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.ros.parameter_groups import parameter_infos
from gpis_grasp_planner.ros.settings import PLANNER_NAMES, READ_ONLY, NodeSettings
from gpis_grasp_planner.search.searches import PLANNERS


def test_the_planners_names_are_those_of_the_planner() -> None:
    assert tuple(PLANNERS) == PLANNER_NAMES


def test_read_only_parameters_exist() -> None:
    assert set(parameter_infos()) >= READ_ONLY


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"default_time_budget_s": 50.0, "max_time_budget_s": 20.0}, "max_time_budget_s"),
        ({"friction_finger": 0.5}, "friction_palm"),
        ({"friction_finger": 0.001, "friction_palm": 0.5}, "0.01"),
        ({"mesh_directories": ("",)}, "mesh_directories"),
        ({"default_planner": "fastest"}, "hpp"),
        ({"support_pose": "0 0 0.75"}, "seven numbers"),
        ({"palm_flange_pose": "0 0 0.75"}, "palm_flange_pose"),
        ({"support_frame": "w w"}, "support_frame"),
        ({"pose_type": "tf"}, "object_parent_frame"),
        ({"class_ids": ("12",)}, "class_ids"),
        ({"object_frames": ("cup=mug", "cup=box")}, "'cup' twice"),
        ({"object_frames": ("cup=mug", "cup_2=mug")}, "one frame for each part"),
        ({"instance_point": "0 0"}, "three numbers"),
        ({"support_frame": "w" * 5000}, "1 to 255 letters"),
        ({"obstacles_frame": "w\n"}, "obstacles_frame"),
        ({"support_pose": "0 0 high 0 0 0 1"}, "seven numbers"),
        ({"support_pose": "0 0 0 0 0 0 2"}, "support_pose has norm 2"),
        ({"obstacles": "{name: wall}", "obstacles_frame": "world"}, "takes a list"),
        ({"obstacles": "[", "obstacles_frame": "world"}, "obstacles' is neither YAML"),
        ({"obstacles": "[{name: wall}]", "obstacles_frame": "world"}, "'wall' must have"),
        ({"obstacles": "[{size: [1, 1, 1]}]"}, "obstacles_frame"),
    ],
)
def test_contradictions_are_refused(values: dict[str, object], word: str) -> None:
    with pytest.raises(RequestError, match=word):
        NodeSettings(**values)  # type: ignore[arg-type]


def test_friction() -> None:
    assert NodeSettings().friction is None
    both = NodeSettings(friction_finger=0.4, friction_palm=0.8)
    assert both.friction == Friction(finger=0.4, palm=0.8)
