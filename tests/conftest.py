"""What all tests share: one printed seed, a ROS domain of their own, and one thread for BLAS."""

from __future__ import annotations

import os
import zlib

# Before numpy is imported: figures and CPU times are those of one core, for tests and what they
# start, however pytest was called.
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["NUMBA_NUM_THREADS"] = "1"
# Every run prepares its meshes anew, and leaves nothing in the user's cache.
os.environ["GPIS_GRASP_CACHE"] = "off"
os.environ["GPIS_GRASP_STORE"] = "off"

import hypothesis
import numpy as np
import pytest

pytest_plugins = ["planning_fixtures"]

# Examples are the same on every run and machine, and slow machines are no failures.
hypothesis.settings.register_profile("workspace", derandomize=True, deadline=None)
hypothesis.settings.load_profile("workspace")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seed", type=int, default=20240607, help="seed of the fixture rng")


def pytest_configure(config: pytest.Config) -> None:
    # Neither a robot in the next room nor a second test run may hear these nodes, nor those of the
    # other workers of this run, whose own numbers may be 101 apart. Domains up to 101 keep clear
    # of the ephemeral ports.
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    run = os.getppid() if worker else os.getpid()
    number = run + int(worker.removeprefix("gw") or 0)
    os.environ["ROS_DOMAIN_ID"] = str(1 + number % 101)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def pytest_report_header(config: pytest.Config) -> str:
    return f"seed: {config.getoption('seed')}, ROS domain: {os.environ['ROS_DOMAIN_ID']}"


@pytest.fixture
def seed(request: pytest.FixtureRequest) -> int:
    """Seed of one test: from ``--seed`` and the test's name, so the order of tests is free."""
    value = (request.config.getoption("seed") + zlib.crc32(request.node.nodeid.encode())) % 2**31
    print(f"seed of {request.node.nodeid}: {value}")
    return value


@pytest.fixture
def rng(seed: int) -> np.random.Generator:
    """Random numbers of one test, repeatable."""
    return np.random.default_rng(seed)
