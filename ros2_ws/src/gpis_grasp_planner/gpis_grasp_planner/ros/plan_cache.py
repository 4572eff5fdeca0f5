"""Plans that were made, by mesh file, settings and request; in memory."""

from __future__ import annotations

import hashlib
import json
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from gpis_grasp_planner.ros.worker.messages import Plan, PlanOrder

# What is done with a plan afterwards, at each place anew, does not make it another plan.
AFTERWARDS = ("clearance", "uncertainty")


def plan_key(order: PlanOrder, mesh_fingerprint: str) -> str:
    """One string for everything that decides which plan in free space is asked for.

    How its grasps are tried in physics, where the first request has its part, is not part of it.
    """
    settings = {name: group for name, group in order.settings.items() if name not in AFTERWARDS}
    content: Mapping[str, Any] = {
        **asdict(replace(order, present=None)),
        "settings": settings,
        "mesh": mesh_fingerprint,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


class PlanCache:
    """A bounded store of plans; the least recently used goes first. Safe to use from threads."""

    def __init__(self, size: int) -> None:
        self.size = size
        self._plans: OrderedDict[str, Plan] = OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._plans)

    def get(self, key: str) -> Plan | None:
        """Look a plan up; it counts as used."""
        with self._lock:
            plan = self._plans.get(key)
            if plan is not None:
                self._plans.move_to_end(key)
            return plan

    def put(self, key: str, plan: Plan) -> None:
        """Keep a plan, and drop the oldest beyond `size`."""
        with self._lock:
            self._plans[key] = plan
            self._plans.move_to_end(key)
            while len(self._plans) > self.size:
                self._plans.popitem(last=False)
