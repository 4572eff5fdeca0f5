"""Workers of a Dask scheduler: whether all plan alike, and their rate on the cores there are.

    python tests/benchmarks/cluster_study.py --out docs/benchmark/cluster
    python tests/benchmarks/cluster_study.py --out out/cluster --parts 6 --turns 1

Parts of PyBullet's data package by a number of attempts, nothing prepared: with one worker bound to
one core, with several on as many cores as there are, and with `--jobs` and no scheduler, in turns.
Scheduler and workers are processes of their own; the command and the scheduler take their time from
the same cores. Time is that of the command from its first part to its last.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ |= {"GPIS_GRASP_CACHE": "off", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clusters import Cluster
from distributed import Client
from plan_all_study import ATTEMPTS, one_run, plans_of, write_meshes
from terminal_sessions import PROGRAM

JOIN_S = 120.0


def clustered(meshes, folder, n_workers, cores):
    """A run with workers on some cores, from an empty store: seconds, and its plans."""
    store = folder / f"workers{n_workers}.sqlite"
    for end in ("", "-wal", "-shm"):
        Path(f"{store}{end}").unlink(missing_ok=True)
    bound = ["taskset", "-c", ",".join(map(str, cores))]
    with Cluster(folder / "cluster.log") as cluster:
        for _ in range(n_workers):
            cluster.start([*bound, *PROGRAM, "worker", cluster.address, "--jobs", "1"])
        with Client(cluster.address, timeout=JOIN_S) as client:
            client.wait_for_workers(n_workers, timeout=JOIN_S)
        told, _ = cluster.plan_all(
            meshes, store, "--set", "catalogue.default_unit=m", *ATTEMPTS
        ).communicate()
    return json.loads(told)["elapsed_s"], plans_of(store)


def measured(arguments, folder):
    """Rows of all turns, and whether all plans are the same."""
    meshes = folder / "meshes"
    n, _ = write_meshes(meshes, arguments.parts, 0)
    cores = sorted(os.sched_getaffinity(0))
    rows, plans = [], []
    for turn in range(arguments.turns):
        for what in ("one worker", f"{arguments.workers} workers", f"--jobs {len(cores)}"):
            if what.startswith("--jobs"):
                run, made = one_run(meshes, folder, "jobs", len(cores), n)
                elapsed_s = run["s"]
            else:
                alone = what == "one worker"
                n_workers, on = (1, cores[:1]) if alone else (arguments.workers, cores)
                elapsed_s, made = clustered(meshes, folder, n_workers, on)
            plans.append(made)
            load = round(os.getloadavg()[0], 1)
            rows.append({"turn": turn + 1, "what": what, "s": elapsed_s, "n": n, "load": load})
            print(rows[-1], flush=True)
    return rows, len(plans[0]), all(made == plans[0] for made in plans), len(cores)


def report(rows, n_plans, same, n_cores):
    """Markdown of the study."""
    alone, many, jobs = rows[::3], rows[1::3], rows[2::3]
    shares = [a["s"] / (m["s"] * n_cores) for a, m in zip(alone, many, strict=True)]
    beside = [j["s"] / m["s"] for j, m in zip(jobs, many, strict=True)]
    return "\n".join(
        [
            "# Workers of a scheduler",
            "",
            f"    python tests/benchmarks/cluster_study.py {' '.join(sys.argv[1:])}",
            "",
            f"{time.strftime('%d %B %Y')}, {n_cores} cores; the load stands beside each run. "
            f"{rows[0]['n']} parts, `{' '.join(ATTEMPTS)}`, nothing prepared.",
            "",
            "| turn | planned by | s | parts/s | load |",
            "|---|---|---|---|---|",
            *(
                f"| {row['turn']} | {row['what']} | {row['s']:.1f} | {row['n'] / row['s']:.2f} | "
                f"{row['load']} |"
                for row in rows
            ),
            "",
            f"Rate of {many[0]['what']} on {n_cores} cores over {n_cores} times that of one on one "
            f"core: {', '.join(f'{share:.2f}' for share in shares)}; over that of "
            f"`{jobs[0]['what']}` without a scheduler: {', '.join(f'{b:.2f}' for b in beside)}. "
            f"All {n_plans} plans are {'' if same else '**not** '}the same in all runs.",
            "",
        ]
    )


def main() -> None:
    """Measure, and write README.md."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of README.md")
    parser.add_argument("--workers", type=int, default=4, help="default 4")
    parser.add_argument("--parts", type=int, default=20, help="default 20")
    parser.add_argument("--turns", type=int, default=3, help="default 3")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        text = report(*measured(arguments, Path(temporary)))
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "README.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
