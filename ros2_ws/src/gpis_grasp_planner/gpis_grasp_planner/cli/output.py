"""What the commands print: tables on stdout, progress on stderr where that is a terminal."""

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
    from collections.abc import Callable, Sequence

    from rich.table import Table

    from gpis_grasp_planner.benchmark.tables import Summary
    from gpis_grasp_planner.grasp.grasp import Grasp
    from gpis_grasp_planner.plan.progress import Progress as PlanProgress
    from gpis_grasp_planner.plan.request import PlanResult

_PLAIN_WIDTH = 120


def console(stderr: bool = False) -> Console:
    """Return a console that neither wraps nor colours what goes into a file or pipe."""
    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else _PLAIN_WIDTH
    return Console(file=stream, width=width, highlight=False, soft_wrap=not stream.isatty())


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
    screen = console(stderr=True)
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
    screen = console(stderr=True)
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


def summary_table(summaries: Sequence[Summary]) -> Table:
    """One row per object and planner of a benchmark."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    for heading in (
        "object", "planner", "best epsilon", "its volume", "mean epsilon", "mean volume",
        "grasps", "evaluations/s",
    ):  # fmt: skip
        table.add_column(heading, no_wrap=True)
    for s in summaries:
        figures = (s.best_epsilon, s.best_volume, s.mean_epsilon, s.mean_volume)
        table.add_row(
            s.object_id,
            s.planner,
            *(f"{estimate.mean:.4f}" for estimate in figures),
            f"{s.found.mean:.1f}",
            f"{s.evaluations_per_s.mean:.0f}",
        )
    return table


def trial_cells(grasp: Grasp) -> tuple[str, str]:
    """What physics said: trials passed of those made, or the cause; and the largest slip."""
    trials = grasp.trials
    if trials is None:
        return "not tried", ""
    if not trials.held:
        return trials.outcomes[0].cause, ""
    return f"{trials.n_passed} of {len(trials.outcomes)}", f"{1e3 * trials.largest_slip_m:.1f}"


def _probability(grasp: Grasp) -> str:
    return "" if grasp.hold_probability is None else f"{grasp.hold_probability:.2f}"


def grasp_table(result: PlanResult, grasps: tuple[Grasp, ...]) -> Table:
    """One row per grasp: quality, contacts and where the palm is."""
    import numpy as np
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    headings = ["#", "epsilon", "volume", "contacts", "palm position \\[mm]", "approach"]
    verified = any(grasp.trials is not None for grasp in grasps)
    if verified:
        headings += ["holds", "slip \\[mm]"]
    uncertain = any(grasp.hold_probability is not None for grasp in grasps)
    if uncertain:
        headings.append("P(hold)")
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("links in contact", overflow="fold")
    for i, grasp in enumerate(grasps):
        links = [result.link_names[k] for k in np.unique(grasp.contacts.links)]
        short = " ".join(link.removeprefix("bh_").removesuffix("_link") for link in links)
        table.add_row(
            str(i),
            f"{grasp.epsilon:.4f}",
            f"{grasp.volume:.4f}",
            str(len(grasp.contacts)),
            "".join(f"{1e3 * x:8.1f}" for x in grasp.T_object_palm[:3, 3]),
            "".join(f"{x:6.2f}" for x in grasp.approach_direction),
            *(trial_cells(grasp) if verified else ()),
            *([_probability(grasp)] if uncertain else ()),
            short.replace("finger_", "f"),
        )
    return table
