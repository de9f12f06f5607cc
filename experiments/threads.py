"""Threads of the numerical libraries: one a process.

The matrices of a run are small. A library that shares their products among threads gains little on
an idle machine; on a busy one its threads wait for each other actively and take many times longer.
"""

import os
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

ONE_THREAD: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )
)
"""Environment of a process whose numerical libraries have one thread."""


def use_one_thread() -> None:
    """Limit this process and its children, unless the user has set a number; before numpy loads."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
