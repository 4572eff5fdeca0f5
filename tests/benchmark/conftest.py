"""Records and runs that need no planning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from gpis_grasp_benchmark.command import main
from gpis_grasp_benchmark.runs import Run
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.plan.settings import PlannerSettings


@dataclass(frozen=True)
class Answer:
    """What the command answered."""

    code: int
    err: str


@pytest.fixture
def benchmark(capsys: pytest.CaptureFixture[str]) -> Callable[..., Answer]:
    """Return a function that runs the command with arguments."""

    def call(*arguments: object) -> Answer:
        capsys.readouterr()
        code = main([str(a) for a in arguments])
        return Answer(code, capsys.readouterr().err)

    return call


@pytest.fixture
def make_run() -> Callable[..., Run]:
    """Return a function that makes runs, by default of the mug."""

    def make(**changes: Any) -> Run:
        values = {
            "object_id": "mug",
            "object_hash": "0" * 16,
            "planner": "hpp",
            "seed": 0,
            "time_budget_s": 20.0,
            "max_evaluations": None,
            "n_grasps": 20,
            "friction": Friction(0.3, 0.2),
            "settings": PlannerSettings().as_dict(),
        }
        return Run(**{**values, **changes})

    return make


@pytest.fixture
def make_record(make_run: Callable[..., Run]) -> Callable[..., dict[str, Any]]:
    """Return a function that makes the record of a run with given qualities."""

    def make(
        epsilon: list[float], volume: list[float] | None = None, **changes: Any
    ) -> dict[str, Any]:
        extra = {k: changes.pop(k) for k in ("extent_m", "environment", "cpu_s") if k in changes}
        run = make_run(**changes)
        return {
            "key": run.key,
            **run.identity(),
            "settings": run.settings,
            "extent_m": [0.119, 0.084, 0.095],
            "mass": 0.4,
            "code": 0 if epsilon else 400,
            "status": "SUCCESS" if epsilon else "NO_FEASIBLE_GRASP",
            "message": "",
            "elapsed_s": 20.0,
            "cpu_s": 20.0,
            "n_evaluations": 5000,
            "epsilon": epsilon,
            "volume": volume if volume is not None else [0.1 * e for e in epsilon],
            "convergence": [[1.0, 100, 0.01], [4.0, 900, max(epsilon, default=0.02)]],
            "environment": {
                "source": "aa",
                "python": "3.11",
                "numpy": "2",
                "scipy": "1",
                "numba": "0",
                "cpu": "some cpu",
                "cpu_count": 2,
            },
            **extra,
        }

    return make
