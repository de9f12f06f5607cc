"""Options of the testbed's kernels, see `ttempc.jit.cached_njit`."""

from typing import Any, Final

KERNEL: Final[dict[str, Any]] = {
    "error_model": "numpy",  # a division by zero gives an infinite number
    "boundscheck": False,
    "_nrt": False,  # no reference counts: kernels allocate nothing, a fifth of a step less
}

INLINED: Final[dict[str, Any]] = {**KERNEL, "inline": "always"}
"""The same for a part of another kernel, which has no call of its own."""
