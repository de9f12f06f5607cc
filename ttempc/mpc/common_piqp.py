"""PIQP in the code that all processors with x86-64-v3 share.

PIQP's package has a library for AVX2 and one for AVX-512, and takes the higher that the processor
has. The last bits of their results may differ, and the closed loop lets a last bit grow: the states
of `grass-field` that two processors gave were 4e-8 m apart after 20 s.
"""

import sys
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from typing import Any

from ..jit.target import reaches_common_level

_LEVELS = "piqp.instruction_set"
"""Module of PIQP that says what the processor has; version 0.7 asks it once, when it is loaded."""


def _hide_avx512() -> None:
    """Let PIQP find no AVX-512, unless the program has loaded PIQP before."""
    if "piqp" in sys.modules or not reaches_common_level():
        return
    package = find_spec("piqp")
    if package is None:
        return  # the import below says so
    found = PathFinder.find_spec(_LEVELS, package.submodule_search_locations)
    if found is None or found.loader is None:
        return  # a version with one library for all
    levels: Any = module_from_spec(found)
    found.loader.exec_module(levels)
    levels.avx512f = False
    sys.modules[_LEVELS] = levels


_hide_avx512()

import piqp  # noqa: E402  # what it finds has to be settled before

__all__ = ["piqp"]
