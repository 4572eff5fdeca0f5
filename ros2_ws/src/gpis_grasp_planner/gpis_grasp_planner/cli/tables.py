"""Tables on stdout: whole columns or none, never a shortened figure.

On a terminal the columns that matter least are left out until the rest fits; into a file or pipe
all of them go, one row per line, without padding at the end of a line.
"""

from __future__ import annotations

import io
import os
import shutil
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

_GAP = 2


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes
    ----------
    heading : str
    cells : sequence of str
    priority : int
        0 stays always; on a narrow terminal the columns of the largest number go first.
    left : bool
        Text on the left, not figures on the right.
    """

    heading: str
    cells: Sequence[str]
    priority: int = 0
    left: bool = False

    @property
    def width(self) -> int:
        """Characters of its widest line."""
        from rich.cells import cell_len

        return max(cell_len(text) for text in (self.heading, *self.cells))


def screen_width() -> int | None:
    """Characters that a line on stdout may have; None where that is no terminal."""
    if not sys.stdout.isatty():
        return None
    return shutil.get_terminal_size().columns - 1


def fitting(columns: Sequence[Column], width: int | None) -> list[Column]:
    """Those columns that fit into `width` (None: any), in their order.

    Of columns with the same priority the last goes first.
    """
    kept = list(columns)
    while width is not None and sum(c.width for c in kept) + _GAP * (len(kept) - 1) > width:
        last = max(range(len(kept)), key=lambda i: (kept[i].priority, i))
        if kept[last].priority == 0:
            break
        del kept[last]
    return kept


def table_text(columns: Sequence[Column], width: int | None = None, bold: bool = False) -> str:
    """The table of the columns that fit into `width`, as lines without blanks at their end.

    `bold` writes the headings so, for a terminal.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    kept = fitting(columns, width)
    table = Table(box=None, padding=(0, _GAP, 0, 0), pad_edge=False, show_header=False)
    for column in kept:
        table.add_column(justify="left" if column.left else "right", no_wrap=True)
    table.add_row(*(Text(column.heading, style="bold" if bold else "") for column in kept))
    table.add_row(*("-" * column.width for column in kept))
    for row in zip(*(column.cells for column in kept), strict=True):
        table.add_row(*(Text(cell) for cell in row))
    everything = sum(column.width + _GAP for column in kept) + 1
    sheet = io.StringIO()
    terminal = Console(file=sheet, width=everything, force_terminal=bold, highlight=False)
    terminal.print(table)
    return "\n".join(line.rstrip() for line in sheet.getvalue().splitlines()) + "\n"


def print_table(columns: Sequence[Column]) -> None:
    """Print a table as fits where stdout goes."""
    width = screen_width()
    sys.stdout.write(
        table_text(columns, width, bold=width is not None and not os.environ.get("NO_COLOR"))
    )


def print_text(text: str) -> None:
    """Print a sentence, folded between words on a terminal, in one line elsewhere."""
    width = screen_width()
    print(text if width is None else textwrap.fill(text, width, break_long_words=False))
