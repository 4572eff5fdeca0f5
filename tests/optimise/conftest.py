"""Problems with known optima, shared by the tests of the optimiser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.optimise.distances import PoseDistance, pose_features
from gpis_grasp_planner.optimise.domain import BoxDomain

HARTMANN_WEIGHTS = np.array([1.0, 1.2, 3.0, 3.2])
HARTMANN_3_A = np.array([[3.0, 10, 30], [0.1, 10, 35], [3.0, 10, 30], [0.1, 10, 35]])
HARTMANN_3_P = 1e-4 * np.array(
    [[3689, 1170, 2673], [4699, 4387, 7470], [1091, 8732, 5547], [381, 5743, 8828]]
)
HARTMANN_6_A = np.array(
    [
        [10, 3, 17, 3.5, 1.7, 8],
        [0.05, 10, 17, 0.1, 8, 14],
        [3, 3.5, 1.7, 10, 17, 8],
        [17, 8, 0.05, 10, 0.1, 14],
    ]
)
HARTMANN_6_P = 1e-4 * np.array(
    [
        [1312, 1696, 5569, 124, 8283, 5886],
        [2329, 4135, 8307, 3736, 1004, 9991],
        [2348, 1451, 3522, 2883, 3047, 6650],
        [4047, 8828, 8732, 5743, 1091, 381],
    ]
)


@dataclass(frozen=True)
class Problem:
    """A function to maximise over a domain, with its known maximum."""

    function: Callable[[np.ndarray], float]
    domain: BoxDomain
    maximum: float
    argmax: np.ndarray


def branin(x: np.ndarray) -> float:
    a, b = x
    c = b - 5.1 / (4 * np.pi**2) * a * a + 5 / np.pi * a - 6
    return -(c**2 + 10 * (1 - 1 / (8 * np.pi)) * np.cos(a) + 10)


def hartmann_3(x: np.ndarray) -> float:
    return float(HARTMANN_WEIGHTS @ np.exp(-(HARTMANN_3_A * (x - HARTMANN_3_P) ** 2).sum(1)))


def hartmann_6(x: np.ndarray) -> float:
    return float(HARTMANN_WEIGHTS @ np.exp(-(HARTMANN_6_A * (x - HARTMANN_6_P) ** 2).sum(1)))


def rosenbrock(x: np.ndarray) -> float:
    return -(100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2)


def ackley(x: np.ndarray) -> float:
    return float(
        20 * np.exp(-0.2 * np.sqrt((x @ x) / len(x)))
        + np.exp(np.cos(2 * np.pi * x).mean())
        - 20
        - np.e
    )


@pytest.fixture(scope="session")
def problems() -> dict[str, Problem]:
    """Textbook functions, negated where they are to be minimised."""
    return {
        "branin": Problem(
            branin, BoxDomain([-5, 0], [10, 15]), -0.39788736, np.array([np.pi, 2.275])
        ),
        "hartmann_3": Problem(
            hartmann_3,
            BoxDomain([0] * 3, [1] * 3),
            3.86278215,
            np.array([0.114614, 0.555649, 0.852547]),
        ),
        "hartmann_6": Problem(
            hartmann_6,
            BoxDomain([0] * 6, [1] * 6),
            3.32236801,
            np.array([0.20169, 0.150011, 0.476874, 0.275332, 0.311652, 0.6573]),
        ),
        "rosenbrock": Problem(rosenbrock, BoxDomain([-2, -1], [2, 3]), 0.0, np.ones(2)),
        "ackley": Problem(ackley, BoxDomain([-4, -4], [8, 8]), 0.0, np.zeros(2)),
    }


def hyperspherical_quaternion(angles: np.ndarray) -> np.ndarray:
    """Unit quaternions (n, 4) of the paper's three angles (n, 3)."""
    phi, psi, theta = angles.T
    return np.stack(
        [
            np.sin(phi) * np.sin(psi) * np.sin(theta),
            np.sin(phi) * np.sin(psi) * np.cos(theta),
            np.sin(phi) * np.cos(psi),
            np.cos(phi),
        ],
        axis=1,
    )


def pose_coordinate_features(X: np.ndarray) -> np.ndarray:
    return pose_features(X[:, :3], hyperspherical_quaternion(X[:, 3:]))


@pytest.fixture(scope="session")
def pose_problem() -> Problem:
    """A function on SE(3) with ripples, whose maximum is 1 at a known pose."""
    domain = BoxDomain(
        [-0.2] * 3 + [0.0] * 3,
        [0.2] * 3 + [np.pi, np.pi, 2 * np.pi],
        periodic=[False] * 5 + [True],
        features=pose_coordinate_features,
        distance=PoseDistance((0.02, 0.8), (0.15, 4.0)),
    )
    goal = np.array([0.05, -0.08, 0.11, 1.1, 2.0, 4.0])
    goal_rotation = Rotation.from_quat(hyperspherical_quaternion(goal[None, 3:])[0])

    def function(x: np.ndarray) -> float:
        rotation = Rotation.from_quat(hyperspherical_quaternion(x[None, 3:])[0])
        angle = (goal_rotation.inv() * rotation).magnitude()
        distance = float(np.linalg.norm(x[:3] - goal[:3]))
        bump = np.exp(-0.5 * (distance / 0.12) ** 2 - 0.5 * (angle / 0.9) ** 2)
        return float(bump - 0.02 * (1 - np.cos(60 * distance)))

    return Problem(function, domain, 1.0, goal)


@pytest.fixture(scope="session")
def random_poses() -> Callable[[int, int], tuple[np.ndarray, np.ndarray]]:
    """(n, seed) -> translations (n, 3) in a 0.4 m cube and uniform quaternions (n, 4)."""

    def draw(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(seed)
        return rng.uniform(-0.2, 0.2, (n, 3)), Rotation.random(n, rng=rng).as_quat()

    return draw
