"""Arrays come back as they were, or not at all."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.packed_arrays import pack, unpack


@pytest.fixture
def arrays(rng):
    return {
        "field": rng.normal(size=(3, 4, 5)).astype(np.float32),
        "child": rng.integers(100, size=(7, 2)),
        "palm": rng.random(5) < 0.5,
        "nothing": np.empty((0, 3)),
        "across": rng.normal(size=(4, 3)).T,
        "spacing": 0.25,
        "joints": 8,
    }


def test_arrays_come_back_bit_by_bit(arrays):
    got = unpack(bytearray(pack(arrays)))
    assert list(got) == list(arrays)
    for name, array in arrays.items():
        assert got[name].dtype == np.asarray(array).dtype
        np.testing.assert_array_equal(got[name], array)


def test_compiled_code_takes_them_as_it_takes_fresh_ones(arrays):
    for array in unpack(bytearray(pack(arrays))).values():
        assert array.flags.c_contiguous
        assert array.flags.aligned
        assert array.flags.writeable


def test_every_bit_that_changes_is_noticed(arrays, rng):
    content = pack(arrays)
    for at in rng.integers(len(content), size=200):
        damaged = bytearray(content)
        damaged[at] ^= 1 << int(rng.integers(8))
        with pytest.raises(ValueError, match=r"checksum|no packed"):
            unpack(damaged)


@pytest.mark.parametrize("length", [0, 10, 40, 60, 100, 1000])
def test_a_beginning_is_noticed(arrays, length):
    with pytest.raises(ValueError, match=r"checksum|no packed"):
        unpack(bytearray(pack(arrays)[:length]))


def test_objects_are_refused():
    with pytest.raises(TypeError, match="things"):
        pack({"things": np.array([object()])})
