"""Vector instructions on rows of `WIDTH` numbers, for the kernels of the filter.

A loop over a row of 22 entries ends in one number at a time, and every loop that the compiler turns
into vectors first asks whether its arrays overlap. These functions are a few instructions each.
Arrays are contiguous, of any shape; a row is where it begins in the flat array. Nothing is checked.
"""

from typing import Any, Final

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

WIDTH: Final = 24
"""Entries of a row of 22, with its padding: three vectors of eight numbers."""

_VECTOR: Final = ir.VectorType(ir.DoubleType(), WIDTH)
_LANES: Final = ir.VectorType(ir.IntType(32), WIDTH)


class _Rows:
    """Builder of loads, stores and products of whole rows."""

    def __init__(self, context: Any, builder: Any, signature: Any) -> None:  # noqa: ANN401
        self.context, self.builder, self.types = context, builder, signature.args

    def pointer(self, arguments: Any, n: int) -> Any:  # noqa: ANN401 - of llvmlite
        """Return the pointer to the row that begins at argument n + 1 in the array n."""
        array = self.context.make_array(self.types[n])(self.context, self.builder, arguments[n])
        begin = self.builder.gep(array.data, [arguments[n + 1]])
        return self.builder.bitcast(begin, _VECTOR.as_pointer())

    def load(self, pointer: Any) -> Any:  # noqa: ANN401
        row = self.builder.load(pointer)
        row.align = 8
        return row

    def times(self, weight: Any, row: Any) -> Any:  # noqa: ANN401
        undefined = ir.Constant(_VECTOR, ir.Undefined)
        one = self.builder.insert_element(undefined, weight, ir.IntType(32)(0))
        zeros = ir.Constant(_LANES, [0] * WIDTH)
        return self.builder.fmul(self.builder.shuffle_vector(one, undefined, zeros), row)

    def store(self, row: Any, pointer: Any) -> Any:  # noqa: ANN401
        self.builder.store(row, pointer).align = 8
        return self.context.get_dummy_value()


@intrinsic
def clear_row(_, target, to):  # noqa: ANN001, ANN201
    """Write zeros into the row at `to` of `target`."""

    def generate(context, builder, signature, arguments):  # noqa: ANN001, ANN202
        rows = _Rows(context, builder, signature)
        return rows.store(ir.Constant(_VECTOR, [0.0] * WIDTH), rows.pointer(arguments, 0))

    return types.void(target, types.intp), generate


@intrinsic
def scale_row(_, target, to, weight, source, at):  # noqa: ANN001, ANN201
    """Multiply the row at `to` of `target` by `weight` times the row at `at` of `source`."""

    def generate(context, builder, signature, arguments):  # noqa: ANN001, ANN202
        rows = _Rows(context, builder, signature)
        pointer = rows.pointer(arguments, 0)
        row = rows.times(arguments[2], rows.load(rows.pointer(arguments, 3)))
        return rows.store(builder.fmul(rows.load(pointer), row), pointer)

    real, index = types.float64, types.intp
    return types.void(target, index, real, source, index), generate


@intrinsic
def set_row(_, target, to, weight, source, at):  # noqa: ANN001, ANN201
    """Write `weight` times the row at `at` of `source` into the row at `to` of `target`."""

    def generate(context, builder, signature, arguments):  # noqa: ANN001, ANN202
        rows = _Rows(context, builder, signature)
        row = rows.load(rows.pointer(arguments, 3))
        return rows.store(rows.times(arguments[2], row), rows.pointer(arguments, 0))

    real, index = types.float64, types.intp
    return types.void(target, index, real, source, index), generate


@intrinsic
def add_row(_, target, to, weight, source, at):  # noqa: ANN001, ANN201
    """Add `weight` times the row at `at` of `source` to the row at `to` of `target`."""

    def generate(context, builder, signature, arguments):  # noqa: ANN001, ANN202
        rows = _Rows(context, builder, signature)
        pointer = rows.pointer(arguments, 0)
        row = rows.times(arguments[2], rows.load(rows.pointer(arguments, 3)))
        return rows.store(builder.fadd(rows.load(pointer), row), pointer)

    real, index = types.float64, types.intp
    return types.void(target, index, real, source, index), generate


@intrinsic
def add_rows(_, target, to, weight, source, at, other, row, begin):  # noqa: ANN001, ANN201
    """Add `weight` times one row and `other` times another, their sum first: it is symmetric."""

    def generate(context, builder, signature, arguments):  # noqa: ANN001, ANN202
        rows = _Rows(context, builder, signature)
        pointer = rows.pointer(arguments, 0)
        one = rows.times(arguments[2], rows.load(rows.pointer(arguments, 3)))
        two = rows.times(arguments[5], rows.load(rows.pointer(arguments, 6)))
        total = builder.fadd(rows.load(pointer), builder.fadd(one, two))
        return rows.store(total, pointer)

    real, index = types.float64, types.intp
    return types.void(target, index, real, source, index, real, row, index), generate
