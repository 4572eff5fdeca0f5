"""Grasps planned on noisy, partly seen point clouds: whether the first holds on the true mesh.

    python tests/benchmarks/cloud_study.py --out docs/benchmark/point_clouds
    python tests/benchmarks/cloud_study.py --noise-mm 1 --shares 0.5 mug flange

scans each shipped part from one or two viewpoints (points that a ray meets, Gaussian noise along
all axes), plans on the cloud alone for `--time` seconds, and tries the first grasp on the true mesh
in Bullet: the hand comes where it was planned, stops before it would meet the part, and closes.
Noise is varied at half of the surface seen, the share seen at 1 mm of noise. Rows are appended to
`OUT/rows.jsonl` (what stands there is not made again), with `OUT/report.md` and `OUT/success.png`.
Without `--out` it prints. All of it takes 18 minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from gpis_grasp_benchmark.scans import scan
from gpis_grasp_benchmark.shares import Share
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import (
    MeshCatalogue,
    default_catalogue_directory,
    load_part,
)
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.warm_up import load_compiled
from gpis_grasp_planner.verification.protocol import Verifier
from gpis_grasp_planner.verification.settings import VerificationSettings

NOISE_MM = (0.0, 0.5, 1.0, 2.0)
SHARES = (1.0, 0.75, 0.5)
MAIN = (1.0, 0.5)
KEY = ("part", "noise_mm", "share", "seed")


def main() -> None:
    """Scan, plan, try: a row each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--noise-mm", type=float, nargs="*", help="levels; default 0 0.5 1 2")
    parser.add_argument("--shares", type=float, nargs="*", help="of the surface; default 1 .75 .5")
    parser.add_argument("--time", type=float, default=10.0, help="budget of a plan [s]; default 10")
    parser.add_argument("--friction", type=float, default=0.6)
    parser.add_argument("--seed", type=int, default=1, help="of viewpoints, noise and plan")
    parser.add_argument("--out", type=Path, help="folder of the study")
    parser.add_argument("parts", nargs="*", help="default: all that ship")
    arguments = parser.parse_args()
    catalogue = MeshCatalogue([default_catalogue_directory()])
    load_compiled()
    planner = GraspPlanner()
    rows = read(arguments.out)
    done = {tuple(row[k] for k in KEY) for row in rows}
    for noise, share in cases(arguments):
        for name in arguments.parts or catalogue.ids():
            if (name, noise, share, arguments.seed) in done:
                continue
            row = tried(planner, catalogue.load(name), noise, share, arguments)
            print(json.dumps(row), flush=True)
            rows.append(row)
            if arguments.out is not None:
                arguments.out.mkdir(parents=True, exist_ok=True)
                with (arguments.out / "rows.jsonl").open("a") as file:
                    file.write(json.dumps(row) + "\n")
    text = report(rows, arguments)
    print(text)
    if arguments.out is not None:
        (arguments.out / "report.md").write_text(text)
        draw(rows, arguments.out / "success.png")


def read(out):
    """Rows that are there already."""
    file = None if out is None else out / "rows.jsonl"
    if file is None or not file.exists():
        return []
    return [json.loads(line) for line in file.read_text().splitlines()]


def cases(arguments):
    """Pairs of noise [mm] and share: one line through each, or all that were asked for."""
    if arguments.noise_mm or arguments.shares:
        return [(n, s) for n in arguments.noise_mm or NOISE_MM for s in arguments.shares or SHARES]
    pairs = [MAIN, *((n, MAIN[1]) for n in NOISE_MM), *((MAIN[0], s) for s in SHARES)]
    return list(dict.fromkeys(pairs))


def tried(planner, true_part, noise_mm, share, arguments):
    """Plan on one cloud and try the first grasp on the true mesh."""
    seed = arguments.seed
    made = scan(true_part.mesh, share, 1e-3 * noise_mm, seed)
    row = {"part": true_part.mesh_id, "noise_mm": noise_mm, "share": share, "seed": seed}
    row |= {"seen": round(made.share, 3), "views": len(made.viewpoints), "n": len(made.points)}
    friction = Friction(arguments.friction, arguments.friction)
    request = PlanRequest(
        time_budget_s=arguments.time, n_grasps=10, friction=friction, seed=seed, verification="rank"
    )
    start = time.monotonic()
    try:
        part = loaded(made, true_part.mesh_id)
        row["read_s"] = round(time.monotonic() - start, 2)
        result = planner.answer(part, request).result
    except GraspPlannerError as error:
        return row | {"code": error.code.name, "message": str(error), "held": False}
    row |= {"off_mm": off_mm(part.mesh, true_part.mesh), "plan_s": round(result.elapsed_s, 2)}
    row |= {"code": result.code.name, "grasps": len(result.grasps), "held": False}
    if result.code.name == "SUCCESS":
        first = result.grasps[0]
        settings = VerificationSettings(engine="bullet", friction=arguments.friction)
        with Verifier(true_part, planner.hand, settings) as verifier:
            verdict = verifier.verify_displaced(first, np.eye(4))
        row |= {
            "held": verdict.held,
            "cause": verdict.cause,
            "epsilon": round(float(first.epsilon), 4),
            **{name: round(value, 5) for name, value in first.quality.measured.items()},
        }
    return row


def loaded(made, name):
    """The cloud as a user has it: a file of points and a YAML file with the viewpoints."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.xyz"
        np.savetxt(path, made.points, fmt="%.7f")
        path.with_suffix(".yaml").write_text(
            f"unit: m\nviewpoints: {made.viewpoints.round(6).tolist()}\n"
        )
        return load_part(path)


def off_mm(mesh, true_mesh) -> float:
    """Mean distance [mm] of the reconstructed vertices from the true surface."""
    _, distances, _ = TriangleTree.of(true_mesh).nearest(mesh.vertices)
    return round(1e3 * float(distances.mean()), 2)


def share_of(rows) -> Share:
    """Of parts whose first grasp held."""
    return Share(sum(row["held"] for row in rows), len(rows))


def report(rows, arguments) -> str:
    """What was run, a line a case, and every part."""
    grouped = {}
    for row in rows:
        grouped.setdefault((row["noise_mm"], row["share"]), []).append(row)
    lines = [
        "# Point clouds\n",
        f"    python {' '.join([Path(sys.argv[0]).as_posix(), *sys.argv[1:]])}\n",
        f"{arguments.time:g} s for a plan on the cloud, friction {arguments.friction:g}; first "
        "grasp tried on the true mesh in Bullet. Load of the machine over 15 minutes at the end "
        f"{os.getloadavg()[2]:.1f}. A part without an answer counts as not held. Wilson's 95 %.\n",
        "| noise mm | surface seen | held | median off mm | median reading s |",
        "|---|---|---|---|---|",
    ]
    for (noise, share), own in sorted(grouped.items()):
        of = share_of(own)
        low, high = of.interval
        off, read_s = (
            np.median([r[k] for r in own if k in r] or [np.nan]) for k in ("off_mm", "read_s")
        )
        lines.append(
            f"| {noise:g} | {share:.0%} | {of.passed} of {of.n} ({low:.0%}-{high:.0%}) | {off:.1f} "
            f"| {read_s:.1f} |"
        )
    failed = [row for row in rows if not row["held"]]
    lines += ["", "What did not hold:" if failed else "Everything held.", ""]
    for row in failed:
        why = row.get("cause") or row["code"]
        lines.append(f"- {row['part']}, {row['noise_mm']:g} mm, {row['share']:.0%}: {why}")
    return "\n".join([*lines, "", "![success](success.png)"]) + "\n"


def draw(rows, file: Path) -> None:
    """Success against noise, and against the share seen."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(8, 3.2), sharey=True, layout="constrained")
    lines = (
        ("noise_mm", "share", MAIN[1], "noise [mm], half of the surface seen", 1.0),
        ("share", "noise_mm", MAIN[0], "surface seen [%], 1 mm of noise", 100.0),
    )
    for axis, (by, fixed, value, label, factor) in zip(axes, lines, strict=True):
        chosen = [row for row in rows if row[fixed] == value]
        xs = sorted({row[by] for row in chosen})
        of = [share_of([row for row in chosen if row[by] == x]) for x in xs]
        y = np.array([100.0 * s.passed / s.n for s in of])
        ends = 100.0 * np.array([s.interval for s in of]).reshape(-1, 2).T
        axis.errorbar(factor * np.array(xs), y, np.abs(ends - y), fmt="o-", capsize=4)
        axis.axhline(85.0, color="0.6", linestyle=":")
        axis.set(xlabel=label, ylim=(0, 103))
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("first grasps that hold [%]")
    figure.savefig(file, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
