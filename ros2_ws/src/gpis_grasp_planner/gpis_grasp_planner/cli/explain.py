"""Where grasps got lost, as a table and a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import tables
from gpis_grasp_planner.cli.tables import Column

if TYPE_CHECKING:
    from gpis_grasp_planner.grasp.funnel import Funnel
    from gpis_grasp_planner.plan.request import PlanResult


def funnel_columns(funnel: Funnel) -> list[Column]:
    """One row per step: how many passed, their share of the step before, the causes."""
    rows = funnel.table
    before = [rows[0][1], *(left for _, left, _ in rows)]
    lost = [causes for _, _, causes in rows]
    main = [next(iter(causes.items()), None) for causes in lost]
    rest = [list(causes.items())[1:] for causes in lost]
    return [
        Column("step", [str(step) for step, _, _ in rows], left=True),
        Column("left", [str(left) for _, left, _ in rows]),
        Column("passed", [_share(row[1], had) for row, had in zip(rows, before, strict=False)], 1),
        Column("lost, mainly by", [_cause(pair) for pair in main], left=True),
        Column("also by", [", ".join(map(_cause, pairs)) for pairs in rest], 2, left=True),
    ]


def show(funnel: Funnel) -> None:
    """Print the table and what can be done about the main loss."""
    from gpis_grasp_planner.plan.funnel_advice import advice

    print()
    if not funnel.table[0][1]:
        tables.print_text("No hand was proposed: this was answered without a search.")
        return
    tables.print_table(funnel_columns(funnel))
    if text := advice(funnel):
        print()
        main = funnel.main_loss
        assert main is not None
        tables.print_text(f"Main loss: {main[0]}. {text}")


def show_figures(result: PlanResult) -> None:
    """Print what the figures of the grasps mean, and their range over the answer."""
    found = {
        figure: [
            grasp.quality.figures[figure.name]
            for grasp in result.grasps
            if figure.name in grasp.quality.figures
        ]
        for figure in result.figures
    }
    if not any(found.values()):
        return
    print()
    tables.print_text(f"Looked for, best first: {result.objective}.")
    for figure, values in found.items():
        if values:
            unit = f" {figure.unit}" if figure.unit else ""
            better = "larger" if figure.larger_is_better else "smaller"
            tables.print_text(
                f"{figure.name} ({better} is better), here {min(values):.4g} to "
                f"{max(values):.4g}{unit}. {figure.description} [{figure.source}]"
            )


def _share(left: int, had: int) -> str:
    return f"{100.0 * left / had:.0f} %" if had else ""


def _cause(pair: tuple[str, int] | None) -> str:
    return "" if pair is None else f"{pair[0]} {pair[1]}"
