"""Tables: whole columns or none, whatever the width."""

from __future__ import annotations

from pathlib import Path

import pytest
from terminal_sessions import in_pipe, in_terminal

from gpis_grasp_planner.cli.tables import Column, fitting, table_text

COLUMNS = (
    Column("#", ["0", "1"]),
    Column("epsilon", ["0.1493", "0.0007"], 1),
    Column("cause", ["", "lost while closing"], 3, left=True),
    Column("slip [mm]", ["-0.2", "113.4"], 2),
)


def test_a_wide_table_has_every_column_and_no_blanks_at_the_end() -> None:
    assert table_text(COLUMNS) == (
        "#  epsilon  cause               slip [mm]\n"
        "-  -------  ------------------  ---------\n"
        "0   0.1493                           -0.2\n"
        "1   0.0007  lost while closing      113.4\n"
    )


@pytest.mark.parametrize(
    ("width", "headings"),
    [
        (41, ["#", "epsilon", "cause", "slip [mm]"]),
        (40, ["#", "epsilon", "slip [mm]"]),
        (21, ["#", "epsilon", "slip [mm]"]),
        (20, ["#", "epsilon"]),
        (9, ["#"]),
        (0, ["#"]),
    ],
)
def test_what_matters_least_goes_first_and_as_a_whole(width: int, headings: list[str]) -> None:
    assert [column.heading for column in fitting(COLUMNS, width)] == headings
    lines = table_text(COLUMNS, width).splitlines()
    assert max(map(len, lines)) <= max(width, 1)
    for column in fitting(COLUMNS, width):
        for cell, line in zip(column.cells, lines[2:], strict=True):
            assert cell in line


def test_of_equal_columns_the_last_goes_first() -> None:
    columns = [Column("a", ["1"], 1), Column("b", ["2"], 1)]
    assert [column.heading for column in fitting(columns, 3)] == ["a"]


def test_markup_and_wide_letters_are_text() -> None:
    columns = [Column("[bold]", ["[red]x"], left=True), Column("n", ["1"])]
    assert table_text(columns) == "[bold]  n\n------  -\n[red]x  1\n"
    columns = [Column("part", ["歯車", "gear"], left=True), Column("n", ["1", "2"])]
    assert table_text(columns).splitlines()[2:] == ["歯車  1", "gear  2"]


def test_a_table_without_rows() -> None:
    assert table_text([Column("mesh ID", [])]) == "mesh ID\n-------\n"


@pytest.mark.parametrize("columns", [80, 100, 140])
def test_the_catalogue_in_a_terminal(tmp_path: Path, columns: int) -> None:
    name = "a_long_name_such_as_housing_cover_left"
    (tmp_path / f"{name}.stl").write_bytes(b"")
    code, text = in_terminal(columns, "meshes", "--meshes", tmp_path)
    assert code == 1
    assert "…" not in text
    assert max(map(len, text.splitlines())) < columns
    assert f"{name}: MESH_EMPTY" in text


def test_the_catalogue_in_a_pipe_has_one_row_per_part_and_its_notes_in_one_line(
    tmp_path: Path,
) -> None:
    (tmp_path / "broken.stl").write_bytes(b"")
    answer = in_pipe("meshes", "--meshes", tmp_path)
    lines = answer.stdout.splitlines()
    assert lines[0].startswith("mesh ID")
    assert lines[2].split() == ["broken", "MESH_EMPTY"]
    assert lines[3] == ""
    assert lines[4].startswith("broken: MESH_EMPTY: ")
    assert len(lines) == 5
    assert all(line == line.rstrip() for line in lines)
    assert "\x1b" not in answer.stdout
