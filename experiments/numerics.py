"""Numerical libraries of a process: one thread, and the same code on every processor.

The matrices of a run are small. A library that shares their products among threads gains little on
an idle machine; on a busy one its threads wait for each other actively and take many times longer.

Which code a library takes depends on the processor, and the last bits of its sums with it: over a
run that drives apart by millimetres. On 64-bit Intel and AMD processors all libraries are held to
what x86-64-v3 has, as compiled kernels (`ttempc/jit/target.py`) and PIQP are
(`ttempc/mpc/common_piqp.py`).
"""

import os
import platform
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from ..testbed.foreign_files import read_bounded

ONE_THREAD: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )
)
"""Environment of a process whose numerical libraries have one thread."""

COMMON_CODE: Final[Mapping[str, str]] = MappingProxyType(
    {
        "OPENBLAS_CORETYPE": "Haswell",  # the first processors with all of x86-64-v3
        # numpy's code above that level, by the names of numpy 2.4; others are ignored
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    }
)
"""Environment of a process whose numerical libraries take the code for x86-64-v3."""

_PROCESSORS: Final = Path("/proc/cpuinfo")  # of Linux


def settle_numerics() -> None:
    """Settle this process and its children, unless the user has; before numpy loads."""
    settled = {**ONE_THREAD, **(COMMON_CODE if _has_common_level() else {})}
    for name, value in settled.items():
        os.environ.setdefault(name, value)


def _has_common_level() -> bool:
    """Return whether this is known to be a processor with AVX2 and FMA."""
    if platform.machine().lower() not in {"x86_64", "amd64"}:
        return False
    try:
        text = read_bounded(_PROCESSORS).decode(errors="replace")
    except OSError:
        return False
    return {"avx2", "fma"} <= set(text.split())
