"""One thread for BLAS in whatever process uses the planner, unless it was told otherwise."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import gpis_grasp_planner
from gpis_grasp_planner.thread_limits import THREAD_VARIABLES, limit_threads

PACKAGE_ROOT = Path(gpis_grasp_planner.__file__).parents[1]

# Threads of a process that has used the linear algebra of numpy and of scipy, each with a library
# of its own, on matrices that are large enough for threads. OpenBLAS starts as many as it may use
# when it is loaded, but no more than there are processors.
COUNT = """
import {module}
import numpy as np
import scipy.linalg
a = np.ones((600, 600)) + 600.0 * np.eye(600)
a @ a
scipy.linalg.cho_factor(a)
print(*[line.split()[1] for line in open("/proc/self/status") if line.startswith("Threads:")])
"""


def threads(module: str, **given: str) -> int:
    environment = {k: v for k, v in os.environ.items() if k not in THREAD_VARIABLES}
    done = subprocess.run(
        [sys.executable, "-c", COUNT.format(module=module)],
        env={**environment, "PYTHONPATH": str(PACKAGE_ROOT), **given},
        capture_output=True,
        text=True,
        check=True,
    )
    return int(done.stdout.split()[-1])


@pytest.mark.parametrize(
    "module",
    ["gpis_grasp_planner", "gpis_grasp_planner.cli.main", "gpis_grasp_planner.plan.planner"],
)
def test_whoever_imports_the_planner_has_one_thread(module: str) -> None:
    assert threads(module) == 1


def test_a_number_that_is_set_stays() -> None:
    """Two threads in each of the two libraries, where there are two processors for them."""
    expected = 3 if (os.cpu_count() or 1) >= 2 else 1
    assert threads("gpis_grasp_planner", OMP_NUM_THREADS="2") == expected


def test_only_what_is_not_set_is_set() -> None:
    environment = {"OPENBLAS_NUM_THREADS": "3"}
    limit_threads(environment)
    assert environment == dict.fromkeys(THREAD_VARIABLES, "1") | {"OPENBLAS_NUM_THREADS": "3"}
    environment = {"OMP_NUM_THREADS": "4"}
    limit_threads(environment)
    assert environment == dict.fromkeys(THREAD_VARIABLES, "4")


LIMITED = """
import numpy as np, scipy.linalg
from threadpoolctl import threadpool_info
from gpis_grasp_planner.thread_limits import limited_threads

def most():
    return max(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")

before = most()
with limited_threads():
    within = most()
    with limited_threads():
        nested = most()
print(before, within, nested, most())
"""


@pytest.mark.parametrize("given", [None, "", "1,4", "many"])
def test_numpy_that_was_there_first_is_limited_while_a_plan_is_made(given: str | None) -> None:
    environment = {k: v for k, v in os.environ.items() if k not in THREAD_VARIABLES}
    environment["PYTHONPATH"] = str(PACKAGE_ROOT)
    if given is not None:
        environment["OMP_NUM_THREADS"] = given
    done = subprocess.run(
        [sys.executable, "-c", LIMITED], env=environment, capture_output=True, text=True, check=True
    )
    before, within, nested, after = (int(word) for word in done.stdout.split())
    assert before == after
    if given != "1,4":
        assert (before > 1) == ((os.cpu_count() or 1) > 1)
    assert within == nested == 1


PLANNED = """
import numpy as np, scipy.linalg
from threadpoolctl import threadpool_info
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest

seen = []

def look(progress):
    pools = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
    seen.append(max(pools))

part = MeshCatalogue([default_catalogue_directory()]).load("sphere")
request = PlanRequest(max_evaluations=50, verification="none")
GraspPlanner().plan(part, request, on_progress=look)
print(len(seen), max(seen))
"""


def test_a_plan_is_made_with_one_thread() -> None:
    environment = {k: v for k, v in os.environ.items() if k not in THREAD_VARIABLES}
    environment["PYTHONPATH"] = str(PACKAGE_ROOT)
    done = subprocess.run(
        [sys.executable, "-c", PLANNED], env=environment, capture_output=True, text=True, check=True
    )
    looks, most = (int(word) for word in done.stdout.split()[-2:])
    assert looks > 0
    assert most == 1
