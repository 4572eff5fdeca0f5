"""What the commands say beside their result: notes, and progress where stderr is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from gpis_grasp_planner.plan.progress import Progress as PlanProgress


def console() -> Console:
    """The console of progress: stderr, silent where that is no terminal."""
    return Console(file=sys.stderr, highlight=False)


def note(message: str) -> None:
    """Tell people something on stderr."""
    print(message, file=sys.stderr)


def check_writable(path: Path | None) -> None:
    """Refuse a file that cannot be written before the work is done, not after it.

    Raises
    ------
    RequestError
        With the directory that is missing.
    """
    from gpis_grasp_planner.errors import RequestError

    if path is None or str(path) == "-":
        return
    if path.is_dir() or not path.parent.is_dir():
        fault = "is a directory" if path.is_dir() else f"needs the directory {path.parent}"
        raise RequestError(f"Cannot write {path}: it {fault}. Name a file in a directory there is.")


@contextmanager
def plan_progress() -> Iterator[Callable[[PlanProgress], None]]:
    """Show a bar over the time budget with the best epsilon so far; silent without a terminal."""
    columns = (
        TextColumn("{task.fields[phase]}"),
        BarColumn(),
        TextColumn("{task.completed:.1f} of {task.total:g} s"),
        TextColumn("best epsilon {task.fields[epsilon]}"),
        TextColumn("{task.fields[attempts]} grasps tried"),
    )
    screen = console()
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task("", total=1.0, phase="planning", epsilon="-", attempts=0, visible=False)

        def show(progress: PlanProgress) -> None:
            best = f"{progress.best_epsilon:.4f}" if progress.best_epsilon > 0.0 else "-"
            bar.update(
                task,
                total=progress.time_budget_s,
                phase=progress.phase,
                completed=min(progress.elapsed_s, progress.time_budget_s),
                epsilon=best,
                attempts=progress.evaluations,
                visible=True,
            )

        yield show


@contextmanager
def count_progress(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """Show a bar over `total` things, moved on by the name of each; silent without a terminal."""
    screen = console()
    columns = (
        TextColumn(what),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[last]}"),
    )
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task("", total=total, last="")
        yield lambda name: bar.update(task, advance=1, last=name)
