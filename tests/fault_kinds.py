"""Kinds of fault for a live node: what is done to it, and the codes that may be answered.

Each kind is a function of the cell and a seeded generator; it does its harm and returns every
answer that came of it, None for one that did not come.
"""

from __future__ import annotations

import math
import os
import random
import resource
import shutil
import signal
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovariance, Vector3
from live_node import Goal, LiveNode, NodeClient, children, plan_request, waited

from gpis_grasp_msgs.msg import Obstacle, PartPose, PartPoses
from gpis_grasp_planner.errors import ErrorCode as Code
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory

READ_LIMIT_S = 3.0
FOUND = {Code.SUCCESS}
Harm = Callable[["Cell", random.Random], list[Any]]


@dataclass
class Cell:
    """A node, a client, and the folders that the node reads."""

    node: LiveNode
    client: NodeClient
    parts: Path
    cache: Path

    @contextmanager
    def part(self, rng: random.Random) -> Iterator[tuple[str, Path]]:
        """A part that the node has never seen: the mug, a little larger or smaller."""
        mesh_id = f"part{rng.randrange(10**9)}"
        path = self.parts / f"{mesh_id}.stl"
        path.write_bytes(scaled_mug(rng.uniform(0.95, 1.05)))
        shutil.copy(self.parts / "mug.yaml", path.with_suffix(".yaml"))
        try:
            yield mesh_id, path
        finally:
            path.unlink(missing_ok=True)
            path.with_suffix(".yaml").unlink(missing_ok=True)


@dataclass(frozen=True)
class Fault:
    """A kind of fault: `expected` are the codes that may be answered."""

    name: str
    expected: frozenset[int]
    harm: Harm


FAULTS: list[Fault] = []


def fault(name: str, *expected: Any) -> Callable[[Harm], Harm]:
    """Enter a function into the list of kinds; codes or sets of codes are what may come."""
    codes = frozenset[int]().union(*(e if isinstance(e, set) else {e} for e in expected))

    def enter(harm: Harm) -> Harm:
        FAULTS.append(Fault(name, codes, harm))
        return harm

    return enter


def scaled_mug(factor: float) -> bytes:
    """The mug's binary STL file with all coordinates times a factor."""
    data = (default_catalogue_directory() / "mug.stl").read_bytes()
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.frombuffer(data, kind, offset=84).copy()
    facets["corners"] *= factor
    return data[:84] + facets.tobytes()


def at_phase(cell: Cell, rng: random.Random, phase: str, number: int) -> list[Any]:
    """A signal to the planning process at a random moment of a phase of a goal."""
    with cell.part(rng) as (mesh_id, _):
        goal = goal_of(cell, mesh_id)
        if goal.wait_phase(phase):
            time.sleep(rng.uniform(0.0, 0.2))
            with suppress(ProcessLookupError):
                os.kill(cell.node.worker(), number)
        return [goal.answer()]


def goal_of(cell: Cell, mesh_id: str, **fields: Any) -> Goal:
    """A goal on a table, with trials: it goes through all phases."""
    support = PoseStamped()
    support.header.frame_id = "world"
    support.pose.position.z = -0.06
    values = {"time_budget": 5.0, "verification": "rank", "support_plane": support, **fields}
    return cell.client.send_goal(plan_request(mesh_id, **values))


for _phase in ("reading", "preparing", "searching", "trying", "placing"):

    def _killed(cell: Cell, rng: random.Random, phase: str = _phase) -> list[Any]:
        return at_phase(cell, rng, phase, signal.SIGKILL)

    fault(f"planning process killed while {_phase}", FOUND)(_killed)


@fault("planning process crashes while searching", FOUND)
def _crash(cell: Cell, rng: random.Random) -> list[Any]:
    return at_phase(cell, rng, "searching", signal.SIGSEGV)


@fault("planning process stopped while searching", FOUND)
def _stop(cell: Cell, rng: random.Random) -> list[Any]:
    return at_phase(cell, rng, "searching", signal.SIGSTOP)


@fault("planning process killed while idle", FOUND)
def _kill_idle(cell: Cell, rng: random.Random) -> list[Any]:
    os.kill(cell.node.worker(), signal.SIGKILL)
    time.sleep(rng.uniform(0.0, 1.0))
    return [cell.client.call(fresh(rng))]


@fault("planning process stopped while idle", FOUND)
def _stop_idle(cell: Cell, rng: random.Random) -> list[Any]:
    os.kill(cell.node.worker(), signal.SIGSTOP)
    time.sleep(rng.uniform(0.0, 3.0))
    return [cell.client.call(fresh(rng))]


@fault("planning process killed twice", FOUND, Code.PLANNING_PROCESS_LOST)
def _kill_twice(cell: Cell, rng: random.Random) -> list[Any]:
    answer = cell.client.begin(fresh(rng, time_budget=3.0))
    for _ in range(2):
        time.sleep(rng.uniform(0.1, 2.0))
        with suppress(ProcessLookupError):
            os.kill(cell.node.worker(), signal.SIGKILL)
    return [waited(answer)]


def child_at(cell: Cell, rng: random.Random, phase: str, number: int) -> list[Any]:
    """A signal to one of the children that the planning process has in a phase."""
    with cell.part(rng) as (mesh_id, _):
        worker = cell.node.worker()
        goal = goal_of(cell, mesh_id)
        while not goal.result.done():
            found = children(worker) if goal.phase in (phase, "waiting") else []
            if found and (phase == "reading" or goal.phase == phase):
                time.sleep(rng.uniform(0.0, 0.05))
                with suppress(ProcessLookupError):
                    os.kill(rng.choice(found), number)
                break
            time.sleep(0.002)
        return [goal.answer()]


@fault("mesh reader killed", FOUND, Code.MESH_UNREADABLE)
def _reader_killed(cell: Cell, rng: random.Random) -> list[Any]:
    return child_at(cell, rng, "reading", signal.SIGKILL)


@fault("mesh reader hangs", FOUND, Code.MESH_UNREADABLE)
def _reader_hangs(cell: Cell, rng: random.Random) -> list[Any]:
    return child_at(cell, rng, "reading", signal.SIGSTOP)


@fault("child of the trials killed", FOUND)
def _trial_killed(cell: Cell, rng: random.Random) -> list[Any]:
    return child_at(cell, rng, "trying", signal.SIGKILL)


@fault("child of the trials hangs", FOUND)
def _trial_hangs(cell: Cell, rng: random.Random) -> list[Any]:
    return child_at(cell, rng, "trying", signal.SIGSTOP)


@fault("mesh file cut off", Code.MESH_UNREADABLE, Code.MESH_EMPTY)
def _cut_off(cell: Cell, rng: random.Random) -> list[Any]:
    with cell.part(rng) as (mesh_id, path):
        os.truncate(path, rng.randrange(path.stat().st_size - 50))
        return [cell.client.call(plan_request(mesh_id))]


@fault("mesh file hostile", Code.MESH_TOO_LARGE, Code.MESH_UNREADABLE, Code.MESH_NOT_FINITE,
       Code.MESH_EXTENT_IMPLAUSIBLE, Code.INVALID_MESH_ID, Code.UNKNOWN_MESH)  # fmt: skip
def _hostile(cell: Cell, rng: random.Random) -> list[Any]:
    with cell.part(rng) as (mesh_id, path):
        data = bytearray(path.read_bytes())
        kind = rng.randrange(5)
        if kind == 0:  # a face count that lies
            data[80:84] = struct.pack("<I", rng.randrange(10**8, 2**32))
        elif kind == 1:
            data[96:100] = struct.pack("<f", rng.choice([math.nan, math.inf, 3e38]))
        elif kind == 2:
            data = bytearray(rng.randbytes(rng.randrange(1, 10_000)))
        path.write_bytes(data)
        if kind >= 3:
            path.unlink()
            if kind == 3:
                os.mkfifo(path)
            else:
                path.symlink_to("/dev/zero")
        return [cell.client.call(plan_request(mesh_id))]


@fault("mesh file changed under way", FOUND, Code.MESH_UNREADABLE)
def _changed(cell: Cell, rng: random.Random) -> list[Any]:
    with cell.part(rng) as (mesh_id, path):
        answer = cell.client.begin(plan_request(mesh_id, time_budget=4.0))
        time.sleep(rng.uniform(0.0, 4.0))
        path.write_bytes(scaled_mug(rng.uniform(0.95, 1.05)))
        return [waited(answer), cell.client.call(plan_request(mesh_id, time_budget=4.0))]


@fault("mesh file removed under way", FOUND, Code.UNKNOWN_MESH, Code.MESH_UNREADABLE)
def _removed(cell: Cell, rng: random.Random) -> list[Any]:
    with cell.part(rng) as (mesh_id, path):
        answer = cell.client.begin(plan_request(mesh_id, time_budget=4.0))
        time.sleep(rng.uniform(0.0, 4.0))
        path.unlink()
        return [waited(answer), cell.client.call(plan_request(mesh_id))]


@fault("disk cache damaged", FOUND)
def _damaged_cache(cell: Cell, rng: random.Random) -> list[Any]:
    with cell.part(rng) as (mesh_id, _):
        first = cell.client.call(plan_request(mesh_id, time_budget=4.0))
        for path in cell.cache.rglob("*.arrays"):
            data = bytearray(path.read_bytes())
            for _ in range(20):
                data[rng.randrange(len(data))] ^= rng.randrange(1, 256)
            path.write_bytes(data[: rng.randrange(len(data))] if rng.random() < 0.3 else data)
        os.kill(cell.node.worker(), signal.SIGKILL)  # else it would not read it again
        return [first, cell.client.call(plan_request(mesh_id, time_budget=4.0, seed=1))]


def with_pose(cell: Cell, **fields: Any) -> list[Any]:
    """The answer to a request with a changed pose."""
    request = fresh(random.Random(0))
    for name, value in fields.items():
        holder = request.object_pose.pose
        *path, last = name.split("__")
        for step in path:
            holder = getattr(holder, step)
        setattr(holder, last, value)
    return [cell.client.call(request)]


@fault("pose not finite", Code.POSE_NOT_FINITE)
def _not_finite(cell: Cell, rng: random.Random) -> list[Any]:
    value = rng.choice([math.nan, math.inf, -math.inf])
    return with_pose(cell, **{rng.choice(["position__x", "orientation__z"]): value})


@fault("pose huge", Code.OUTSIDE_WORKSPACE, Code.POSE_NOT_FINITE)
def _huge_pose(cell: Cell, rng: random.Random) -> list[Any]:
    return with_pose(cell, position__y=10.0 ** rng.uniform(2.1, 300.0))


@fault("quaternion zero or of another norm", Code.INVALID_QUATERNION)
def _quaternion(cell: Cell, rng: random.Random) -> list[Any]:
    return with_pose(cell, orientation__w=rng.choice([0.0, 0.9, 1.01, 1e150]))


def stamped(cell: Cell, rng: random.Random, age_s: float) -> list[Any]:
    """The answer to a request whose pose is so old."""
    request = fresh(rng)
    stamp = cell.client.node.get_clock().now().nanoseconds - int(1e9 * age_s)
    request.object_pose.header.stamp.sec = stamp // 10**9
    request.object_pose.header.stamp.nanosec = stamp % 10**9
    return [cell.client.call(request)]


@fault("stamp too old", Code.STALE_POSE)
def _old(cell: Cell, rng: random.Random) -> list[Any]:
    return stamped(cell, rng, 10.0 ** rng.uniform(1.0, 6.0))


@fault("stamp in the future", Code.INVALID_STAMP)
def _future(cell: Cell, rng: random.Random) -> list[Any]:
    return stamped(cell, rng, -(10.0 ** rng.uniform(1.0, 6.0)))


@fault("frame that nobody knows", Code.NO_TRANSFORM)
def _unknown_frame(cell: Cell, rng: random.Random) -> list[Any]:
    return [cell.client.call(fresh(rng, target_frame=f"frame{rng.randrange(10**6)}"))]


@fault("covariance impossible", Code.INVALID_COVARIANCE)
def _covariance(cell: Cell, rng: random.Random) -> list[Any]:
    estimate = PoseWithCovariance()
    estimate.pose.orientation.w = 1.0
    estimate.covariance[0] = rng.choice([math.nan, math.inf, -1.0, 1e308])
    part = PartPose(mesh_id="sphere", pose=estimate)
    part.header.frame_id = "world"
    for _ in range(3):  # that topic may lose one
        cell.client.parts.publish(PartPoses(parts=[part]))
        time.sleep(0.1)
    return [cell.client.call(fresh(rng, object_pose=PoseStamped()))]


def box(rng: random.Random, size: float, at: float) -> Obstacle:
    """A cube."""
    obstacle = Obstacle(name=f"box{rng.randrange(100)}", size=Vector3(x=size, y=size, z=size))
    obstacle.pose.header.frame_id = "world"
    obstacle.pose.pose.position.x = at
    return obstacle


@fault("obstacle malformed", Code.INVALID_SCENE, Code.NO_TRANSFORM, Code.EMPTY_FRAME)
def _malformed(cell: Cell, rng: random.Random) -> list[Any]:
    bad = box(rng, rng.choice([-0.1, math.nan, math.inf]), 0.9)
    return [cell.client.call(fresh(rng, obstacles=[bad]))]


@fault("obstacle huge", Code.INVALID_SCENE, Code.ALL_GRASPS_BLOCKED)
def _huge_obstacle(cell: Cell, rng: random.Random) -> list[Any]:
    return [cell.client.call(fresh(rng, obstacles=[box(rng, 10.0 ** rng.uniform(1, 300), 0.5)]))]


@fault("budget below what is allowed", Code.TIME_BUDGET_OUT_OF_RANGE)
def _budget(cell: Cell, rng: random.Random) -> list[Any]:
    bad = rng.choice([1e-300, -1.0, math.nan, math.inf, 1e9])
    return [cell.client.call(fresh(rng, time_budget=bad))]


@fault("cancel at a random moment", FOUND, Code.CANCELLED)
def _cancel(cell: Cell, rng: random.Random) -> list[Any]:
    goal = goal_of(cell, "mug", seed=rng.randrange(2**31))
    time.sleep(rng.choice([0.0, rng.uniform(0.0, 4.0)]))
    goal.cancel()
    return [goal.answer()]


@fault("caller gone")
def _caller_gone(cell: Cell, rng: random.Random) -> list[Any]:
    with NodeClient(f"gone{rng.randrange(10**6)}") as other:
        other.begin(fresh(rng, time_budget=1.0))
        time.sleep(rng.uniform(0.0, 0.5))
    return []


@fault("more calls than the queue holds", FOUND, Code.BUSY)
def _burst(cell: Cell, rng: random.Random) -> list[Any]:
    return [waited(f) for f in [cell.client.begin(fresh(rng)) for _ in range(30)]]


def limited(cell: Cell, rng: random.Random, kind: int, most: int) -> list[Any]:
    """The answer for a new part while the planning process has only so much of a resource."""
    worker = cell.node.worker()
    before = resource.prlimit(worker, kind)
    resource.prlimit(worker, kind, (most, before[1]))
    try:
        with cell.part(rng) as (mesh_id, _):
            goal = goal_of(cell, mesh_id)
            return [goal.answer()]
    finally:
        with suppress(ProcessLookupError):
            resource.prlimit(worker, kind, before)


@fault("planning process out of memory", FOUND, Code.OUT_OF_MEMORY, Code.MESH_UNREADABLE,
       Code.PLANNING_PROCESS_LOST)  # fmt: skip
def _no_memory(cell: Cell, rng: random.Random) -> list[Any]:
    pages = int(Path(f"/proc/{cell.node.worker()}/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + rng.randrange(1, 150) * 10**6
    return limited(cell, rng, resource.RLIMIT_AS, most)


@fault("planning process out of descriptors", FOUND, Code.OUT_OF_MEMORY, Code.MESH_UNREADABLE)
def _no_descriptors(cell: Cell, rng: random.Random) -> list[Any]:
    used = max(int(p.name) for p in Path(f"/proc/{cell.node.worker()}/fd").iterdir())
    return limited(cell, rng, resource.RLIMIT_NOFILE, used + rng.randrange(1, 8))


def fresh(rng: random.Random, **fields: Any) -> Any:
    """A request for a plan of the sphere that is not in memory."""
    return plan_request("sphere", **{"seed": rng.randrange(2**31), **fields})
