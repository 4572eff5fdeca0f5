"""The lowest of many numbers and its place, eight at a time, as compiled code.

LLVM does not find by itself that the smallest of a hundred numbers and its place can be sought in
eight strands: the loop waits for every comparison. Written in its vectors a search takes 24 ns in
place of 80, to the same bit; a processor without such wide registers gets as many narrow ones.
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
_SMALLEST_RATE = 1e-11
_DOUBLE, _INT = ir.DoubleType(), ir.IntType(64)
_DOUBLES, _INTS = ir.VectorType(_DOUBLE, LANES), ir.VectorType(_INT, LANES)
_LANE_NUMBERS = ir.VectorType(ir.IntType(32), LANES)


class _Numbers:
    """Consecutive rows of a C-contiguous array of float64, read and written by lanes."""

    def __init__(self, context: Any, builder: Any, kind: Any, value: Any):
        array = context.make_array(kind)(context, builder, value)
        self._builder = builder
        self._start = builder.ptrtoint(array.data, _INT)
        self._row = builder.extract_value(array.strides, 0)

    def _address(self, row: int, i: Any) -> Any:
        builder = self._builder
        first = builder.add(self._start, builder.mul(self._row, ir.Constant(_INT, row)))
        address = builder.add(first, builder.mul(i, ir.Constant(_INT, _BYTES)))
        return builder.inttoptr(address, _DOUBLES.as_pointer())

    def load(self, row: int, i: Any) -> Any:
        """Numbers i to i + 7 of a row."""
        numbers = self._builder.load(self._address(row, i))
        numbers.align = _BYTES
        return numbers

    def store(self, numbers: Any, i: Any) -> None:
        """Write numbers i to i + 7 of the first row."""
        self._builder.store(numbers, self._address(0, i)).align = _BYTES

    def along(self, direction: list[Any], i: Any) -> Any:
        """Products of points i to i + 7, columns of the array, with a direction."""
        total = None
        for row, factor in enumerate(direction):
            product = self._builder.fmul(self.load(row, i), factor)
            total = product if total is None else self._builder.fadd(total, product)
        return total


class _Lowest:
    """The lowest so far in every lane, and where it was."""

    def __init__(self, builder: Any):
        self._builder = builder
        self._value = cgutils.alloca_once_value(builder, _constant(_DOUBLES, np.inf))
        self._place = cgutils.alloca_once_value(builder, _constant(_INTS, 0))

    def look_at(self, numbers: Any, i: Any) -> None:
        """Numbers i to i + 7."""
        builder = self._builder
        best, place = builder.load(self._value), builder.load(self._place)
        lower = builder.fcmp_ordered("<", numbers, best)
        here = builder.add(_in_all(builder, i, _INTS), ir.Constant(_INTS, list(range(LANES))))
        builder.store(builder.select(lower, numbers, best), self._value)
        builder.store(builder.select(lower, here, place), self._place)

    def found(self) -> list[Any]:
        """Index and value of the lowest of all, the first of equal ones."""
        builder = self._builder
        best, place = builder.load(self._value), builder.load(self._place)
        value = _reduced(builder, "fmin", best, _DOUBLE)
        equal = builder.fcmp_ordered("==", best, _in_all(builder, value, _DOUBLES))
        among = builder.select(equal, place, _constant(_INTS, 2**62))
        return [_reduced(builder, "smin", among, _INT), value]


def _constant(kind: ir.VectorType, value: float) -> ir.Constant:
    return ir.Constant(kind, [value] * LANES)


def _in_all(builder: Any, value: Any, kind: ir.VectorType) -> Any:
    """A vector with the value in every lane."""
    undefined = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, undefined, _constant(_LANE_NUMBERS, 0))


def _reduced(builder: Any, how: str, vector: Any, kind: Any) -> Any:
    """The lanes' minimum, by an intrinsic function of LLVM."""
    letter = "f" if kind is _DOUBLE else "i"
    function = cgutils.get_or_insert_function(
        builder.module,
        ir.FunctionType(kind, [vector.type]),
        f"llvm.vector.reduce.{how}.v{LANES}{letter}64",
    )
    flags = ("nnan", "nsz") if kind is _DOUBLE else ()
    return builder.call(function, [vector], fastmath=flags)


def _steps_of(builder: Any, n: Any) -> Any:
    """A loop over 0, 8, 16, ... below n."""
    zero, step = ir.Constant(_INT, 0), ir.Constant(_INT, LANES)
    return cgutils.for_range_slice(builder, zero, n, step, _INT)


def _direction_of(builder: Any, direction: Any, n: int) -> list[Any]:
    """The numbers of a tuple, each in all lanes."""
    return [_in_all(builder, builder.extract_value(direction, k), _DOUBLES) for k in range(n)]


@intrinsic
def _lowest_along(typing, columns, n, direction):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """See `lowest_along`."""
    signature = types.Tuple((types.int64, types.float64))(columns, n, direction)

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        points = _Numbers(context, builder, signature.args[0], arguments[0])
        along = _direction_of(builder, arguments[2], signature.args[2].count)
        lowest = _Lowest(builder)
        with _steps_of(builder, arguments[1]) as (i, _):
            lowest.look_at(points.along(along, i), i)
        return context.make_tuple(builder, signature.return_type, lowest.found())

    return signature, code


@intrinsic
def _nearest_stop(typing, columns, n, direction, slack, rates):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """See `nearest_stop`."""
    signature = types.Tuple((types.int64, types.float64))(columns, n, direction, slack, rates)

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        points = _Numbers(context, builder, signature.args[0], arguments[0])
        room = _Numbers(context, builder, signature.args[3], arguments[3])
        kept = _Numbers(context, builder, signature.args[4], arguments[4])
        along = _direction_of(builder, arguments[2], signature.args[2].count)
        lowest = _Lowest(builder)
        with _steps_of(builder, arguments[1]) as (i, _):
            rate = points.along(along, i)
            kept.store(rate, i)
            comes = builder.fcmp_ordered(">", rate, _constant(_DOUBLES, _SMALLEST_RATE))
            way = builder.fdiv(room.load(0, i), rate)
            lowest.look_at(builder.select(comes, way, _constant(_DOUBLES, np.inf)), i)
        return context.make_tuple(builder, signature.return_type, lowest.found())

    return signature, code


@njit(allocates=False)
def lowest_along(columns, n, direction):  # type: ignore[no-untyped-def]
    """Index and height of the lowest of n points along a direction, the first of equal ones.

    Parameters
    ----------
    columns : (d, N) array
        The points' coordinates.
    n : int
        A multiple of `LANES`, N at most: see `filled`.
    direction : tuple of d floats
    """
    return _lowest_along(columns, n, direction)  # type: ignore[call-arg]


@njit(allocates=False)
def nearest_stop(columns, n, direction, slack, rates):  # type: ignore[no-untyped-def]
    """How far one can go along a direction before the first of n constraints holds.

    Constraint i is used up at the rate of its column times the direction, and has slack[i] left.
    Rates of no more than 1e-11 use up nothing.

    Parameters
    ----------
    columns : (d, N) array
    n : int
        A multiple of `LANES`, N at most.
    direction : tuple of d floats
    slack : (N,) array
    rates : (N,) array, out

    Returns
    -------
    (int, float)
        The constraint, the first of equal ones, and the way to it; (0, inf) where there is none.
    """
    return _nearest_stop(columns, n, direction, slack, rates)  # type: ignore[call-arg]


@njit(allocates=False)
def filled(columns, n):  # type: ignore[no-untyped-def]
    """Repeat the last of n points until their number is a multiple of `LANES`; returns that.

    What is repeated comes after its original, and never is the first of equal ones.
    """
    full = -(-n // LANES) * LANES
    for c in range(columns.shape[0]):
        for i in range(n, full):
            columns[c, i] = columns[c, n - 1]
    return full
