"""List, show, carry, prune or verify the plans that are kept on disk."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpis_grasp_planner.cli import options, output, tables
from gpis_grasp_planner.cli.exit_codes import ERROR, SUCCESS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gpis_grasp_planner.store.grasp_store import Entry, GraspStore

EXAMPLES = """\
examples:
  gpis-grasp store
  gpis-grasp store show 3 > grasps.json
  gpis-grasp store export plans.jsonl
  gpis-grasp store import plans.jsonl
  gpis-grasp store prune --unused-days 90
  gpis-grasp store verify
"""
_ACTIONS = ("list", "show", "export", "import", "prune", "verify", "path")
_OF_FILE = ("export", "import")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'store'."""
    parser.add_argument(
        "action",
        nargs="?",
        choices=_ACTIONS,
        default="list",
        help="list the plans, last used first (the default); show one as a JSON document; export "
        "or import all, one a line; prune what no plan of now can use; verify every plan and the "
        "file; print the file's path alone",
    )
    parser.add_argument(
        "what",
        nargs="?",
        metavar="NUMBER|FILE",
        help="of 'show': a plan; of 'export' and 'import': a file, '-' for stdout",
    )
    parser.add_argument(
        "--unused-days",
        type=float,
        metavar="D",
        help="of 'prune': also what was not used for D days",
    )
    parser.add_argument(
        "--all", action="store_true", help="of 'prune': every plan", dest="everything"
    )
    parser.add_argument("--json", action="store_true", help="print as JSON")
    options.add_settings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked for; 1 where 'verify' finds a fault."""
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.store.grasp_store import GraspStore

    settings, _ = options.read_settings(arguments.settings, arguments.assignments)
    store = GraspStore.of(settings.store)
    if store is None:
        raise RequestError(
            "The grasp store is switched off (store.enabled, GPIS_GRASP_STORE). Name a file with "
            "--set store.path=FILE."
        )
    action, what = arguments.action, arguments.what
    if (what is not None) != (action in ("show", *_OF_FILE)):
        needed = "the number of a plan, see 'store list'" if action == "show" else "a file"
        raise RequestError(
            f"'store {action}' takes no '{what}'."
            if what is not None
            else f"'store {action}' needs {needed}."
        )
    if action != "prune" and (arguments.everything or arguments.unused_days is not None):
        raise RequestError(f"'store {action}' takes neither --all nor --unused-days: 'prune' does.")
    if action == "show":
        return _show(store, what)
    if action == "export":
        return _export(store, what, as_json=arguments.json)
    if action == "import":
        return _import(store, Path(what), as_json=arguments.json)
    if action == "prune":
        return _prune(store, arguments)
    if action == "verify":
        return _verify(store, as_json=arguments.json)
    if action == "path":
        print(store.database.path)
        return SUCCESS
    return _list(store, as_json=arguments.json)


def _list(store: GraspStore, *, as_json: bool) -> int:
    entries = store.entries()
    if as_json:
        facts = {
            "path": str(store.database.path),
            "bytes": store.database.n_bytes(),
            "most_bytes": store.most_bytes,
            "plans": [_facts(entry) for entry in entries],
        }
        print(json.dumps(facts, indent=1))
        return SUCCESS
    if entries:
        tables.print_table(_columns(entries))
        print()
    stale = sum(not entry.usable for entry in entries)
    tables.print_text(
        f"{len(entries)} plans, {store.database.n_bytes() / 1e6:.1f} of at most "
        f"{store.most_bytes / 1e6:.0f} MB in {store.database.path}"
    )
    if stale:
        tables.print_text(
            f"{stale} of them are of another version of the planner and answer nothing; 'prune' "
            "removes them."
        )
    return SUCCESS


def _columns(entries: Sequence[Entry]) -> list[tables.Column]:
    from gpis_grasp_planner.errors import ErrorCode

    def column(heading: str, cells: Sequence[str], priority: int, left: bool = False) -> Any:
        return tables.Column(heading, list(cells), priority, left)

    return [
        column("no.", [str(e.id) for e in entries], 0),
        column("mesh ID", [e.mesh_id for e in entries], 0, left=True),
        column("place", [_place_text(e) for e in entries], 1, left=True),
        column("budget [s]", [f"{e.time_budget_s:g}" for e in entries], 3),
        column("grasps", [str(e.n_grasps) for e in entries], 0),
        column("held", [f"{e.n_held}/{e.n_tried}" for e in entries], 2),
        column(
            "epsilon",
            ["" if e.best_epsilon is None else f"{e.best_epsilon:.4f}" for e in entries],
            0,
        ),
        column("age", [_age(e.made_s) for e in entries], 2),
        column("used", [_age(e.used_s) for e in entries], 4),
        column("kB", [f"{e.n_bytes / 1e3:.0f}" for e in entries], 5),
        column("mesh", [e.mesh_hash[:10] for e in entries], 6, left=True),
        column(
            "state",
            [ErrorCode(e.code).name if e.usable else "OTHER_VERSION" for e in entries],
            1,
            left=True,
        ),
    ]


def _place_text(entry: Entry) -> str:
    place = json.loads(entry.place)
    if place is None:
        return "free"
    words = []
    if place.get("support"):
        words.append("support")
    if n := len(place.get("obstacles") or ()):
        words.append(f"{n} obstacles")
    if place.get("covariance"):
        words.append("uncertain")
    return ", ".join(words) or "free"


def _age(then_s: float) -> str:
    seconds = max(time.time() - then_s, 0.0)
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def _facts(entry: Entry) -> dict[str, Any]:
    from dataclasses import asdict

    return {**asdict(entry), "place": json.loads(entry.place), "usable": entry.usable}


def _show(store: GraspStore, number: str) -> int:
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.plan.document import document_text

    entries = {str(entry.id): entry for entry in store.entries()}
    if number not in entries:
        known = ", ".join(sorted(entries, key=int)[:10]) or "none"
        raise RequestError(f"There is no plan {number}; there are {known}. See 'store list'.")
    sys.stdout.write(document_text(store.record(entries[number]).result))
    return SUCCESS


def _export(store: GraspStore, file: str, *, as_json: bool) -> int:
    from gpis_grasp_planner.errors import GraspPlannerError
    from gpis_grasp_planner.store.exchange import line_of
    from gpis_grasp_planner.whole_file import replace_file

    output.check_writable(Path(file))
    lines, bad = [], 0
    for entry, record in store.records():
        if isinstance(record, GraspPlannerError):
            bad += 1
            output.note(f"gpis-grasp: {record}")
        else:
            lines.append(line_of(entry, record) + "\n")
    if file == "-":
        sys.stdout.writelines(lines)
        return ERROR if bad else SUCCESS
    replace_file(Path(file), "".join(lines).encode())
    _say({"exported": len(lines), "damaged": bad}, f"{len(lines)} plans in {file}", as_json)
    return ERROR if bad else SUCCESS


def _import(store: GraspStore, file: Path, *, as_json: bool) -> int:
    from gpis_grasp_planner.store.exchange import read_lines

    records = list(read_lines(file))
    store.put_all(records)
    _say({"imported": len(records)}, f"{len(records)} plans of {file} are kept", as_json)
    return SUCCESS


def _prune(store: GraspStore, arguments: argparse.Namespace) -> int:
    from gpis_grasp_planner.errors import RequestError

    days = arguments.unused_days
    if days is not None and not days >= 0.0:
        raise RequestError(f"--unused-days is {days:g}; give a number of days that is 0 or more.")
    oldest = -1.0 if days is None else time.time() - 86400.0 * days
    gone = [e for e in store.entries() if arguments.everything or not e.usable or e.used_s < oldest]
    before = store.database.n_bytes()
    store.remove(gone)
    freed = max(before - store.database.n_bytes(), 0)
    text = f"{len(gone)} plans removed, {freed / 1e6:.1f} MB freed"
    _say({"removed": len(gone), "freed_bytes": freed}, text, arguments.json)
    return SUCCESS


def _verify(store: GraspStore, *, as_json: bool) -> int:
    from gpis_grasp_planner.errors import GraspPlannerError

    faults = [f"{store.database.path.name}: {fault}" for fault in store.database.faults()]
    n = 0
    for entry, record in store.records():
        n += 1
        if isinstance(record, GraspPlannerError):
            faults.append(f"{entry.id} ({entry.mesh_id}): {record}")
    if as_json:
        print(json.dumps({"plans": n, "faults": faults}, indent=1))
    else:
        for fault in faults:
            tables.print_text(fault)
        tables.print_text(f"{n} plans read, {len(faults)} faults, in {store.database.path}")
    return ERROR if faults else SUCCESS


def _say(facts: dict[str, Any], text: str, as_json: bool) -> None:
    if as_json:
        print(json.dumps(facts, indent=1))
    else:
        tables.print_text(text)
