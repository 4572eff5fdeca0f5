"""PLY: where the data of a binary file start."""

from __future__ import annotations

import mesh_dialects as d
import numpy as np
import pytest

from gpis_grasp_planner.geometry.formats.ply import read_ply


@pytest.mark.parametrize("all_lines", [False, True])
def test_an_end_of_line_of_two_bytes_behind_the_header_is_one_end(all_lines):
    data = d.binary_ply(d.BOX)
    plain = read_ply(data, "box.ply", 1000)
    at = data.index(b"end_header\n")
    head = data[:at].replace(b"\n", b"\r\n") if all_lines else data[:at]
    found = read_ply(head + b"end_header\r\n" + data[at + 11 :], "box.ply", 1000)
    np.testing.assert_array_equal(found.vertices, plain.vertices)
    np.testing.assert_array_equal(found.faces, plain.faces)
