"""Plans that were made, by mesh file, settings and request; in memory."""

from __future__ import annotations

import hashlib
import itertools
import json
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

from gpis_grasp_planner.ros.worker.messages import Plan, PlanOrder
from gpis_grasp_planner.surroundings.place import STAND_IN, Place
from gpis_grasp_planner.surroundings.similarity import same_place

# About a part's origin: supports are compared as far as a hand may reach beside it.
_RADIUS_M = 0.2

# What is done with a plan afterwards, at each place anew, does not make it another plan.
AFTERWARDS = ("clearance", "uncertainty")


class PlanKey(NamedTuple):
    """Stands for everything that decides which plan is asked for, but for the place.

    Attributes
    ----------
    mesh_id : str
    seed : int
    digest : str
        Of all that there is, these two included.
    """

    mesh_id: str
    seed: int
    digest: str


def plan_key(order: PlanOrder, mesh_fingerprint: str) -> PlanKey:
    """The key of what an order asks for.

    A plan for one place is the beginning of one for another.
    """
    content: Mapping[str, Any] = {
        "mesh_id": order.mesh_id,
        "mesh_directories": order.mesh_directories,
        "request": asdict(order.request),
        "mesh": mesh_fingerprint,
    }
    text = json.dumps(content, sort_keys=True, default=str) + _settings_text(order.settings)
    digest = hashlib.sha256(text.encode()).hexdigest()
    return PlanKey(order.mesh_id, order.request.seed, digest)


# The node hands the same mapping over until a parameter changes.
_last_settings: tuple[object, str] = (None, "")


def _settings_text(settings: Mapping[str, Mapping[str, Any]]) -> str:
    global _last_settings
    known, text = _last_settings
    if known is not settings:
        decisive = {name: group for name, group in settings.items() if name not in AFTERWARDS}
        text = json.dumps(decisive, sort_keys=True, default=str)
        _last_settings = settings, text
    return text


class PlanCache:
    """A bounded store of plans; the least recently used goes first. Safe to use from threads.

    Of one key it holds plans for several places: a part stands on this table now, on that later.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._plans: OrderedDict[tuple[PlanKey, int], Plan] = OrderedDict()
        self._lock = threading.Lock()
        self._numbers = itertools.count()

    def __len__(self) -> int:
        return len(self._plans)

    def count(self, mesh_id: str) -> int:
        """Plans of one mesh."""
        with self._lock:
            return sum(plan.mesh_id == mesh_id for plan in self._plans.values())

    def may_have(self, mesh_id: str, seed: int) -> bool:
        """Whether a plan of this mesh and seed is here, whatever else it was made for."""
        with self._lock:
            return any(key[:2] == (mesh_id, seed) for key, _ in self._plans)

    def get(self, key: PlanKey, place: Place | None = None) -> Plan | None:
        """The plan made for surroundings like these, else the latest for any; it counts as used.

        Parameters
        ----------
        key : PlanKey
        place : Place, optional
            None for free space.
        """
        place = Place() if place is None else place
        with self._lock:
            names = [name for name in reversed(self._plans) if name[0] == key]
            if not names:
                return None
            same = [name for name in names if _made_for(self._plans[name], place)]
            name = (same or names)[0]
            self._plans.move_to_end(name)
            return self._plans[name]

    def put(self, key: PlanKey, plan: Plan) -> None:
        """Keep a plan in place of one for the same surroundings; drop the oldest beyond `size`."""
        place = _place(plan)
        with self._lock:
            for name in [name for name in self._plans if name[0] == key]:
                if _made_for(self._plans[name], place):
                    del self._plans[name]
            self._plans[key, next(self._numbers)] = plan
            while len(self._plans) > self.size:
                self._plans.popitem(last=False)


def _made_for(plan: Plan, place: Place) -> bool:
    return same_place(_place(plan), place, _RADIUS_M)


def _place(plan: Plan) -> Place:
    return Place() if plan.place is None else Place.from_mapping(plan.place, lambda _: STAND_IN)
