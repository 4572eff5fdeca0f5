"""Requests that were made bad in random places, on a live node: answers, codes, time, log.

    python tests/benchmarks/node_fuzz.py --requests 100000 --seed 0

Some are in flight at a time. Of every fifty one is good and known, and must come from memory. A
search is given half a second at most. Exit code 1 where anything was wrong.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import sys
import tempfile
import time
from collections import Counter, deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 101))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("GPIS_GRASP_STORE", "off")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmark_report import add_report_option, report
from geometry_msgs.msg import PoseStamped, PoseWithCovariance
from live_node import LiveNode, NodeClient, plan_request, waited
from message_mutations import mutate

from gpis_grasp_msgs.msg import PartPose, PartPoses
from gpis_grasp_planner.errors import ErrorCode

HANG_S = 10.0
IN_FLIGHT = 8
# 107 is of files; 502 is what must not be.
ALLOWED = {int(code) for code in ErrorCode} - {ErrorCode.INTERNAL, ErrorCode.INVALID_DOCUMENT}
GOOD = ("mug", "sphere")


@dataclass
class Sent:
    """A request on its way."""

    k: int
    changed: list[str]
    good: bool
    since: float
    future: Any


def made(rng: random.Random) -> tuple[Any, list[str]]:
    """A changed request, and what was changed."""
    request = plan_request(rng.choice(GOOD))
    if rng.random() < 0.2:
        request.object_pose = PoseStamped()  # from the estimates, which are bad as well
    if rng.random() < 0.2:
        request.support_plane.header.frame_id = "world"
        request.support_plane.pose.position.z = -0.1
    changed = mutate(request, rng, rng.choice([1, 1, 1, 2, 4, 12]))
    if 0.1 <= request.time_budget <= 120.0 or request.time_budget == 0.0:
        request.time_budget = rng.choice([0.1, 0.5, 0.5, 0.5])
    return request, changed


def estimates(rng: random.Random) -> PartPoses:
    """Estimates of parts, of which some field is bad."""
    pose = PoseWithCovariance()
    pose.pose.orientation.w = 1.0
    part = PartPose(mesh_id=rng.choice(GOOD), pose=pose)
    part.header.frame_id = "world"
    mutate(part, rng, rng.randrange(3))
    return PartPoses(parts=[part])


class Fuzzing:
    """Sends requests and judges what comes back."""

    def __init__(self, client: NodeClient) -> None:
        self._client = client
        self._open: deque[Sent] = deque()
        self.codes: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.longest_s = 0.0

    def send(self, k: int, rng: random.Random) -> None:
        good = k % 50 == 0
        request, changed = made(rng) if not good else (plan_request(rng.choice(GOOD)), [])
        known = not good and rng.random() < 0.5
        if rng.random() < 0.1:
            self._client.parts.publish(estimates(rng))
        future = self._client.begin(request, only_known=known)
        self._open.append(Sent(k, changed, good, time.monotonic(), future))

    def settle(self, most: int) -> None:
        """Wait until at most so many are open."""
        while len(self._open) > most:
            sent = self._open.popleft()
            answer = waited(sent.future, 6 * HANG_S)
            self._judge(sent, answer, time.monotonic() - sent.since)

    def _judge(self, sent: Sent, answer: Any, seconds: float) -> None:
        where = f"request {sent.k} ({', '.join(sent.changed)})"
        if answer is None:
            self.wrong.append(f"{where}: no answer")
            return
        self.longest_s = max(self.longest_s, seconds)
        known = answer.code in ErrorCode.__members__.values()
        self.codes[ErrorCode(answer.code).name if known else str(answer.code)] += 1
        if seconds > HANG_S:
            self.wrong.append(f"{where}: after {seconds:.1f} s")
        if answer.code not in ALLOWED:
            self.wrong.append(f"{where}: code {answer.code}: {answer.message}")
        if sent.good and not (answer.success and answer.from_cache):
            self.wrong.append(f"{where}: good, but {answer.code}: {answer.message}")
        if not answer.success and (not answer.message or not answer.message.isprintable()):
            self.wrong.append(f"{where}: the message {answer.message!r}")
        if not all(map(finite, answer.grasps)):
            self.wrong.append(f"{where}: a number of a grasp is not finite")


def finite(grasp: Any) -> bool:
    """Whether the pose and the quality of a grasp are numbers."""
    p, q = grasp.palm_pose.pose.position, grasp.palm_pose.pose.orientation
    return all(map(math.isfinite, (p.x, p.y, p.z, q.x, q.y, q.z, q.w, grasp.epsilon)))


def main() -> int:
    """Print what came, and what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=100_000, help="(100000)")
    parser.add_argument("--seed", type=int, default=0, help="(0)")
    add_report_option(parser, "fuzz.md")
    options = parser.parse_args()
    with report(options.report, "Requests made bad in random places"):
        return fuzz(options)


def fuzz(options: argparse.Namespace) -> int:
    """Send all requests; 1 where anything was wrong."""
    print(f"seed {options.seed}", flush=True)
    log = Path(tempfile.mkdtemp(prefix="gpis_fuzz_")) / "node.log"
    node = LiveNode(log, {"default_planner": "hpp", "default_verification": "none"})
    with node, NodeClient("fuzz") as client:
        fuzzing, began = Fuzzing(client), time.monotonic()
        for mesh_id in GOOD:
            while not (answer := client.call(plan_request(mesh_id))) or not answer.success:
                time.sleep(0.1)
        worker = node.worker()
        for k in range(options.requests):
            fuzzing.settle(IN_FLIGHT - 1)
            fuzzing.send(k, random.Random(f"{options.seed}/{k}"))
        fuzzing.settle(0)
        seconds = time.monotonic() - began
        lost = node.worker() != worker
    wrong = fuzzing.wrong
    for sign in ("Traceback", "In the executor", "An answer was not sent"):
        if n := node.text().count(sign):
            wrong.append(f"log: {n} times '{sign}' in {log}")
    if lost:
        wrong.append(f"the planning process was lost: {log}")
    print(f"{options.requests} requests in {seconds:.0f} s; longest {fuzzing.longest_s:.2f} s")
    print(", ".join(f"{name} {n}" for name, n in fuzzing.codes.most_common()))
    print(f"{len(wrong)} wrong")
    print("\n".join(wrong[:50]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
