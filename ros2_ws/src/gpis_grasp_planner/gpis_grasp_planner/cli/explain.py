"""Where grasps got lost, as a table and a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import tables
from gpis_grasp_planner.cli.tables import Column

if TYPE_CHECKING:
    from gpis_grasp_planner.grasp.funnel import Funnel


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
    tables.print_table(funnel_columns(funnel))
    if text := advice(funnel):
        print()
        main = funnel.main_loss
        assert main is not None
        tables.print_text(f"Main loss: {main[0]}. {text}")


def _share(left: int, had: int) -> str:
    return f"{100.0 * left / had:.0f} %" if had else ""


def _cause(pair: tuple[str, int] | None) -> str:
    return "" if pair is None else f"{pair[0]} {pair[1]}"
