"""Processor that kernels are compiled for.

On a 64-bit Intel or AMD processor with AVX2 and FMA it is the common level x86-64-v3, whatever more
the processor has: kernels that one machine compiled run on another one, with the same bits.
Elsewhere numba compiles for the machine that it finds.
"""

import os
import platform
from typing import Any, Final

from llvmlite import binding
from numba import config

COMMON_LEVEL: Final = "x86-64-v3"

_NEEDED: Final = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
"""What x86-64-v3 has beyond x86-64-v2 (System V psABI for x86-64, table of micro-architecture
levels), in LLVM's words."""

_config: Any = config  # a module that makes its names when it is loaded


def choose() -> None:
    """Let numba compile for the common level, unless the user has chosen a processor.

    A program that compiled kernels of its own before has chosen as well: numba asks once.
    """
    if "NUMBA_CPU_NAME" in os.environ or not reaches_common_level():
        return
    _config.CPU_NAME = COMMON_LEVEL
    _config.CPU_FEATURES = ""


def reaches_common_level() -> bool:
    """Return whether this is a processor with all that the common level asks for."""
    if platform.machine().lower() not in {"x86_64", "amd64"}:
        return False
    found = binding.get_host_cpu_features()
    return all(found.get(feature, False) for feature in _NEEDED)
