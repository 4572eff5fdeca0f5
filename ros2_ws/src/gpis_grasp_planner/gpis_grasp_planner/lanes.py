"""The lowest of many points along a direction, eight at a time, as compiled code.

LLVM does not find by itself that the smallest of a hundred numbers and its place can be sought in
eight strands: the loop waits for every comparison. Written in its vectors it takes 24 ns in place
of 80, to the same bit; a processor without such wide registers gets as many narrow ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from gpis_grasp_planner.compiled import njit

LANES = 8
_BYTES = 8  # of a float64
_DOUBLE, _INT = ir.DoubleType(), ir.IntType(64)
_DOUBLES, _INTS = ir.VectorType(_DOUBLE, LANES), ir.VectorType(_INT, LANES)
_LANE_NUMBERS = ir.VectorType(ir.IntType(32), LANES)


def _constant(kind: ir.VectorType, value: float) -> ir.Constant:
    return ir.Constant(kind, [value] * LANES)


def _in_all(builder: Any, value: Any, kind: ir.VectorType) -> Any:
    """A vector with the value in every lane."""
    undefined = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, undefined, _constant(_LANE_NUMBERS, 0))


@intrinsic
def _lowest_along(typing, columns, n, x, y, z):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """See `lowest_along`."""
    signature = types.Tuple((types.int64, types.float64))(columns, n, x, y, z)

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        row = builder.extract_value(array.strides, 0)
        start = builder.ptrtoint(array.data, _INT)
        rows = [builder.add(start, builder.mul(row, ir.Constant(_INT, k))) for k in range(3)]
        along = [_in_all(builder, value, _DOUBLES) for value in arguments[2:]]
        best = cgutils.alloca_once_value(builder, _constant(_DOUBLES, np.inf))
        place = cgutils.alloca_once_value(builder, _constant(_INTS, 0))
        zero, step = ir.Constant(_INT, 0), ir.Constant(_INT, LANES)
        with cgutils.for_range_slice(builder, zero, arguments[1], step, _INT) as (i, _):
            height = None
            for first, factor in zip(rows, along, strict=True):
                address = builder.add(first, builder.mul(i, ir.Constant(_INT, _BYTES)))
                numbers = builder.load(builder.inttoptr(address, _DOUBLES.as_pointer()))
                numbers.align = _BYTES
                product = builder.fmul(numbers, factor)
                height = product if height is None else builder.fadd(height, product)
            lower = builder.fcmp_ordered("<", height, builder.load(best))
            builder.store(builder.select(lower, height, builder.load(best)), best)
            here = builder.add(_in_all(builder, i, _INTS), ir.Constant(_INTS, list(range(LANES))))
            builder.store(builder.select(lower, here, builder.load(place)), place)
        heights, places = builder.load(best), builder.load(place)
        value = _reduced(builder, "fmin", heights, _DOUBLE)
        equal = builder.fcmp_ordered("==", heights, _in_all(builder, value, _DOUBLES))
        among = builder.select(equal, places, _constant(_INTS, 2**62))
        index = _reduced(builder, "smin", among, _INT)
        return context.make_tuple(builder, signature.return_type, [index, value])

    return signature, code


def _reduced(builder: Any, how: str, vector: Any, kind: Any) -> Any:
    """The lanes' minimum by an intrinsic function of LLVM."""
    letter = "f" if kind is _DOUBLE else "i"
    function = cgutils.get_or_insert_function(
        builder.module,
        ir.FunctionType(kind, [vector.type]),
        f"llvm.vector.reduce.{how}.v{LANES}{letter}64",
    )
    flags = ("nnan", "nsz") if kind is _DOUBLE else ()
    return builder.call(function, [vector], fastmath=flags)


@njit(allocates=False)
def lowest_along(columns, n, x, y, z):  # type: ignore[no-untyped-def]
    """Index and height of the lowest of n points along (x, y, z), the first of equal ones.

    Parameters
    ----------
    columns : (3, N) array
        The points' coordinates; rows have no gaps.
    n : int
        A multiple of `LANES`, N at most: see `filled`.
    x, y, z : float
    """
    return _lowest_along(columns, n, x, y, z)  # type: ignore[call-arg]


@njit(allocates=False)
def filled(columns, n):  # type: ignore[no-untyped-def]
    """Repeat the last of n points until their number is a multiple of `LANES`; returns that.

    What is repeated comes after its original, and never is the first of equal ones.
    """
    full = -(-n // LANES) * LANES
    for c in range(3):
        for i in range(n, full):
            columns[c, i] = columns[c, n - 1]
    return full
