"""Each stage now and in a former version, side by side in one run, with ratios: `make bench`.

    python tests/benchmarks/bench.py
    python tests/benchmarks/bench.py --former 61fc508 --write

The former version is a work tree of this repository in out/bench, made once; its compiled code is
kept there. Both are measured by `bench_stages.py` in turn, several times, the order changed from
one time to the next; of a benchmark the least time counts.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

from performance import PAGE, write_between
from two_versions import FORMER, OUT, ROOT, environment, former_tree, sources

TABLE = ("<!-- ratios: made by tests/benchmarks/bench.py -->", "<!-- /ratios -->")


def seconds(tree: Path, report: Path, chosen: str) -> dict[str, float]:
    """Least time of each benchmark with the sources of a tree."""
    command = [
        sys.executable, "-m", "pytest", "-q", "--noconftest", "-p", "no:cacheprovider",
        "-p", "pytest_benchmark.plugin", "-o", f"pythonpath={sources(tree)}", "-k", chosen,
        "--benchmark-timer=time.thread_time", "--benchmark-max-time=0.3",
        f"--benchmark-json={report}", "--benchmark-quiet",
        str(Path(__file__).with_name("bench_stages.py")),
    ]  # fmt: skip
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**environment(tree), "GPIS_GRASP_CACHE": "off"},
        capture_output=True,
        text=True,
    )
    if done.returncode:
        sys.exit(f"The benchmarks of {tree} failed:\n{done.stdout[-4000:]}{done.stderr[-2000:]}")
    found = json.loads(report.read_text())["benchmarks"]
    return {one["name"]: one["stats"]["min"] for one in found}


def stage_of(name: str) -> str:
    """The stage that a benchmark's name says: the same for all parts."""
    return re.sub(r"^test_|\[.*\]$", "", name).replace("_", " ")


def table(now: dict[str, float], former: dict[str, float]) -> list[str]:
    """Markdown: milliseconds in the mean of a stage's benchmarks, now and before, and the ratio."""
    rows = ["| stage | ms, former | ms, now | former / now |", "|---|---|---|---|"]
    for stage in dict.fromkeys(stage_of(name) for name in now):
        names = [name for name in now if stage_of(name) == stage and name in former]
        if not names:
            continue
        after = sum(now[name] for name in names) / len(names)
        before = sum(former[name] for name in names) / len(names)
        rows.append(f"| {stage} | {1e3 * before:.3g} | {1e3 * after:.3g} | {before / after:.2f} |")
    return rows


def main() -> None:
    """Measure both and print; with --write also keep the table in the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--former", default=FORMER, help="revision to compare with")
    parser.add_argument("--times", type=int, default=2, help="how often each is measured")
    parser.add_argument("-k", dest="chosen", default="test", help="benchmarks, as for pytest")
    parser.add_argument("--write", action="store_true", help="put the table into the page")
    arguments = parser.parse_args()
    trees = {"now": ROOT, "former": former_tree(arguments.former)}
    least: dict[str, dict[str, float]] = {"now": {}, "former": {}}
    for time_of in range(arguments.times):
        order = list(trees) if time_of % 2 else list(trees)[::-1]
        for whose in order:
            report = OUT / f"{whose}-{time_of}.json"
            for name, spent in seconds(trees[whose], report, arguments.chosen).items():
                least[whose][name] = min(spent, least[whose].get(name, spent))
            print(f"{whose}: done", file=sys.stderr)
    lines = table(least["now"], least["former"])
    print("\n".join(lines))
    if arguments.write:
        head = [f"Former: commit {arguments.former}. Each measured {arguments.times} times.", ""]
        write_between(PAGE, TABLE, head + lines)


if __name__ == "__main__":
    main()
