"""Text from outside cannot forge lines of the log."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.ros.text import printable


def test_control_characters_are_escaped() -> None:
    assert printable("a\nb\x00\x1b[31m") == r"a\nb\x00\x1b[31m"
    assert printable("Becher \u00fc") == r"Becher \xfc"


@given(st.text(), st.integers(4, 50))
def test_the_result_is_short_printable_ascii(text: str, limit: int) -> None:
    result = printable(text, limit)
    assert len(result) <= limit
    assert result.isascii()
    assert result.isprintable()
