"""List settings with default, bounds and meaning: those that users change, or all."""

from __future__ import annotations

import argparse
import json
import textwrap
from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import options, tables
from gpis_grasp_planner.cli.exit_codes import SUCCESS

if TYPE_CHECKING:
    from gpis_grasp_planner.settings import SettingInfo

EXAMPLES = """\
examples:
  gpis-grasp settings                     those that users change
  gpis-grasp settings verification        of one group
  gpis-grasp settings hpp --advanced      all of a group
  gpis-grasp plan mug --set verification.mass_kg=0.3 --set hpp.volume_weight=1
"""
_WIDTH = 79


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the group and what is wanted of it."""
    parser.add_argument("group", metavar="GROUP", nargs="?", help="one group; default: all groups")
    parser.add_argument(
        "--advanced", action="store_true", help="also those of who studies the method"
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print them as JSON")
    form.add_argument("--markdown", action="store_true", help="print them as Markdown tables")


def run(arguments: argparse.Namespace) -> int:
    """Print what was asked for."""
    chosen = _chosen(arguments.group, arguments.advanced)
    if arguments.json:
        print(json.dumps({g: [_facts(s) for s in infos] for g, infos in chosen.items()}, indent=1))
    elif arguments.markdown:
        print(_markdown(chosen), end="")
    else:
        print(_text(chosen), end="")
        hidden = sum(map(len, _chosen(arguments.group, True).values()))
        hidden -= sum(map(len, chosen.values()))
        if hidden:
            tables.print_text(f"{hidden} more with --advanced.")
    return SUCCESS


def _chosen(group: str | None, advanced: bool) -> dict[str, list[SettingInfo]]:
    """Settings by group; groups of which nothing is shown are left out."""
    import difflib

    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.settings import describe

    classes = options.setting_classes()
    if group is not None and group not in classes:
        near = difflib.get_close_matches(group, classes, n=1, cutoff=0.4)
        hint = f"Nearest: {near[0]}. " if near else ""
        raise RequestError(f"Unknown group '{group}'. {hint}Groups: {', '.join(classes)}.")
    chosen = {
        name: [info for info in describe(settings) if advanced or info.common]
        for name, settings in classes.items()
        if group in (None, name)
    }
    return {name: infos for name, infos in chosen.items() if infos}


def _facts(info: SettingInfo) -> dict[str, object]:
    return {
        "name": info.name,
        "type": info.type.__name__,
        "default": info.default,
        "low": info.low,
        "high": info.high,
        "choices": info.choices,
        "common": info.common,
        "description": info.description,
    }


def _text(chosen: dict[str, list[SettingInfo]]) -> str:
    """Name, default and bounds in a line, the meaning below it, within 79 columns."""
    classes = options.setting_classes()
    lines = []
    for group, infos in chosen.items():
        lines += textwrap.wrap(
            f"{group}: {_meaning(classes[group])}", _WIDTH, subsequent_indent=" " * 6
        )
        for info in infos:
            allowed = info.range_text().replace(", ", " to ") if not info.choices else ""
            allowed = allowed.strip("[]") if allowed else " | ".join(info.choices or ())
            lines.append(f"  {group}.{info.name} = {options.as_text(info.default)}  ({allowed})")
            lines += textwrap.wrap(
                info.description, _WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6
            )
        lines.append("")
    return "\n".join(lines) + ("\n" if lines else "")


def _markdown(chosen: dict[str, list[SettingInfo]]) -> str:
    classes = options.setting_classes()
    lines = []
    for group, infos in chosen.items():
        lines += [f"## {group}", "", _meaning(classes[group]), ""]
        lines += ["| setting | default | allowed | meaning |", "|---|---|---|---|"]
        lines += [
            f"| `{group}.{s.name}` | `{s.default}` | {s.range_text()} | {s.description} |"
            for s in infos
        ]
        lines.append("")
    return "\n".join(lines)


def _meaning(settings: type) -> str:
    return (settings.__doc__ or "").strip().splitlines()[0]
