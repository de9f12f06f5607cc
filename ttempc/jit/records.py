"""Flat arrays of float64 as records with named fields, and small arrays in the frame of a call."""

import math
from typing import Any

import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

from .mode import IS_PLAIN

_intrinsic: Any = intrinsic  # whose types do not know that numba hands over the first argument


class _Fields:
    """A record whose fields are attributes, as in compiled code; it shares the array's memory."""

    __slots__ = ("_record",)

    def __init__(self, record: np.void) -> None:
        object.__setattr__(self, "_record", record)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - a number or an array
        try:
            value = self._record[name]
        except ValueError as error:
            raise AttributeError(str(error)) from None
        return _Fields(value) if isinstance(value, np.void) else value

    def __setattr__(self, name: str, value: Any) -> None:  # noqa: ANN401
        self._record[name] = value

    def __repr__(self) -> str:
        names = self._record.dtype.names or ()
        return f"record({', '.join(f'{name}={self._record[name]}' for name in names)})"


def _plain_record(row: NDArray[np.float64], kind: np.dtype[Any]) -> _Fields:
    flat = row.reshape(-1)[: kind.itemsize // row.itemsize]
    return _Fields(flat.view(kind)[0])


def _plain_local(shape: tuple[int, ...]) -> NDArray[np.float64]:
    return np.full(shape, math.nan)  # a kernel that reads what it did not write shows it


@_intrinsic
def _compiled_record(_, row, kind):  # noqa: ANN001, ANN202
    """Cast a pointer.

    numba's `view` asks at every use whether sizes fit, in code that takes a tenth of a second to
    compile.
    """
    record_type = kind.dtype

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.bitcast(array.data, context.get_value_type(record_type))

    return record_type(row, kind), code


@_intrinsic(prefer_literal=True)
def _compiled_local(_, shape):  # noqa: ANN001, ANN202
    """Reserve the array on the stack: nothing is allocated or counted."""
    array_type = types.Array(types.float64, len(shape), "C")
    sizes = [length.literal_value for length in shape]

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        number = context.get_data_type(types.float64)
        data = cgutils.alloca_once(builder, number, math.prod(sizes))
        array = context.make_array(array_type)(context, builder)
        lengths = [context.get_constant(types.intp, length) for length in sizes]
        strides = [
            context.get_constant(types.intp, 8 * math.prod(sizes[axis + 1 :]))
            for axis in range(len(sizes))
        ]
        item_size = context.get_constant(types.intp, 8)
        populate_array(array, data, lengths, strides, item_size, None)
        return array._getvalue()

    return array_type(shape), code


record: Any = _plain_record if IS_PLAIN else _compiled_record
"""`record(row, kind)`: the flat array `row` as the record `kind`, as `row.view(kind)[0]`.

The record shares the memory of the row. Compiled, nothing is checked."""

local: Any = _plain_local if IS_PLAIN else _compiled_local
"""`local((2, 3))`: an array of float64 of a constant shape in the frame of the call.

Its content is undefined until it is written. It must not be returned."""
