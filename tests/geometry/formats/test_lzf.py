"""LZF: known streams, and damaged ones that write nowhere."""

from __future__ import annotations

import pytest

from gpis_grasp_planner.geometry.formats.lzf import unpacked


@pytest.mark.parametrize(
    ("data", "content"),
    [
        (b"\x02abc", b"abc"),
        (b"\x02abc\x20\x02", b"abcabc"),  # 3 bytes from 3 back
        (b"\x00a\xe0\x05\x00", b"a" * 15),  # a long copy that overlaps what it writes
        (b"\x01ab\x1f" + bytes(range(32)) + b"\x40\x21", b"ab" + bytes(range(32)) + b"ab\x00\x01"),
    ],
)
def test_known_streams(data, content):
    assert unpacked(data, len(content)) == content


@pytest.mark.parametrize(
    ("data", "size"),
    [
        (b"\x02ab", 3),  # a run that ends too early
        (b"\x02abc\x20", 6),  # a copy without its offset
        (b"\x02abc\xe0", 20),  # a long copy without its length
        (b"\x02abc\x20\x03", 6),  # from before the start
        (b"\x02abc\x20\x02", 5),  # more than was promised
        (b"\x02abc", 4),  # less
        (b"\x02abc", 10**12),  # more than can be
    ],
)
def test_damaged_streams_are_refused(data, size):
    assert unpacked(data, size) is None
