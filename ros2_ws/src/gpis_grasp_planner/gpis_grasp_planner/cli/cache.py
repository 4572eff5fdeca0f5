"""List or clear what was prepared for meshes and is kept on disk."""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

from gpis_grasp_planner.cli import options
from gpis_grasp_planner.cli.exit_codes import SUCCESS

_ACTIONS = ("list", "clear", "path")
EXAMPLES = """\
examples:
  gpis-grasp cache
  gpis-grasp cache list --json
  gpis-grasp cache clear
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'cache'."""
    parser.add_argument(
        "action",
        nargs="?",
        choices=_ACTIONS,
        default="list",
        help="list the entries, last used first (the default); remove all; print the folder alone",
    )
    parser.add_argument("--json", action="store_true", help="print as JSON")
    options.add_settings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked for."""
    from gpis_grasp_planner.disk_cache import DiskCache

    settings, _ = options.read_settings(arguments.settings, arguments.assignments)
    cache = DiskCache.of(settings.cache)
    removed = cache.clear() if arguments.action == "clear" else None
    entries = cache.entries()
    n_bytes = sum(entry.n_bytes for entry in entries)
    if arguments.json:
        folder = None if cache.folder is None else str(cache.folder)
        facts: dict[str, Any] = {"folder": folder, "most_bytes": cache.most_bytes, "bytes": n_bytes}
        if removed is not None:
            facts["removed_bytes"] = removed
        if arguments.action == "list":
            facts["entries"] = [
                {"name": e.name, "kind": e.kind, "bytes": e.n_bytes, "used_s": e.used_s}
                for e in entries
            ]
        print(json.dumps(facts, indent=1))
    elif cache.folder is None:
        print("The cache is switched off.")
    elif removed is not None:
        print(f"{removed / 1e6:.1f} MB removed from {cache.folder}")
    elif arguments.action == "path":
        print(cache.folder)
    else:
        for entry in entries:
            age_h = (time.time() - entry.used_s) / 3600.0
            print(f"{entry.name}  {entry.n_bytes / 1e6:7.1f} MB  used {age_h:.1f} h ago")
        print(
            f"{len(entries)} entries, {n_bytes / 1e6:.1f} of {cache.most_bytes / 1e6:.0f} MB "
            f"in {cache.folder}"
        )
    return SUCCESS
