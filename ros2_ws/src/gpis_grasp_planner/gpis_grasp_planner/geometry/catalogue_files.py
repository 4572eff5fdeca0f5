"""The files of a catalogue directory: which of them an ID can name, and why not the others."""

from __future__ import annotations

import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from gpis_grasp_planner.geometry.mesh_file import PART_SUFFIXES

_SEGMENT = r"[A-Za-z0-9](?:[A-Za-z0-9_-]|\.(?!\.)){0,63}"
MOST_FOLDERS = 8
ID_PATTERN = re.compile(rf"(?:{_SEGMENT}/){{0,{MOST_FOLDERS}}}{_SEGMENT}", re.ASCII)
_NAME_PATTERN = re.compile(_SEGMENT, re.ASCII)

# Endings of shapes that are not read, which a user may expect in the list.
_NOT_READ = (
    ".gltf", ".dae", ".fbx", ".3ds", ".amf", ".wrl", ".x3d", ".iges", ".igs", ".brep", ".x_t",
    ".x_b", ".sldprt", ".sldasm", ".ipt", ".iam", ".catpart", ".prt", ".f3d", ".blend", ".dxf",
    ".dwg", ".scad", ".fcstd", ".usd", ".usdz", ".vtk", ".msh",
)  # fmt: skip


@dataclass(frozen=True)
class CatalogueFile:
    """A mesh file: its path, and the two IDs that may name it."""

    path: Path
    name: str
    stem: str


def files_of(directory: Path) -> list[CatalogueFile]:
    """Regular mesh files with allowed names that lie inside a directory, sorted."""
    return [
        _file(directory, path)
        for path in _walk(directory)
        if path.suffix.lower() in PART_SUFFIXES
        and _name_fault(directory, path) is None
        and is_inside(path, directory)
    ]


def with_id(directory: Path, mesh_id: str) -> list[CatalogueFile]:
    """Mesh files, of whatever kind, that an allowed ID may mean; only their folder is listed."""
    *folders, _ = mesh_id.split("/")
    folder = directory
    for part in folders:
        folder = folder / part
        if folder.is_symlink():
            return []
    files = [
        _file(directory, p)
        for p in _entries(folder)
        if p.suffix.lower() in PART_SUFFIXES and _NAME_PATTERN.fullmatch(p.stem)
    ]
    return [f for f in files if mesh_id in (f.name, f.stem)]


def refused_files(directory: Path) -> Iterator[tuple[str, str]]:
    """Files that look like meshes and have no ID: path in the directory, and reason with cure."""
    for path in _walk(directory):
        name = path.relative_to(directory).as_posix()
        suffix = path.suffix.lower()
        if suffix in _NOT_READ:
            yield name, f"its format {suffix} is not read; export STEP, STL, OBJ, PLY, 3MF or GLB"
        elif suffix not in PART_SUFFIXES:
            continue
        elif (fault := _name_fault(directory, path)) is not None:
            yield name, fault
        elif not is_inside(path, directory):
            yield (
                name,
                (
                    "it is no regular file inside the catalogue (a link out of it, a pipe or a "
                    "device); put the file itself there"
                ),
            )


def is_inside(path: Path, directory: Path) -> bool:
    """Whether a path names a regular file inside a directory, links resolved."""
    try:
        resolved = path.resolve(strict=True)
        return resolved.is_relative_to(directory) and stat.S_ISREG(resolved.stat().st_mode)
    except (OSError, RuntimeError):
        return False


def _file(directory: Path, path: Path) -> CatalogueFile:
    name = path.relative_to(directory).as_posix()
    return CatalogueFile(path, name, name[: len(name) - len(path.suffix)])


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []  # a directory that went away knows no IDs


def _walk(directory: Path, depth: int = 0) -> Iterator[Path]:
    """Everything but folders, down to :data:`MOST_FOLDERS`; hidden and linked folders are left."""
    for path in _entries(directory):
        if path.is_dir() and not path.is_symlink() and path.suffix.lower() not in PART_SUFFIXES:
            if depth < MOST_FOLDERS and not path.name.startswith("."):
                yield from _walk(path, depth + 1)
        elif not path.name.startswith("."):
            yield path


def _name_fault(directory: Path, path: Path) -> str | None:
    """Why a file's path is no ID, with the cure; None if it is one."""
    *folders, _ = path.relative_to(directory).parts
    for part, what in [*((f, "folder") for f in folders), (path.stem, "file")]:
        if _NAME_PATTERN.fullmatch(part) is None:
            better = re.sub(r"\.{2,}", ".", re.sub(r"[^A-Za-z0-9._-]+", "_", part)).lstrip("._-")
            ending = path.suffix if what == "file" else ""
            return (
                f"the {what}'s name {_what_is_wrong(part)}; rename it, such as "
                f"'{better[:60] or 'part'}{ending}'"
            )
    return None


def _what_is_wrong(name: str) -> str:
    if len(name) > 64:
        return f"has {len(name)} characters, at most 64 can be an ID"
    for character in name:
        if character.isspace():
            return "has a blank"
        if not (character.isascii() and (character.isalnum() or character in "._-")):
            return f"has the character {character!a}"
    if ".." in name:
        return "has two points in a row"
    return "does not start with a letter or digit"
