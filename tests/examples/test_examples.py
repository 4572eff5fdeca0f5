"""Each script of examples/ runs as its first lines say, as a process of its own."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.document import read_document

with warnings.catch_warnings():
    # The generator's parser, which rclpy loads with the first message type, uses sre_parse.
    warnings.simplefilter("ignore", DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
LIMIT_S = 180.0  # a bound on a hang


def run(folder: Path, name: str, *words: str) -> str:
    """What an example prints; it has to end with 0."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *words],
        cwd=folder,
        env={**os.environ, "GPIS_GRASP_STORE": "off"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LIMIT_S,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


@contextmanager
def running(folder: Path, *command: str) -> Iterator[Callable[[], str]]:
    """A process beside the test; gives what it has printed so far, and ends on SIGTERM."""
    log = folder / f"{len(list(folder.iterdir()))}.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, *command], cwd=folder, stdout=output, stderr=subprocess.STDOUT
        )
    try:
        yield log.read_text
    finally:
        ended = process.poll()
        if ended is None:
            process.send_signal(signal.SIGTERM)
            ended = process.wait(30.0)
        # rclpy hands the signal on once its context is down; the node catches it itself.
        assert ended in (0, -signal.SIGTERM), log.read_text()
        assert "Traceback" not in log.read_text()


@contextmanager
def node(folder: Path, **parameters: str) -> Iterator[None]:
    """The planner's node, ready."""
    words = [w for name, value in parameters.items() for w in ("-p", f"{name}:={value}")]
    command = ("-m", "gpis_grasp_planner.ros.node", "--ros-args", *words)
    with running(folder, *command) as text:
        wait(lambda: "Ready: service" in text(), text)
        yield


def wait(condition: Callable[[], bool], told: Callable[[], str]) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline, told()
        time.sleep(0.05)


def numbers(pattern: str, text: str) -> list[tuple[float, ...]]:
    return [tuple(map(float, found.groups())) for found in re.finditer(pattern, text)]


def test_every_example_has_a_test_and_a_line_of_the_index() -> None:
    scripts = {path.name for path in EXAMPLES.glob("*.py")}
    assert len(scripts) == 13
    assert scripts == set(re.findall(r"\]\((\w+\.py)\)", (EXAMPLES / "README.md").read_text()))
    assert scripts == set(re.findall(r'"(\w+\.py)"', Path(__file__).read_text()))


def test_a_plan_and_its_document(tmp_path: Path) -> None:
    text = run(tmp_path, "plan_a_part.py")
    assert text.startswith("SUCCESS ")
    shown = [epsilon for (epsilon,) in numbers(r"epsilon (\S+), \d+ contacts", text)]
    kept = [grasp.epsilon for grasp in read_document(tmp_path / "grasps.json").result.grasps]
    assert shown == [round(epsilon, 3) for epsilon in kept[:3]]


def test_no_palm_is_below_the_table(tmp_path: Path) -> None:
    text = run(tmp_path, "plan_on_a_table.py")
    assert text.startswith("SUCCESS ")
    shown = numbers(r"palm at \[ ?(\S+) +(\S+) +(\S+?)\] m, (\S+) mm", text)
    assert shown
    assert all(z > 0.75 and distance >= 3.0 for _, _, z, distance in shown)


def test_a_rule_of_ones_own_is_kept(tmp_path: Path) -> None:
    text = run(tmp_path, "own_constraint.py")
    assert text.startswith("SUCCESS ")
    assert int(re.search(r"height of contacts (\d+)", text)[1]) > 0
    [(farthest,)] = numbers(r"farthest contact (\S+) mm", text)
    assert 0.0 < farthest <= 25.0


def test_the_request_is_kept(tmp_path: Path) -> None:
    text = run(tmp_path, "forbid_a_region.py")
    [(below,)] = numbers(r"highest contact (\S+) mm", text)
    [(angle,)] = numbers(r"direction (\S+) degrees", text)
    assert below >= 20.0
    assert angle <= 60.0 + 0.05


def test_another_hand(tmp_path: Path) -> None:
    text = run(tmp_path, "own_hand.py")
    assert text.startswith("SUCCESS ")
    left, right = (value for (value,) in numbers(r"_jaw_joint (\S+)", text))
    assert 0.0 < left <= 0.0425
    assert left == pytest.approx(right, abs=1e-3)


def test_a_measure_of_ones_own(tmp_path: Path) -> None:
    levers = [
        value
        for value, _ in numbers(r"lever (\S+) mm, epsilon (\S+)", run(tmp_path, "own_measure.py"))
    ]
    part = MeshCatalogue([default_catalogue_directory()]).load("mug")
    reach = np.linalg.norm(part.mesh.vertices - part.center_of_mass, axis=1).max()
    assert len(levers) == 3
    assert levers == sorted(levers)
    assert all(0.0 < lever <= 1e3 * reach + 0.05 for lever in levers)


def test_the_store_answers_the_second_question(tmp_path: Path) -> None:
    text = run(tmp_path, "grasp_store.py")
    assert re.findall(r"from the store: (\w+)", text) == ["False", "True"]
    first, second = (n for (n,) in numbers(r"(\d+) grasps in", text))
    assert first == second > 0
    assert "kept: phone" in text


def test_a_batch_says_what_became_of_each(tmp_path: Path) -> None:
    text = run(tmp_path, "batch.py")
    ids = MeshCatalogue([default_catalogue_directory()]).ids()
    assert [line.split()[0] for line in text.splitlines()] == list(ids)


def test_planners_are_compared(tmp_path: Path) -> None:
    text = run(tmp_path, "compare_planners.py", "100")
    figures = dict(re.findall(r"^(\S+) +mean epsilon .* (\S+)$", text, flags=re.MULTILINE))
    assert {"dual", "hpp", "paper", "random", "random-adaption"} <= set(figures)
    assert all(0.0 <= float(value) < 0.5 for value in figures.values())
    assert float(figures["dual"]) > float(figures["random"])


def test_an_executive_hears_what_an_estimator_and_a_call_lead_to(tmp_path: Path) -> None:
    with (
        node(tmp_path, default_verification="none"),
        running(tmp_path, str(EXAMPLES / "pose_estimator.py")),
        running(tmp_path, str(EXAMPLES / "executive.py")) as heard,
    ):
        called = call_service()
        wait(lambda: "palm at" in heard() and heard().count(" rad") == 8, heard)
    p = called.grasps[0].palm_pose.pose.position
    assert f"palm at {p.x:.3f} {p.y:.3f} {p.z:.3f} m in cell" in heard()


def test_detections_say_where_the_part_is(tmp_path: Path) -> None:
    detector = {"pose_type": "detection3d_array", "class_ids": "['cup=mug']"}
    with (
        node(tmp_path, default_verification="none", **detector),
        running(tmp_path, str(EXAMPLES / "detections.py")),
    ):
        assert call_service().grasps[0].palm_pose.header.frame_id == "cell"


def test_frames_of_camera_and_robot(tmp_path: Path) -> None:
    with node(tmp_path, default_verification="none"):
        text = run(tmp_path, "tf_frames.py")
    [(x, y, z)] = numbers(r"palm at (\S+) (\S+) (\S+) m in base", text)
    # The part is 0.8 m above the base, below the camera; the palm is within a hand's length.
    assert np.linalg.norm([x, y, z - 0.8]) < 0.25


def call_service() -> PlanGrasp.Response:
    """Call the node with no pose, until the estimate has been heard."""
    context = rclpy.Context()
    rclpy.init(context=context)
    caller = Node("caller", context=context)
    executor = SingleThreadedExecutor(context=context)
    try:
        client = caller.create_client(PlanGrasp, "plan_grasp")
        assert client.wait_for_service(LIMIT_S)
        deadline = time.monotonic() + LIMIT_S
        while True:
            future = client.call_async(PlanGrasp.Request(mesh_id="mug", time_budget=3.0))
            rclpy.spin_until_future_complete(caller, future, executor, timeout_sec=LIMIT_S)
            answer = future.result()
            if answer.success:
                return answer
            assert answer.code == answer.NO_POSE_ESTIMATE, answer.message
            assert time.monotonic() < deadline
            time.sleep(0.1)
    finally:
        executor.shutdown()
        caller.destroy_node()
        rclpy.shutdown(context=context)
