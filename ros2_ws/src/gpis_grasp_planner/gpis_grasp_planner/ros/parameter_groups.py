"""Which groups of settings are the node's parameters, and their page ``docs/parameters.md``.

``python -m gpis_grasp_planner.ros.parameter_groups docs/parameters.md`` writes the page; a test
compares it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.plan.settings import setting_groups
from gpis_grasp_planner.ros.settings import READ_ONLY, NodeSettings
from gpis_grasp_planner.settings import SettingInfo, SettingsGroup, describe

HEAD = """# Parameters of the node

Made from the settings' declarations by
`python -m gpis_grasp_planner.ros.parameter_groups docs/parameters.md`; do not edit.

Set them at the start (`--ros-args -p max_pose_age_s:=2.0`, or `--params-file`) or at run time
(`ros2 param set`). A value outside the limits is refused with the reason: at the start the node
ends with exit code 2, at run time the old value stays. A name that does not exist is refused as
well. Read-only parameters are fixed at the start.
"""


def parameter_groups() -> dict[str, type[SettingsGroup]]:
    """Groups by the first part of their parameters' names; the node's own have none ("")."""
    return {"": NodeSettings, "catalogue": CatalogueSettings, **setting_groups()}


def parameter_infos() -> dict[str, SettingInfo]:
    """All parameters by full name, in the order of declaration."""
    return {
        f"{group}.{info.name}" if group else info.name: info
        for group, kind in parameter_groups().items()
        for info in describe(kind)
    }


def parameters_page() -> str:
    """Text of ``docs/parameters.md``."""
    lines = [HEAD]
    for group, kind in parameter_groups().items():
        title = f"`{group}.*`" if group else "The node"
        summary = (kind.__doc__ or "").strip().splitlines()[0]
        lines += [f"## {title}", "", summary, ""]
        lines += [
            "| parameter | type | default | allowed | what it does |",
            "|---|---|---|---|---|",
        ]
        for info in describe(kind):
            name = f"{group}.{info.name}" if group else info.name
            default = list(info.default) if info.type is tuple else info.default
            kind_name = {"tuple": "string array", "str": "string", "float": "double"}.get(
                info.type.__name__, info.type.__name__
            )
            fixed = " Read-only." if name in READ_ONLY else ""
            lines.append(
                f"| `{name}` | {kind_name} | `{default}` | {info.range_text()} | "
                f"{info.description}{fixed} |"
            )
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="written over where it is there")
    parser.parse_args().file.write_text(parameters_page(), encoding="utf-8")
