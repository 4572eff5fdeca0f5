"""What is said where a library of an optional extra of the distribution is not installed."""

from __future__ import annotations

from importlib.util import find_spec


def is_installed(module: str) -> bool:
    """Whether a module is there, without importing it."""
    return find_spec(module) is not None


def how_to_install(purpose: str, library: str, extra: str) -> str:
    """One line for an error: what is missing for what, and the command that installs it."""
    return (
        f"{purpose} needs {library}: not installed here. Run "
        f"pip install 'gpis-grasp-planner[{extra}]'."
    )
