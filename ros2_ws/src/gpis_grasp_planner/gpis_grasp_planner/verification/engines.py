"""The engines that there are, by name. A further one is a module and a line here.

An engine's library is imported when it is asked for: MuJoCo is an optional extra.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.engine import Engine
from gpis_grasp_planner.verification.settings import VerificationSettings

ENGINES = ("bullet", "mujoco")


def engine_names(choice: str) -> tuple[str, ...]:
    """Names of the engines that a choice of the settings asks for; a grasp has to hold in each.

    Raises
    ------
    RequestError
        Where the library of one of them is not installed.
    """
    installed = find_spec("mujoco") is not None
    if choice == "auto":
        return ("mujoco",) if installed else ("bullet",)
    names = ENGINES if choice == "both" else (choice,)
    if "mujoco" in names and not installed:
        raise RequestError(
            f"verification.engine is '{choice}', but MuJoCo is not installed here. Install it "
            "(pip install mujoco), or choose 'bullet'.",
            ErrorCode.INVALID_SETTING,
        )
    return names


def second_engines(choice: str) -> tuple[str, ...]:
    """Engines beside the chosen one that a verdict can be compared with: only for "auto"."""
    if choice != "auto":
        return ()
    return ("bullet",) if engine_names(choice) == ("mujoco",) else ()


def load(choice: str, hand: HandDescription) -> None:
    """Import and make what every trial needs, so that forked children have it.

    The first time MuJoCo takes 0.2 s, and hulls that are not on disk 0.4 s.
    """
    for name in engine_names(choice):
        _LOADERS[name](hand)


def make_engine(
    name: str, hand: HandDescription, part: Part, settings: VerificationSettings
) -> Engine:
    """Make an engine of one of :func:`engine_names`, not yet entered."""
    return _MAKERS[name](hand, part, settings)


def _bullet(hand: HandDescription, part: Part, settings: VerificationSettings) -> Engine:
    from gpis_grasp_planner.verification.bullet.engine import BulletEngine

    return BulletEngine(hand, part, settings)


def _mujoco(hand: HandDescription, part: Part, settings: VerificationSettings) -> Engine:
    from gpis_grasp_planner.verification.mujoco.engine import MujocoEngine

    return MujocoEngine(hand, part, settings)


def _load_bullet(hand: HandDescription) -> None:
    from gpis_grasp_planner.verification.bullet.bodies import link_hulls

    link_hulls(hand)


def _load_mujoco(_: HandDescription) -> None:
    import gpis_grasp_planner.verification.mujoco.model  # noqa: F401, the import is what is wanted


_MAKERS: dict[str, Callable[[HandDescription, Part, VerificationSettings], Engine]] = {
    "bullet": _bullet,
    "mujoco": _mujoco,
}
_LOADERS: dict[str, Callable[[HandDescription], None]] = {
    "bullet": _load_bullet,
    "mujoco": _load_mujoco,
}
