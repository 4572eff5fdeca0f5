"""The node's parameters as a file for ``--params-file``: ``config/grasp_planner.yaml``.

``python -m gpis_grasp_planner.ros.parameter_file FILE`` writes it; a test compares it.
"""

from __future__ import annotations

import argparse
import json
import textwrap
from pathlib import Path

from gpis_grasp_planner.ros.parameter_groups import parameter_groups
from gpis_grasp_planner.settings import SettingInfo, describe

HEAD = """\
# Parameters of the grasp planner's node, with their defaults: made from the settings' declarations
# by `python -m gpis_grasp_planner.ros.parameter_file FILE`. Copy it, and change the copy:
#
#   grasp_planner_node --ros-args --params-file my_cell.yaml
#
# The node's own parameters and those that are changed most often stand as values, the others as
# comments. An empty list cannot be written in such a file and is a comment as well.
# Where a value is refused the node says why, and ends.

/**:
  ros__parameters:
"""
_WIDTH = 100


def parameter_file() -> str:
    """Text of ``config/grasp_planner.yaml``."""
    lines = [HEAD.rstrip("\n")]
    for group, kind in parameter_groups().items():
        title = f"{group}.*" if group else "The node"
        summary = (kind.__doc__ or "").strip().splitlines()[0]
        lines += ["", f"    # {title}: {summary}"]
        for info in describe(kind):
            lines += _entry(f"{group}.{info.name}" if group else info.name, info, own=not group)
    return "\n".join(lines) + "\n"


def _entry(name: str, info: SettingInfo, *, own: bool) -> list[str]:
    what = f"{info.description} Allowed: {info.range_text()}."
    comment = textwrap.wrap(what, _WIDTH - 8, break_on_hyphens=False)
    active = (own or info.common) and info.default != ()
    line = f"{'' if active else '# '}{name}: {_value(info)}"
    return [*(f"    #   {words}" for words in comment), f"    {line}"]


def _value(info: SettingInfo) -> str:
    if info.type is float:
        mantissa, e, exponent = repr(float(info.default)).partition("e")
        # YAML 1.1 takes 1e-06 for a text.
        return mantissa + (".0" if e and "." not in mantissa else "") + e + exponent
    return json.dumps(info.default)  # quotes every text, and YAML reads it


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="written over where it is there")
    parser.parse_args().file.write_text(parameter_file(), encoding="utf-8")
