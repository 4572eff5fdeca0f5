"""Parameter files of which no section is for this node.

ROS passes them over without a word: one that was written for another name or namespace would have
the node plan with its defaults.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from gpis_grasp_planner.ros.text import printable

_VALUES = "ros__parameters"


def passed_over(arguments: Sequence[str], node_name: str) -> list[str]:
    """A sentence for each parameter file that says nothing to a node.

    Parameters
    ----------
    arguments : sequence of str
        Those of the program, which ROS has taken.
    node_name : str
        With its namespace, such as ``/cell1/grasp_planner``.
    """
    told = []
    for file in parameter_files(arguments):
        sections = sections_of(file)
        if sections and not any(is_for(section, node_name) for section in sections):
            names = ", ".join(f"'{printable(section, 60)}'" for section in sections[:5])
            told.append(
                f"Nothing of the parameter file '{printable(Path(file).name, 80)}' is used: it has "
                f"sections for {names} and none for this node. Name one '{node_name}', or '/**'."
            )
    return told


def parameter_files(arguments: Sequence[str]) -> list[str]:
    """The files that are given to all nodes of a program."""
    files, of_ros = [], False
    for argument, following in zip(arguments, [*arguments[1:], ""], strict=True):
        if argument == "--ros-args":
            of_ros = True
        elif argument == "--":
            of_ros = False
        elif of_ros and argument == "--params-file" and following:
            files.append(following)
    return files


def sections_of(file: str) -> list[str]:
    """For which nodes a file has values; none where it cannot be read, which ROS says itself."""
    try:
        content = yaml.safe_load(Path(file).read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return []
    return list(_sections(content, ""))


def is_for(section: str, node_name: str) -> bool:
    """Whether ROS gives a section's values to a node: ``*`` is one name, ``**`` any number."""
    words = section.strip("/").split("/")
    pattern = "".join(
        {"*": "/[^/]+", "**": "(/[^/]+)*"}.get(word, "/" + re.escape(word)) for word in words
    )
    return re.fullmatch(pattern, node_name) is not None


def _sections(content: Any, above: str) -> Iterator[str]:
    if not isinstance(content, Mapping):
        return
    for name, inner in content.items():
        if name == _VALUES:
            yield above
        else:
            yield from _sections(inner, f"{above}/{str(name).strip('/')}")
