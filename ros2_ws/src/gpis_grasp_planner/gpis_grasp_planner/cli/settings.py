"""Print all settings with default, bounds and description, as Markdown."""

from __future__ import annotations

import argparse

from gpis_grasp_planner.cli import options
from gpis_grasp_planner.cli.exit_codes import SUCCESS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """'settings' has no options."""


def run(arguments: argparse.Namespace) -> int:  # noqa: ARG001
    """Print the tables."""
    print(settings_markdown(), end="")
    return SUCCESS


def settings_markdown() -> str:
    """All groups as Markdown tables, generated from their declarations."""
    from gpis_grasp_planner.settings import describe

    lines = []
    for group, settings in options.setting_classes().items():
        text = (settings.__doc__ or "").strip().splitlines()[0]
        lines += [f"## {group}", "", text, "", "| setting | default | allowed | meaning |"]
        lines.append("|---|---|---|---|")
        lines += [
            f"| `{group}.{s.name}` | `{s.default}` | {s.range_text()} | {s.description} |"
            for s in describe(settings)
        ]
        lines.append("")
    return "\n".join(lines)
