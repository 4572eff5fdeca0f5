"""--approach and --forbid, and the same from a scene's file."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.cli.constraint_options import add_constraints, constraints_of
from gpis_grasp_planner.cli.parser import CommandParser
from gpis_grasp_planner.errors import ErrorCode, RequestError


def parsed(*words):
    parser = CommandParser()
    add_constraints(parser)
    return parser.parse_args(words)


def read(*words, scene=None):
    return constraints_of(parsed(*words), scene or {})


def test_nothing_given_restricts_nothing():
    assert read() == (None, ())


def test_an_approach_and_two_boxes():
    cone, regions = read(
        "--approach=0,0,-2,30", "--forbid", "0.1,0,0,0.01,0.02,0.03", "--forbid", "0 0 0 1 1 1"
    )
    assert cone.axis.tolist() == [0.0, 0.0, -1.0]
    assert (cone.half_angle_deg, cone.frame) == (30.0, "world")
    assert [r.size.tolist() for r in regions] == [[0.01, 0.02, 0.03], [1.0, 1.0, 1.0]]
    np.testing.assert_array_equal(regions[0].pose[:3, 3], [0.1, 0.0, 0.0])


def test_the_scene_says_the_same():
    scene = {
        "approach": {"axis": [1, 0, 0], "half_angle_deg": 10, "frame": "object"},
        "forbidden": [{"size": [0.1, 0.1, 0.1], "name": "label"}],
    }
    cone, regions = read("--forbid", "0,0,0,1,1,1", scene=scene)
    assert (cone.frame, cone.half_angle_deg) == ("object", 10.0)
    assert [r.name for r in regions] == ["label", "forbidden 0,0,0,1,1,1"]


@pytest.mark.parametrize(
    ("words", "scene", "text"),
    [
        (["--approach", "0,0,1"], {}, "give 4 numbers"),
        (["--approach", "0,0,x,1"], {}, "give 4 numbers"),
        (["--approach", "0,0,0,1"], {}, "length 0"),
        (["--approach", "0,0,1,190"], {}, "0 to 180"),
        (["--forbid", "0,0,0"], {}, "give 6 numbers"),
        (["--forbid", "0,0,0,1,1,-1"], {}, "not negative"),
        ([], {"forbidden": {"size": [1, 1, 1]}}, "give a list"),
        ([], {"forbidden": [{"size": [1, 1, 1]}] * 51}, "at most 50"),
        (
            ["--approach", "0,0,1,5"],
            {"approach": {"axis": [0, 0, 1], "half_angle_deg": 5}},
            "Leave one out",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(words, scene, text):
    with pytest.raises(RequestError, match=text) as caught:
        read(*words, scene=scene)
    assert caught.value.code == ErrorCode.INVALID_SCENE


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        (["--approach", "-1,0,0,30"], "-1,0,0,30"),
        (["--approach", "-.5 0 -1 30"], "-.5 0 -1 30"),
        (["--approach", "-5e-1,0,0,30"], "-5e-1,0,0,30"),
    ],
)
def test_a_list_may_begin_with_a_negative_number(words, kept):
    assert parsed(*words).approach == kept


def test_a_missing_list_is_told():
    with pytest.raises(SystemExit):
        parsed("--approach", "--forbid", "0,0,0,1,1,1")
