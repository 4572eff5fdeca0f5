"""Which detection is taken for which part."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.ros.detections import chosen_instances, mapping_of


def detection(*hypotheses: tuple[str, float, float], frame: str = "camera") -> Any:
    """A detection with hypotheses of class ID, score and x."""
    results = [
        SimpleNamespace(
            hypothesis=SimpleNamespace(class_id=class_id, score=score),
            pose=SimpleNamespace(pose=SimpleNamespace(position=SimpleNamespace(x=x, y=0.0, z=0.0))),
        )
        for class_id, score, x in hypotheses
    ]
    return SimpleNamespace(header=SimpleNamespace(frame_id=frame), results=results)


SEEN = [
    detection(("12", 0.6, 1.0), ("13", 0.3, 1.0)),
    detection(("12", 0.9, 5.0)),
    detection(("mug", 0.7, 2.0), frame="other"),
    detection(("13", math.nan, 0.0)),
]


def x_of(chosen: dict[str, Any], mesh_id: str) -> float:
    return float(chosen[mesh_id][1].pose.pose.position.x)


def test_the_best_score_is_taken_and_a_class_stands_for_its_mesh() -> None:
    chosen = chosen_instances(SEEN, {"12": "flask"}, 0.5, None)
    assert set(chosen) == {"flask", "mug"}
    assert x_of(chosen, "flask") == 5.0
    assert chosen["mug"][0].frame_id == "other"


def test_the_nearest_is_taken_where_a_point_is_given() -> None:
    chosen = chosen_instances(SEEN, {"12": "flask"}, 0.5, (0.0, 0.0, 0.0))
    assert x_of(chosen, "flask") == 1.0


def test_the_threshold_holds_and_no_score_is_none() -> None:
    assert set(chosen_instances(SEEN, {}, 0.0, None)) == {"12", "13", "mug"}
    assert x_of(chosen_instances(SEEN, {}, 0.0, None), "13") == 1.0
    assert set(chosen_instances(SEEN, {}, 0.95, None)) == set()


def test_classes_of_one_part_compete() -> None:
    chosen = chosen_instances(SEEN, {"12": "mug"}, 0.5, None)
    assert set(chosen) == {"mug"}
    assert x_of(chosen, "mug") == 5.0


@pytest.mark.parametrize("pair", ["mug", "=mug", "12=", "12=../mug", "12=a b"])
def test_a_bad_pair_is_refused_with_an_example(pair: str) -> None:
    with pytest.raises(RequestError, match=r"class_ids.*12=mug"):
        mapping_of([pair], "class_ids")


def test_a_class_that_stands_for_two_parts_is_refused() -> None:
    with pytest.raises(RequestError, match=r"'12' twice, for 'mug' and for 'box'"):
        mapping_of(["12=mug", "7=mug", "12=box"], "class_ids")
    assert mapping_of(["12=mug", "7=mug", "12=mug"], "class_ids") == {"12": "mug", "7": "mug"}


def test_a_class_may_have_an_equals_sign() -> None:
    assert mapping_of(["a=b=mug"], "class_ids") == {"a=b": "mug"}
