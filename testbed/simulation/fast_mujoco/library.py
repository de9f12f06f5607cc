"""Functions and variables of MuJoCo's library by their symbols."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import ctypes
import os
from pathlib import Path
from typing import Final, NamedTuple, Self

import llvmlite.binding
import mujoco
import numpy as np
from numba import types
from numpy.typing import NDArray

from ttempc.jit import IS_PLAIN

PLAIN: Final = "TTEMPC_PLAIN"
"""Variable of the environment that switches to plain steps, any text but "" and "0"."""

for _pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
    for _library in Path(mujoco.__file__).parent.glob(_pattern):
        # loaded already by `mujoco`: this makes its symbols known to numba
        llvmlite.binding.load_library_permanently(str(_library))

_OF_MODEL_AND_DATA: Final = types.void(types.intp, types.intp)
_BIAS: Final = types.void(types.intp, types.intp, types.intc, types.intp)
_SOLUTION: Final = types.void(types.intp, types.intp, types.intp, types.intp, types.intc)

mj_step1: Final = types.ExternalFunction("mj_step1", _OF_MODEL_AND_DATA)
mj_kinematics: Final = types.ExternalFunction("mj_kinematics", _OF_MODEL_AND_DATA)
mj_com_pos: Final = types.ExternalFunction("mj_comPos", _OF_MODEL_AND_DATA)
mj_make_m: Final = types.ExternalFunction("mj_makeM", _OF_MODEL_AND_DATA)
mj_com_vel: Final = types.ExternalFunction("mj_comVel", _OF_MODEL_AND_DATA)
mj_rne: Final = types.ExternalFunction("mj_rne", _BIAS)
mj_fwd_actuation: Final = types.ExternalFunction("mj_fwdActuation", _OF_MODEL_AND_DATA)
mj_factor_m: Final = types.ExternalFunction("mj_factorM", _OF_MODEL_AND_DATA)
mj_solve_m: Final = types.ExternalFunction("mj_solveM", _SOLUTION)
mj_fwd_constraint: Final = types.ExternalFunction("mj_fwdConstraint", _OF_MODEL_AND_DATA)
mj_euler: Final = types.ExternalFunction("mj_Euler", _OF_MODEL_AND_DATA)

_FUNCTIONS: Final = (
    mj_step1,
    mj_kinematics,
    mj_com_pos,
    mj_make_m,
    mj_com_vel,
    mj_rne,
    mj_fwd_actuation,
    mj_factor_m,
    mj_solve_m,
    mj_fwd_constraint,
    mj_euler,
)
_CLOCK: Final = "mjcb_time"
_OPTIONS: Final = (  # of `mjOption` after its numbers
    "integrator",
    "cone",
    "jacobian",
    "solver",
    "iterations",
    "ls_iterations",
    "noslip_iterations",
    "ccd_iterations",
    "disableflags",
    "enableflags",
)


def switched_off() -> bool:
    """Return whether plain steps are asked for."""
    return IS_PLAIN or os.environ.get(PLAIN, "") not in ("", "0")


def missing_symbols() -> list[str]:
    """Return the names that this release of MuJoCo does not have."""
    names = [*(function.symbol for function in _FUNCTIONS), _CLOCK]
    return [name for name in names if not llvmlite.binding.address_of_symbol(name)]


class Clock(NamedTuple):
    """MuJoCo's variable with the address of the clock that it reads 20 times a step.

    The bindings for Python set it. With 0 in its place a step takes 6 % less, and `mjData.timer`,
    which nobody reads, stays as it is.
    """

    variable: NDArray[np.intp]  # (1,)
    address: int  # of the clock that the bindings set

    @classmethod
    def of_library(cls) -> Self:
        """Return the variable."""
        return cls(_clock_variable(), _CLOCK_ADDRESS)


def _clock_variable() -> NDArray[np.intp]:
    place = llvmlite.binding.address_of_symbol(_CLOCK)
    return np.ctypeslib.as_array((ctypes.c_ssize_t * 1).from_address(place))


_CLOCK_ADDRESS: Final = 0 if missing_symbols() else int(_clock_variable()[0])


def disable_flags(model: mujoco.MjModel) -> NDArray[np.int32] | None:
    """Return a view of `model.opt.disableflags`, (1,), which the bindings copy.

    It lies in MuJoCo's `mjOption` after the numbers up to `o_friction`. None where a release has
    another order.
    """
    option = model.opt
    address = option.o_friction.ctypes.data + option.o_friction.nbytes
    found = np.ctypeslib.as_array((ctypes.c_int * len(_OPTIONS)).from_address(address))
    if found.tolist() != [getattr(option, name) for name in _OPTIONS]:
        return None
    place = _OPTIONS.index("disableflags")
    return found[place : place + 1]
