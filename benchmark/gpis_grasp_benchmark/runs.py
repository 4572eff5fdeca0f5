"""One run of the benchmark: an object, a planner and a seed in; a record of plain values out."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import gpis_grasp_planner
from gpis_grasp_benchmark import rivals
from gpis_grasp_planner import __version__
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.plan.document import document_text
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.plan.settings import PlannerSettings

Record = dict[str, Any]

# Equal evaluations instead of equal time: the clock must not end such a run.
MOST_SECONDS = 600.0
EDGES = frozenset({"cli", "ros", "view", "verification", "store"})
_LIBRARIES = ("numpy", "scipy", "numba")


class Task(Protocol):
    """What can be made in a process of its own and kept in a store."""

    @property
    def object_id(self) -> str:
        """The object it is about."""
        ...

    @property
    def key(self) -> str:
        """What a finished one is recognised by."""
        ...

    @property
    def name(self) -> str:
        """A readable name."""
        ...

    @property
    def longest_s(self) -> float:
        """Time it may take beside imports and compiling."""
        ...

    def make(self, part: Part) -> tuple[Record, str]:
        """Do it in this process: the record, and a document with the grasps."""
        ...


@dataclass(frozen=True)
class Run:
    """Everything that decides a run's outcome, but for the clock.

    Attributes
    ----------
    object_id : str
    object_hash : str
        Of mesh and centre of mass, see :func:`object_hash`.
    planner : str
    seed : int
    time_budget_s : float
    max_evaluations : int or None
        Ends the search after so many attempts; the time budget then ends nothing.
    n_grasps : int
    friction : Friction
    settings : mapping
        Values by group and name.
    version : str
        Of the package.
    """

    object_id: str
    object_hash: str
    planner: str
    seed: int
    time_budget_s: float
    max_evaluations: int | None
    n_grasps: int
    friction: Friction
    settings: Mapping[str, Mapping[str, Any]] = field(hash=False)
    version: str = __version__

    @property
    def settings_hash(self) -> str:
        """Hash over all settings."""
        return hash_of(self.settings)

    def identity(self) -> Record:
        """What a finished run is recognised by."""
        return {
            "object_id": self.object_id,
            "object_hash": self.object_hash,
            "planner": self.planner,
            "seed": self.seed,
            "time_budget_s": None if self.max_evaluations else self.time_budget_s,
            "max_evaluations": self.max_evaluations,
            "n_grasps": self.n_grasps,
            "friction": {"finger": self.friction.finger, "palm": self.friction.palm},
            "settings_hash": self.settings_hash,
            "version": self.version,
        }

    @property
    def key(self) -> str:
        """Hash of the identity (16 hexadecimal digits)."""
        return hash_of(self.identity())

    @property
    def name(self) -> str:
        """A readable name, unique together with the key."""
        return f"{self.object_id}-{self.planner}-{self.seed}"

    @property
    def longest_s(self) -> float:
        """The time budget."""
        return self.request().time_budget_s

    def make(self, part: Part) -> tuple[Record, str]:
        """Make the run in this process, see :func:`execute`."""
        record, result = execute(self, part)
        return record, document_text(result)

    def request(self) -> PlanRequest:
        """Return the planner's request."""
        limited = self.max_evaluations is not None
        return PlanRequest(
            planner=self.planner,
            seed=self.seed,
            time_budget_s=MOST_SECONDS if limited else self.time_budget_s,
            n_grasps=self.n_grasps,
            friction=self.friction,
            max_evaluations=self.max_evaluations,
        )


def object_hash(part: Part) -> str:
    """Hash of what the quality of a grasp depends on: geometry and centre of mass."""
    center = np.ascontiguousarray(part.center_of_mass, dtype="<f8").tobytes()
    return hashlib.sha256(part.mesh.content_hash.encode() + center).hexdigest()[:16]


def execute(run: Run, part: Part) -> tuple[Record, PlanResult]:
    """Make the run in this process.

    The preparation of the object (surface, distance field) counts as planning time; compiling
    and loading compiled code does not: that happens before the clock starts.

    Returns
    -------
    record : dict
        Identity, settings, outcome, environment: values of JSON only.
    result : PlanResult
    """
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.warm_up import warm_up

    settings = PlannerSettings.from_mapping(run.settings)
    here = environment()  # before the sources could change
    warm_up([run.planner])
    planner = GraspPlanner(settings)
    cpu = time.process_time()
    result = planner.plan(part, run.request())
    cpu = time.process_time() - cpu
    record = {
        "key": run.key,
        **run.identity(),
        "settings": {group: dict(values) for group, values in run.settings.items()},
        "extent_m": [float(side) for side in part.mesh.extent],
        "mass": float(part.mass),
        "code": int(result.code),
        "status": result.code.name,
        "message": result.message,
        "elapsed_s": float(result.elapsed_s),
        "cpu_s": cpu,
        "n_evaluations": int(result.evaluations),
        "epsilon": [float(g.epsilon) for g in result.grasps],
        "volume": [float(g.volume) for g in result.grasps],
        "convergence": [[float(t), int(n), float(e)] for t, n, e in result.convergence],
        "environment": here,
    }
    return record, result


@lru_cache(maxsize=1)
def environment() -> Record:
    """Versions and machine; `source` is a hash over the package's sources."""
    return {
        "source": source_hash(),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in _LIBRARIES},
        "cpu": _cpu_model(),
        "cpu_count": os.cpu_count(),
    }


def source_hash(edges: Collection[str] = EDGES) -> str:
    """Hash over the sources and data that planning depends on, rivals included, not the edges."""
    digest = hashlib.sha256()
    for root in (Path(gpis_grasp_planner.__file__).parent, Path(rivals.__file__).parent):
        for path in sorted(root.rglob("*")):
            inside = path.relative_to(root)
            if path.suffix in {".py", ".yaml", ".urdf"} and inside.parts[0] not in edges:
                digest.update(inside.as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def hash_of(values: Any) -> str:
    """Hash of values of JSON (16 hexadecimal digits)."""
    text = json.dumps(values, sort_keys=True, separators=(",", ":"), default=list)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
