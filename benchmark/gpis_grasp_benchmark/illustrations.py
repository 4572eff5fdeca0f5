"""Plots and pictures of a benchmark, drawn by ``view`` from records and documents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gpis_grasp_benchmark.report import Illustrations
from gpis_grasp_benchmark.store import RunStore
from gpis_grasp_benchmark.tables import Record, best, best_epsilon_at
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.document import check_same_mesh, read_document

_TIMES = 200
_COLUMNS = 3


def illustrate(
    store: RunStore, records: Sequence[Record], parts: Mapping[str, Part], pictures: bool = True
) -> Illustrations:
    """Draw one plot and one sheet of pictures per object into the store's directory.

    A plot takes about 0.3 s, a picture 1 s.
    """
    by_object: dict[str, dict[str, list[Record]]] = {}
    for record in records:
        planners = by_object.setdefault(record["object_id"], {})
        planners.setdefault(record["planner"], []).append(record)
    plots: dict[str, str] = {}
    sheets: dict[str, str] = {}
    for folder in ("plots", "pictures") if pictures else ("plots",):
        (store.directory / folder).mkdir(exist_ok=True)
    for object_id, planners in by_object.items():
        plots[object_id] = f"plots/{object_id}.png"
        _plot(store.directory / plots[object_id], object_id, planners)
        if pictures:
            path = f"pictures/{object_id}.png"
            if _sheet(store, store.directory / path, parts[object_id], planners):
                sheets[object_id] = path
    return Illustrations(plots, sheets)


def _plot(path: Path, object_id: str, planners: Mapping[str, Sequence[Record]]) -> None:
    from gpis_grasp_planner.view.plots import plot_convergence

    end = max(r["elapsed_s"] for runs in planners.values() for r in runs)
    times = np.linspace(0.0, end, _TIMES)
    curves = {
        planner: np.array([best_epsilon_at(run, times) for run in runs])
        for planner, runs in planners.items()
    }
    plot_convergence(times, curves, path=path, title=object_id)


def _sheet(
    store: RunStore, path: Path, part: Part, planners: Mapping[str, Sequence[Record]]
) -> bool:
    from gpis_grasp_planner.view.picture import GraspView, render_sheet

    views = []
    for planner, runs in planners.items():
        record = max(runs, key=lambda run: best(run, "epsilon"))
        result = read_document(store.document_path(record)).result
        check_same_mesh(result, part)
        grasp = max(result.grasps, key=lambda g: g.epsilon, default=result.best_attempt)
        if grasp is None:
            continue
        quality = f"epsilon {grasp.epsilon:.3f}" if grasp.feasible else "no force closure"
        views.append(
            GraspView(
                part.mesh,
                load_hand(result.hand),
                grasp.T_object_palm,
                grasp.joints,
                grasp.contacts,
                f"{planner}: {quality}",
            )
        )
    if views:
        render_sheet(views, path=path, columns=_COLUMNS)
    return bool(views)
