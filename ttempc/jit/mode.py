"""Mode of the kernels in this process: compiled, or plain Python."""

from typing import Any, Final

from numba import config

_config: Any = config  # a module that makes its names when it is loaded

IS_PLAIN: Final = bool(_config.DISABLE_JIT)
"""Whether kernels are Python functions, under `NUMBA_DISABLE_JIT=1`."""
