"""What the commands say beside their result: notes, and progress where stderr is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def note(message: str) -> None:
    """Tell people something on stderr."""
    print(message, file=sys.stderr)


def check_writable(path: Path | None) -> None:
    """Refuse a file that cannot be written before the work is done, not after it.

    Raises
    ------
    RequestError
        With the directory that is missing.
    """
    from gpis_grasp_planner.errors import RequestError

    if path is None or str(path) == "-":
        return
    if path.is_dir() or not path.parent.is_dir():
        fault = "is a directory" if path.is_dir() else f"needs the directory {path.parent}"
        raise RequestError(f"Cannot write {path}: it {fault}. Name a file in a directory there is.")


def check_picture(path: Path | None) -> None:
    """Refuse a picture that cannot be drawn or written, or of an unknown format, before the work.

    Raises
    ------
    RequestError
        With the suffixes that are known, or what is to be installed.
    """
    from gpis_grasp_planner.errors import RequestError

    if path is None:
        return
    check_drawable()
    from PIL import Image

    known = {ending for ending, kind in Image.registered_extensions().items() if kind in Image.SAVE}
    if path.suffix.lower() not in known:
        raise RequestError(
            f"The picture {path} has "
            + (f"the unknown suffix {path.suffix}" if path.suffix else "no suffix")
            + f", which names the format. Write {path.stem or 'picture'}.png, or .jpg, .webp, .pdf."
        )
    check_writable(path)


def check_drawable() -> None:
    """Refuse where the libraries that draw are not installed.

    Raises
    ------
    RequestError
        With the command that installs them.
    """
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.extras import how_to_install, is_installed

    if not is_installed("PIL"):
        raise RequestError(how_to_install("A picture", "Pillow", "pictures"))


def check_cluster() -> None:
    """Refuse where the library of a cluster is not installed.

    Raises
    ------
    RequestError
        With the command that installs it.
    """
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.extras import how_to_install, is_installed

    if not is_installed("distributed"):
        raise RequestError(how_to_install("A cluster", "Dask distributed", "cluster"))


@contextmanager
def count_progress(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """Show a bar over `total` things, moved on by the name of each; silent without a terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    screen = Console(file=sys.stderr, highlight=False)
    columns = (
        TextColumn(what),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[last]}"),
    )
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task("", total=total, last="")
        yield lambda name: bar.update(task, advance=1, last=name)
