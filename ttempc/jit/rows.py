"""Vector instructions on rows of `WIDTH` numbers, for the kernels of the filter.

Every loop that the compiler turns into vectors first asks whether its arrays overlap. These
functions are a few instructions each. Arrays are contiguous, of any shape; a row is where it begins
in the flat array. Nothing is checked.
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from .mode import IS_PLAIN

WIDTH: Final = 24
"""Entries of a row: three vectors of eight numbers."""

_intrinsic: Any = intrinsic  # whose types do not know that numba hands over the first argument
_VECTOR: Final = ir.VectorType(ir.DoubleType(), WIDTH)
_LANES: Final = ir.VectorType(ir.IntType(32), WIDTH)


def _operation(
    combine: Callable[..., Any],
    target: Any,  # noqa: ANN401 - of numba
    *sources: Any,  # noqa: ANN401
) -> tuple[Any, Callable[..., Any]]:
    """Return type and code of a function of a target row and of weighted rows of `sources`.

    `combine` makes the new row of llvmlite's builder, the row before and the weighted rows.
    """

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        def pointer(n: int) -> Any:  # noqa: ANN401 - to the row at n + 1 in the array n
            array = context.make_array(signature.args[n])(context, builder, arguments[n])
            begin = builder.gep(array.data, [arguments[n + 1]])
            return builder.bitcast(begin, _VECTOR.as_pointer())

        def weighted(n: int) -> Any:  # noqa: ANN401 - the row of the array n + 1 by the weight n
            undefined = ir.Constant(_VECTOR, ir.Undefined)
            zeros = ir.Constant(_LANES, [0] * WIDTH)
            one = builder.insert_element(undefined, arguments[n], ir.IntType(32)(0))
            weights = builder.shuffle_vector(one, undefined, zeros)
            return builder.fmul(weights, builder.load(pointer(n + 1), align=8))

        to = pointer(0)
        rows = [weighted(n) for n in range(2, len(arguments), 3)]
        builder.store(combine(builder, builder.load(to, align=8), *rows), to, align=8)
        return context.get_dummy_value()

    of_sources = (item for source in sources for item in (types.float64, source, types.intp))
    return types.void(target, types.intp, *of_sources), code


@_intrinsic
def _clear_row(_, target, to):  # noqa: ANN001, ANN202
    return _operation(lambda *_: ir.Constant(_VECTOR, [0.0] * WIDTH), target)


@_intrinsic
def _set_row(_, target, to, weight, source, at):  # noqa: ANN001, ANN202
    return _operation(lambda builder, before, row: row, target, source)


@_intrinsic
def _add_row(_, target, to, weight, source, at):  # noqa: ANN001, ANN202
    return _operation(lambda builder, before, row: builder.fadd(before, row), target, source)


@_intrinsic
def _scale_row(_, target, to, weight, source, at):  # noqa: ANN001, ANN202
    return _operation(lambda builder, before, row: builder.fmul(before, row), target, source)


@_intrinsic
def _add_rows(_, target, to, weight, source, at, other, row, begin):  # noqa: ANN001, ANN202
    def combine(builder, before, one, two):  # noqa: ANN001, ANN202
        return builder.fadd(before, builder.fadd(one, two))

    return _operation(combine, target, source, row)


def _plain_row(array: NDArray[np.float64], begin: int) -> NDArray[np.float64]:
    return array.reshape(-1)[begin : begin + WIDTH]


def _plain_clear_row(target: NDArray[np.float64], to: int) -> None:
    _plain_row(target, to)[:] = 0.0


def _plain_set_row(
    target: NDArray[np.float64], to: int, weight: float, source: NDArray[np.float64], at: int
) -> None:
    _plain_row(target, to)[:] = weight * _plain_row(source, at)


def _plain_add_row(
    target: NDArray[np.float64], to: int, weight: float, source: NDArray[np.float64], at: int
) -> None:
    _plain_row(target, to)[:] += weight * _plain_row(source, at)


def _plain_scale_row(
    target: NDArray[np.float64], to: int, weight: float, source: NDArray[np.float64], at: int
) -> None:
    _plain_row(target, to)[:] *= weight * _plain_row(source, at)


def _plain_add_rows(
    target: NDArray[np.float64],
    to: int,
    weight: float,
    source: NDArray[np.float64],
    at: int,
    other_weight: float,
    other: NDArray[np.float64],
    begin: int,
) -> None:
    weighted_sum = weight * _plain_row(source, at) + other_weight * _plain_row(other, begin)
    _plain_row(target, to)[:] += weighted_sum


clear_row: Any = _plain_clear_row if IS_PLAIN else _clear_row
"""`clear_row(target, to)`: zeros into the row at `to` of `target`."""

set_row: Any = _plain_set_row if IS_PLAIN else _set_row
"""`set_row(target, to, weight, source, at)`: a weighted row of `source` into one of `target`."""

add_row: Any = _plain_add_row if IS_PLAIN else _add_row
"""`add_row(target, to, weight, source, at)`: a weighted row of `source` is added."""

scale_row: Any = _plain_scale_row if IS_PLAIN else _scale_row
"""`scale_row(target, to, weight, source, at)`: entry by entry times a weighted row of `source`."""

add_rows: Any = _plain_add_rows if IS_PLAIN else _add_rows
"""`add_rows(target, to, weight, source, at, other_weight, other, begin)`: two rows are added.

Their sum is formed first: the result does not depend on their order."""
