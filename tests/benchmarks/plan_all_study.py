"""A thousand meshes through plan-all: cores, kills, memory, failures; writes a report.

    python tests/benchmarks/plan_all_study.py --out docs/benchmark/plan_all
    python tests/benchmarks/plan_all_study.py --out out/plan_all --limit 30

The meshes are the thousand random parts of PyBullet's data package, and its household objects, each
scaled to a longest side between 40 and 120 mm that is drawn from the seed. Two things are measured.
Cores: some parts by a number of attempts, with one job on one core and with two on two, in turns;
the ratio of their rates, and whether their plans are the same. Catalogue: all parts at `--seconds`
each, with `--jobs`; `plan-all` is killed (SIGKILL) three times in the middle and started again,
the memory of each process is watched, and a plan that was there before a kill must be there after
it. A study that was ended goes on with the catalogue where it was.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from gpis_grasp_benchmark.bullet_objects import HOUSEHOLD_SET, RANDOM_SET, bullet_objects
from gpis_grasp_planner.forked_child import usable_cores
from gpis_grasp_planner.plan.document import document_of
from gpis_grasp_planner.store.grasp_store import GraspStore

PROGRAM = (sys.executable, "-m", "gpis_grasp_planner.cli.main", "plan-all")
ATTEMPTS = ("--evaluations", "600", "--verify", "none")
KILLS = 3
LOOK_S = 0.2


def write_meshes(folder, limit, seed):
    """Write the parts as STL files in metres; the refused ones with their reasons."""
    folder.mkdir(parents=True, exist_ok=True)
    n = 1000 if limit is None else limit
    parts, refused = bullet_objects(n, seed)
    chosen = [part for name in (RANDOM_SET, HOUSEHOLD_SET) for part in parts[name]][:limit]
    for part in chosen:
        # A folder for each hundred: a part is looked for by listing its folder.
        number = part.mesh_id.rpartition("-")[2]
        path = folder / (number[:1] if number.isdigit() else "household") / f"{part.mesh_id}.stl"
        path.parent.mkdir(exist_ok=True)
        if not path.exists():
            write_stl(path, part.mesh.triangles)
    return len(chosen), [(refusal.object_id, refusal.message) for refusal in refused]


def write_stl(path, triangles):
    """Write triangles (m, 3, 3) [m] as binary STL."""
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.zeros(len(triangles), kind)
    rows["corners"] = triangles
    path.write_bytes(bytes(80) + np.uint32(len(rows)).tobytes() + rows.tobytes())


def command(meshes, store, jobs, summary, *words):
    """The command line of plan-all; units are metres."""
    there = ("--set", f"store.path={store}", "--set", "catalogue.default_unit=m")
    return [*PROGRAM, str(meshes), "--jobs", str(jobs), "--json", str(summary), *there, *words]


def processes_of(pid):
    """The process IDs of a process and all below it."""
    found, left = [], [pid]
    while left:
        here = left.pop()
        try:
            tasks = list(Path(f"/proc/{here}/task").iterdir())
            children = [c for t in tasks for c in (t / "children").read_text().split()]
        except OSError:
            continue
        found.append(here)
        left += map(int, children)
    return found


def memory_mb(pid):
    """Resident memory of a process [MB]; 0 where it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def watched(words, enough):
    """Run a command until it ends, or is killed when `enough()`; exit code, peak memory [MB]."""
    peak = 0.0
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    while process.poll() is None:
        peak = max([peak, *map(memory_mb, processes_of(process.pid))])
        if enough():
            process.send_signal(signal.SIGKILL)
        time.sleep(LOOK_S)
    error = process.stderr.read().strip()
    if process.returncode not in (0, 1, 3, -signal.SIGKILL):
        raise RuntimeError(error)
    return process.returncode, peak


def rows_of(store):
    """When and for what each kept plan was made."""
    if not store.exists():
        return {}
    return {entry.mesh_hash: entry.made_s for entry in GraspStore(store, wait_s=60.0).entries()}


def plans_of(store):
    """A hash of each plan, without what differs by the clock and by the place of files."""
    found = {}
    for entry, record in GraspStore(store).records():
        document = document_of(record.result)
        for field in ("elapsed_s", "phase_s", "convergence"):
            del document[field]
        del document["settings"]["store"]
        text = json.dumps(document, sort_keys=True)
        found[entry.mesh_hash] = hashlib.sha256(text.encode()).hexdigest()
    return found


def one_run(meshes, folder, name, jobs, n):
    """Rate [parts/s] of a run by attempts from an empty store, and its plans."""
    store, summary = folder / f"{name}.sqlite", folder / f"{name}.json"
    for end in ("", "-wal", "-shm"):
        Path(f"{store}{end}").unlink(missing_ok=True)
    busy = os.times()
    words = command(meshes, store, jobs, summary, *ATTEMPTS)
    cores = ",".join(map(str, sorted(os.sched_getaffinity(0))[:jobs]))
    subprocess.run(["taskset", "-c", cores, *words], check=False, stdout=subprocess.DEVNULL)
    cpu = sum(os.times()[2:4]) - sum(busy[2:4])
    parts = json.loads(summary.read_text())
    return {"jobs": jobs, "s": parts["elapsed_s"], "cpu_s": cpu, "n": n}, plans_of(store)


def cores_study(arguments, folder):
    """One and two jobs in turns."""
    meshes = folder / "few"
    n, _ = write_meshes(meshes, arguments.cores_parts, arguments.seed)
    rows, plans = [], []
    os.environ["GPIS_GRASP_CACHE"] = "off"  # every run prepares its meshes
    for turn in range(arguments.turns):
        for jobs in (1, arguments.jobs):
            row, made = one_run(meshes, folder, f"jobs{jobs}", jobs, n)
            load = os.getloadavg()[0]
            rows.append({**row, "turn": turn, "load": round(load, 1)})
            plans.append(made)
            print(rows[-1], flush=True)
    del os.environ["GPIS_GRASP_CACHE"]
    return {"rows": rows, "same": all(made == plans[0] for made in plans), "plans": len(plans[0])}


def catalogue_study(arguments, folder):
    """All parts, with kills in the middle."""
    meshes, store = folder / "meshes", folder / "all.sqlite"
    n, refused = write_meshes(meshes, arguments.limit, arguments.seed)
    state_file = folder / "runs.json"
    runs = json.loads(state_file.read_text()) if state_file.exists() else []
    words = ("--time", str(arguments.seconds))
    while not runs or runs[-1]["exit_code"] == -signal.SIGKILL:
        before = rows_of(store)
        done = len(runs)
        goal = len(before) + max(1, (n - len(before)) // (KILLS + 1 - done)) if done < KILLS else n

        def enough(goal=goal, done=done):
            return done < KILLS and len(rows_of(store)) >= goal

        start = time.monotonic()
        summary = folder / "summary.json"
        code, peak = watched(command(meshes, store, arguments.jobs, summary, *words), enough)
        after = rows_of(store)
        runs.append(
            {
                "exit_code": code,
                "s": time.monotonic() - start,
                "peak_mb": peak,
                "before": len(before),
                "after": len(after),
                "lost": len(set(before) - set(after)),
                "planned_again": sum(after.get(k) != made for k, made in before.items()),
                "load": round(os.getloadavg()[0], 1),
            }
        )
        state_file.write_text(json.dumps(runs))
        print(runs[-1], flush=True)
    return {
        "n": n,
        "runs": runs,
        "refused": refused,
        "summary": json.loads((folder / "summary.json").read_text()),
        "faults": GraspStore(store).database.faults(),
        "store_bytes": sum(entry.n_bytes for entry in GraspStore(store).entries()),
    }


def report(arguments, cores, catalogue):
    """Markdown of both studies."""
    lines = [
        "# A thousand meshes through plan-all",
        "",
        f"    python tests/benchmarks/plan_all_study.py {' '.join(sys.argv[1:])}",
        "",
        f"{time.strftime('%d %B %Y')}, {usable_cores()} cores; the load stands beside each run.",
        "",
        "## Cores",
        "",
    ]
    if cores is not None:
        n = cores["rows"][0]["n"]
        lines += [
            f"{n} parts, `{' '.join(ATTEMPTS)}`, nothing prepared; one job on one core and "
            f"{arguments.jobs} on as many, in turns. Without the program's start.",
            "",
            "| turn | jobs | s | parts/s | processor s | load |",
            "|---|---|---|---|---|---|",
        ]
        for row in cores["rows"]:
            lines.append(
                f"| {row['turn'] + 1} | {row['jobs']} | {row['s']:.1f} | {n / row['s']:.2f} | "
                f"{row['cpu_s']:.1f} | {row['load']} |"
            )
        ratios = [
            one["s"] / many["s"]
            for one, many in zip(cores["rows"][::2], cores["rows"][1::2], strict=True)
        ]
        lines += [
            "",
            f"Rate with {arguments.jobs} jobs over that with one: "
            f"{', '.join(f'{ratio:.2f}' for ratio in ratios)}. All {cores['plans']} plans are "
            + ("the same in all runs." if cores["same"] else "**not** the same in all runs."),
            "",
        ]
    lines += ["## Catalogue", ""]
    if catalogue is not None:
        lines += catalogue_lines(arguments, catalogue)
    return "\n".join(lines) + "\n"


def catalogue_lines(arguments, found):
    """Markdown of the catalogue."""
    runs, parts = found["runs"], found["summary"]["parts"]
    codes = Counter(part["code"] for part in parts)
    lines = [
        f"{found['n']} parts at {arguments.seconds:g} s each, {arguments.jobs} jobs; killed "
        f"(SIGKILL) {sum(run['exit_code'] == -9 for run in runs)} times in the middle.",
        "",
        "| run | ended by | s | plans before | after | lost | planned again | peak of a process | "
        "load |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for number, run in enumerate(runs, start=1):
        ended = "SIGKILL" if run["exit_code"] == -9 else f"itself, code {run['exit_code']}"
        lines.append(
            f"| {number} | {ended} | {run['s']:.0f} | {run['before']} | {run['after']} | "
            f"{run['lost']} | {run['planned_again']} | {run['peak_mb']:.0f} MB | {run['load']} |"
        )
    total = sum(run["s"] for run in runs)
    kept = sum(part["kept"] for part in parts)
    lines += [
        "",
        f"All runs together: {total / 60.0:.1f} min, {total / found['n']:.2f} s a part. The store "
        f"has {found['store_bytes'] / 1e3 / max(kept, 1):.0f} kB a part; its full check "
        + ("is clean." if not found["faults"] else f"finds {found['faults']}."),
        "",
        "| answer | parts |",
        "|---|---|",
        *(f"| {code} | {n} |" for code, n in codes.most_common()),
        f"| refused as they are in the package | {len(found['refused'])} |",
        "",
        "Without grasps, with the reason:",
        "",
        *(
            f"- {part['mesh_id']}: {part['code']}: {part['message'] or '**no reason**'}"
            for part in parts
            if not part["n_grasps"]
        ),
        *(f"- {name}: {why}" for name, why in found["refused"]),
        "",
    ]
    return lines


def main() -> None:
    """Run what is left of the study, and write README.md."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of README.md")
    parser.add_argument("--work", type=Path, help="folder of meshes and stores; default: temporary")
    parser.add_argument("--limit", type=int, help="the first meshes alone")
    parser.add_argument("--seconds", type=float, default=3.0, help="budget a part; default 3")
    parser.add_argument("--jobs", type=int, default=2, help="default 2")
    parser.add_argument("--turns", type=int, default=3, help="of one job and many; 0: not measured")
    parser.add_argument("--cores-parts", type=int, default=20, help="parts of these turns")
    parser.add_argument("--no-catalogue", action="store_true", help="measure the cores alone")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.work or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        cores = cores_study(arguments, folder) if arguments.turns else None
        catalogue = None if arguments.no_catalogue else catalogue_study(arguments, folder)
        text = report(arguments, cores, catalogue)
    (arguments.out / "README.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
