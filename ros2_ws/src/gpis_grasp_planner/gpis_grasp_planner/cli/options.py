"""Options that several commands share, and what they mean."""

from __future__ import annotations

import argparse
import difflib
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpis_grasp_planner.cli import completion

if TYPE_CHECKING:
    from gpis_grasp_planner.geometry.catalogue import CatalogueSettings, MeshCatalogue
    from gpis_grasp_planner.geometry.part import Friction, Part
    from gpis_grasp_planner.plan.document import GraspDocument, MeshSource
    from gpis_grasp_planner.plan.settings import PlannerSettings
    from gpis_grasp_planner.settings import SettingInfo, SettingsGroup

CATALOGUE_GROUP = "catalogue"


def add_catalogue(parser: argparse.ArgumentParser) -> None:
    """Add --meshes, the directories of the catalogue."""
    parser.add_argument(
        "--meshes",
        metavar="DIR",
        action="append",
        type=Path,
        help="directory of the mesh catalogue, repeatable; default: the shipped parts",
    )


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add --set and --settings."""
    assignment = parser.add_argument(
        "--set",
        metavar="GROUP.NAME=VALUE",
        action="append",
        default=[],
        dest="assignments",
        help="change a setting, repeatable; 'gpis-grasp settings' lists them",
    )
    assignment.completer = completion.setting_names  # type: ignore[attr-defined]
    parser.add_argument(
        "--settings",
        metavar="FILE.yaml",
        type=Path,
        help="settings as groups of names and values; --set goes over it",
    )


def add_hand(parser: argparse.ArgumentParser) -> None:
    """Add --hand."""
    hand = parser.add_argument(
        "--hand",
        metavar="HAND",
        help="name of a hand that 'gpis-grasp hand' lists, or its YAML file; default: the "
        "setting hand.model",
    )
    hand.completer = completion.hand_names  # type: ignore[attr-defined]


def with_hand(assignments: Sequence[str], hand: str | None) -> list[str]:
    """Assignments of settings with that of the hand."""
    return [*assignments, *([] if hand is None else [f"hand.model={hand}"])]


def add_objective(parser: argparse.ArgumentParser) -> None:
    """Add --objective and --task."""
    parser.add_argument(
        "--objective",
        metavar="NAME",
        help="what the search maximises: paper (epsilon + lambda volume), min_weight, "
        "least_friction, task, or a measure of an installed distribution; default: the setting "
        "objective.name",
    )
    parser.add_argument(
        "--task",
        metavar="TASK",
        help="the task that --objective task is for, such as 'lift 0 0 1', 'insert 0 0 -1 at "
        "0 0 -0.04', 'turn 0 0 1' or 'screw 0 0 1', in the part's frame, several joined by '+'; "
        "alone it implies --objective task",
    )


def with_objective(
    assignments: Sequence[str], objective: str | None, task: str | None
) -> list[str]:
    """Assignments of settings with those of --objective and --task."""
    if task is not None and objective is None:
        objective = "task"
    return [
        *assignments,
        *([] if objective is None else [f"objective.name={objective}"]),
        *([] if task is None else [f"objective.task={task}"]),
    ]


def add_arm(parser: argparse.ArgumentParser) -> None:
    """Add --arm."""
    parser.add_argument(
        "--arm",
        metavar="ARM",
        help="the arm that carries the hand: six_axis, seven_axis, or an arm's YAML file with its "
        "base and flange (docs/arm.md); default: the setting arm.model, which is none",
    )


def with_arm(assignments: Sequence[str], arm: str | None) -> list[str]:
    """Assignments of settings with that of the arm."""
    return [*assignments, *([] if arm is None else [f"arm.model={arm}"])]


def add_document(parser: argparse.ArgumentParser) -> None:
    """Add a document of grasps and, where its mesh is elsewhere, the mesh."""
    parser.add_argument("document", metavar="GRASPS.json", type=Path, help="of 'plan --json'")
    parser.add_argument(
        "--mesh",
        metavar="MESH",
        help="the document's mesh, where it is not where it was: catalogue ID or file",
    )
    add_mesh_file(parser)
    add_catalogue(parser)


def add_mesh_file(parser: argparse.ArgumentParser) -> None:
    """Add --unit and --body, which say how a mesh file outside of the catalogue is read."""
    from gpis_grasp_planner.geometry.units import UNITS

    parser.add_argument("--unit", choices=tuple(UNITS), help="unit of a mesh file")
    parser.add_argument(
        "--body",
        metavar="NAME",
        help="the one body of a mesh file that is the part: its name, or its number from 1",
    )


def setting_classes() -> dict[str, type[SettingsGroup]]:
    """All groups of settings by name: the planner's and the catalogue's."""
    from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
    from gpis_grasp_planner.plan.settings import setting_groups

    return {**setting_groups(), CATALOGUE_GROUP: CatalogueSettings}


def read_settings(
    file: Path | None, assignments: Sequence[str]
) -> tuple[PlannerSettings, CatalogueSettings]:
    """Settings of planner and catalogue, see :func:`read_groups`."""
    from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
    from gpis_grasp_planner.plan.settings import PlannerSettings, setting_groups

    groups = read_groups(file, assignments)
    of_planner = {name: values for name, values in groups.items() if name in setting_groups()}
    catalogue = CatalogueSettings.from_mapping(groups.get(CATALOGUE_GROUP, {}))
    return PlannerSettings.from_mapping(of_planner), catalogue


def read_groups(file: Path | None, assignments: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Values by group from a YAML file and, over it, from ``group.name=value`` texts.

    Groups that a command does not use are checked all the same, so that one file serves all.

    Raises
    ------
    RequestError
        INVALID_SETTING with what is known, for an unknown name or a bad value.
    """
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.settings import describe

    values: dict[str, dict[str, Any]] = {}
    for group, content in _settings_of_file(file).items():
        if not isinstance(content, Mapping):
            raise RequestError(f"Group '{group}' of {file} is {content!r}; give names and values.")
        values[str(group)] = {str(name): value for name, value in content.items()}
    for assignment in assignments:
        name, equals, value = assignment.partition("=")
        group, dot, name = name.strip().partition(".")
        if not equals or not dot:
            raise RequestError(
                f"Setting '{assignment}' is not of the form group.name=value, such as "
                "hpp.batch=4. 'gpis-grasp settings' lists all."
            )
        values.setdefault(group, {})[name] = value.strip()
    classes = setting_classes()
    unknown = sorted(set(values) - set(classes))
    if unknown:
        near = difflib.get_close_matches(unknown[0], classes, n=1)
        raise RequestError(
            f"Unknown group of settings {', '.join(unknown)}; "
            + (f"nearest is {near[0]}; " if near else "")
            + f"known are {', '.join(classes)}."
        )
    for group, content in values.items():
        infos = {info.name: info for info in describe(classes[group])}
        for name, value in content.items():
            if name not in infos:
                raise RequestError(_unknown(group, name, classes))
            if isinstance(value, str):
                content[name] = _typed(value, infos[name])
        classes[group].from_mapping(content)
    return values


def _unknown(group: str, name: str, classes: Mapping[str, type[SettingsGroup]]) -> str:
    """Nearest names of the same group, or the same name of another one."""
    from gpis_grasp_planner.settings import describe

    own = [info.name for info in describe(classes[group])]
    near = [f"{group}.{word}" for word in difflib.get_close_matches(name, own, n=3, cutoff=0.5)]
    near += [
        f"{other}.{name}"
        for other, settings in classes.items()
        if name in (info.name for info in describe(settings))
    ]
    nearest = f"Nearest: {', '.join(near)}. " if near else ""
    return (
        f"Unknown setting '{group}.{name}'. {nearest}'gpis-grasp settings {group} --advanced' "
        f"lists the group."
    )


def _settings_of_file(file: Path | None) -> Mapping[str, Any]:
    import yaml

    from gpis_grasp_planner.errors import RequestError

    if file is None:
        return {}
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" (line {mark.line + 1})" if mark is not None else ""
        raise RequestError(f"{file} is not valid YAML{where}.") from None
    if content is None:
        return {}
    if not isinstance(content, Mapping):
        raise RequestError(f"{file} must hold groups of settings, such as 'hpp: {{batch: 4}}'.")
    return content


def _typed(text: str, info: SettingInfo) -> Any:
    """Read a text as the setting's type; what does not fit is left for its check to refuse."""
    if info.type is bool:
        return {"true": True, "false": False}.get(text.lower(), text)
    if info.type is tuple:
        return tuple(part.strip() for part in text.split(",") if part.strip())
    if info.type in (int, float):
        try:
            return info.type(text)
        except ValueError:
            return text
    return text


def as_text(value: Any) -> str:
    """A setting's value as --set takes it."""
    if isinstance(value, bool):
        return str(value).lower()
    return ",".join(value) if isinstance(value, tuple) else f"{value}"


def catalogue_of(
    directories: Sequence[Path] | None, settings: CatalogueSettings | None = None
) -> MeshCatalogue:
    """Return the catalogue of --meshes, or that of the shipped parts."""
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory

    return MeshCatalogue(directories or [default_catalogue_directory()], settings)


def find_part(
    mesh: str, unit: str | None, catalogue: MeshCatalogue, body: str | None = None
) -> tuple[Part, MeshSource | None]:
    """Load a part by catalogue ID or path, and say which file it was (None for a shipped part)."""
    return reader_of(mesh, unit, catalogue, body)()


def reader_of(
    mesh: str, unit: str | None, catalogue: MeshCatalogue, body: str | None = None
) -> Callable[[], tuple[Part, MeshSource | None]]:
    """What loads the part: a missing file is refused now, before the code that reads is there.

    A name with a directory in it is a path unless the catalogue knows it, and so is one with a
    suffix that names a file here, or with the suffix of a mesh file.
    """
    from gpis_grasp_planner.errors import MeshError, RequestError
    from gpis_grasp_planner.geometry.catalogue import load_part
    from gpis_grasp_planner.geometry.mesh_file import PART_SUFFIXES
    from gpis_grasp_planner.plan.document import MeshSource

    path = Path(mesh)
    named = os.sep in mesh or path.suffix.lower() in PART_SUFFIXES
    if named and path.suffix and not path.exists() and mesh not in catalogue.ids():
        raise MeshError(_no_file(path))
    in_folder = os.sep in mesh and (path.exists() or mesh not in catalogue.ids())
    if in_folder or (path.suffix and path.is_file()):
        return lambda: (
            load_part(path, unit, catalogue.settings, body=body),
            MeshSource(str(path), unit, body),
        )
    for option, value in (("--unit", unit), ("--body", body)):
        if value is not None:
            raise RequestError(
                f"{option} {value} is for mesh files; '{mesh}' is an ID of the catalogue, whose "
                f"YAML file says it. Leave {option} out, or give the file's path (./...)."
            )
    return lambda: (catalogue.load(mesh), _source_of(catalogue.file_of(mesh)))


def _source_of(path: Path) -> MeshSource | None:
    """Where a part of a catalogue is found again; None for a shipped part: it is always there."""
    from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
    from gpis_grasp_planner.plan.document import MeshSource

    if path.is_relative_to(default_catalogue_directory()):
        return None
    return MeshSource(str(path), None)


def _no_file(path: Path) -> str:
    """Say that a file is missing, and which of its folder has nearly that name."""
    folder = path.parent
    if not folder.is_dir():
        return f"No such file: {path} (there is no directory {folder}). Check the path."
    names = [entry.name for entry in folder.iterdir() if entry.is_file()]
    near = difflib.get_close_matches(path.name, names, n=1)
    hint = f"Did you mean {folder / near[0]}?" if near else "Check the path."
    return f"No such file: {path}. {hint} An ID has a suffix only where two files share a name."


_WHERE = "Name the mesh of the document with --mesh, or its catalogue with --meshes."


def part_of_document(document: GraspDocument, arguments: argparse.Namespace) -> Part:
    """Find the mesh of a document and check that it is the same one.

    Looked for under --mesh, else at the path in the document, else beside the document, else in
    the catalogue.
    """
    from gpis_grasp_planner.errors import MeshError, RequestError
    from gpis_grasp_planner.geometry.catalogue import load_part
    from gpis_grasp_planner.plan.document import check_same_mesh

    catalogue = catalogue_of(arguments.meshes)
    source = document.mesh_source
    mesh_id = document.result.mesh_id
    paths = (
        [Path(source.file), arguments.document.parent / Path(source.file).name] if source else []
    )
    path = next((path for path in paths if path.is_file()), None)
    if arguments.mesh is not None:
        part, _ = find_part(arguments.mesh, arguments.unit, catalogue, arguments.body)
    elif path is not None and source is not None:
        part = load_part(
            path,
            arguments.unit or source.unit,
            catalogue.settings,
            body=arguments.body or source.body,
        )
    elif source is None or mesh_id in catalogue.ids():
        try:
            part = catalogue.load(mesh_id)
        except RequestError as error:
            raise RequestError(f"{error} {_WHERE}", error.code) from error
    else:
        where = " nor ".join(str(path) for path in paths)
        raise MeshError(f"The mesh of the document is neither {where}. {_WHERE}")
    check_same_mesh(document.result, part)
    return part


def friction_of(
    finger: float | None, palm: float | None, part_friction: Friction | None
) -> Friction | None:
    """Return the friction asked for: --friction for all links, --friction-palm over it."""
    from gpis_grasp_planner.geometry.part import Friction
    from gpis_grasp_planner.plan.request import DEFAULT_FRICTION

    if finger is None and palm is None:
        return None
    base = part_friction or DEFAULT_FRICTION
    if finger is not None:
        base = Friction(finger, finger)
    return Friction(base.finger, base.palm if palm is None else palm)
