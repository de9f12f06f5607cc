"""Errors of two RTK receivers of one vehicle, fitted to public records of real ones.

An error is the sum of parts, each with independent axes of the map:

* white noise;
* a second-order Gauss-Markov process (Gelb 1974) whose course is not time but
  u = dt / T + ds / L: multipath changes with the distance travelled, and slowly at rest. Its
  autocorrelation is (1 + u) exp(-u). One such process is shared by both antennas, for they
  have base, satellites and atmosphere in common; another is each antenna's own;
* in a float solution a first-order process that starts small when the fix is lost, and in a
  wrong fix a constant offset.

Fix and float are a Markov chain with rates a + b v. A wrong fix says that it is fixed.

`receivers.toml` has the figures with their records; `experiments/papers/receivers.py` makes it and
says what the records cannot tell. Not from a record: the shared part has half the correlated
variance under an open sky, as a double difference has half of its noise from the base, and no more
elsewhere, where trees and walls around each antenna are its own.
"""

import functools
import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np

from ttempc.jit import cached_njit, record
from ttempc.layout import FLOAT
from ttempc.types import FloatArray

from ..configuration.config_io import read_toml
from ..errors import TestbedError

Place = Literal["open-sky", "wood", "street"]
PLACES: Final[tuple[Place, ...]] = get_args(Place)

TABLE: Final = Path(__file__).with_name("receivers.toml")
# Kinds of a solution other than `FLOAT`, in the numbers of RTKLIB. A receiver says of a wrong fix
# that it is fixed.
FIXED: Final = 1.0
WRONG: Final = 3.0
SHARED_VARIANCE: Final = 0.5  # of the correlated part under an open sky; assumed
_LONG: Final = 50.0  # u by which a process has forgotten its past


@dataclass(frozen=True, slots=True)
class Receiver:
    """Parameters of both receivers; deviations are those of an axis [m]."""

    white_sd: float  # of the white part
    shared_sd: float  # of the process that both antennas share
    own_sd: float  # of an antenna's own process
    time: float  # T [s]
    length: float  # L [m]
    lost_per_s: float  # rate from fix to float in time
    lost_per_m: float  # rate from fix to float in distance
    found_per_s: float  # rate from float to fix in time
    found_per_m: float  # rate from float to fix in distance
    wrong_share: float  # of the fixes that are found
    wrong_sd: float  # of the offset of a wrong fix
    float_first_sd: float  # of a float solution's offset as the fix is lost
    float_sd: float  # of that offset long after
    float_length: float  # [m] over which the offset grows from one to the other

    @property
    def sd(self) -> float:
        """Deviation of the whole error of a correct fix."""
        return math.hypot(self.white_sd, self.shared_sd, self.own_sd)


RECEIVER: Final = np.dtype([(field.name, "f8") for field in fields(Receiver)])
"""Record of the fields of a `Receiver`."""


@functools.cache
def receiver(place: Place) -> Receiver:
    """Return the receivers of a vehicle under an open sky, at the edge of a wood, in a street."""
    table = read_toml(TABLE, TestbedError)
    own = table[place]
    white = own["white_sd_m"]
    correlated = own["sd_m"] ** 2 - white**2
    sky = table["open-sky"]
    shared = SHARED_VARIANCE * (sky["sd_m"] ** 2 - sky["white_sd_m"] ** 2)
    unused = 1.0  # of a float solution, where no fix is lost
    return Receiver(
        white_sd=white,
        shared_sd=math.sqrt(shared),
        own_sd=math.sqrt(correlated - shared),
        time=table["rest"]["correlation_time_s"],
        length=table["motion"]["correlation_length_m"],
        lost_per_s=own["lost_per_s"],
        lost_per_m=own["lost_per_m"],
        found_per_s=own["found_per_s"],
        found_per_m=own["found_per_m"],
        wrong_share=own["wrong_share"],
        wrong_sd=own["wrong_sd_m"],
        float_first_sd=own.get("float_first_sd_m", unused),
        float_sd=own.get("float_sd_m", unused),
        float_length=own.get("float_length_m", unused),
    )


STATE: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("process", "f8", (3, 2, 2)),  # shared, tractor, trailer; axis; value, rate in u; unit sd
        ("offset", "f8", (2, 2)),  # [m] of a float solution or a wrong fix: antenna, axis
        ("solution", "f8", 2),  # kind of each antenna's: `FIXED`, `FLOAT` or `WRONG`
    ]
)
"""State of both receivers, as a flat array; a copy of it goes on with the same errors."""

DRAWS: Final = np.dtype(
    [
        ("process", "f8", (3, 2, 2)),  # of the noises of each process, as in `STATE`
        ("white", "f8", (2, 2)),  # of the white parts: antenna, axis
        ("offset", "f8", (2, 2)),  # of changes of the offsets: antenna, axis
        ("solution", "f8", (2, 2)),  # antenna; whether it changes, whether the new fix is wrong
    ]
)
"""Standard normal numbers of an epoch, as a flat array."""

NORMALS: Final = DRAWS.itemsize // 8

EPOCH: Final = np.dtype(
    [
        ("error", "f8", (2, 2)),  # [m] antenna, axis
        ("status", "f8", 2),  # what each receiver says: `FIXED` or `FLOAT`
    ]
)
"""What both receivers give at an epoch, as a flat array."""

EPOCH_SIZE: Final = EPOCH.itemsize // 8


def new_state() -> FloatArray:
    """Return the `STATE` before the first epoch, flat: both receivers have a fix."""
    state = np.zeros(STATE.itemsize // 8)
    view = state.view(STATE)[0]
    view["time_s"] = -math.inf
    view["solution"] = FIXED
    return state


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def advance(
    state: FloatArray,
    parameters: FloatArray,
    normals: FloatArray,
    time_s: float,
    travelled: float,
    out: FloatArray,
) -> None:
    """Advance both receivers to an epoch.

    Args:
        state: flat record `STATE`, changed.
        parameters: flat record `RECEIVER`.
        normals: flat record `DRAWS`.
        time_s: of the epoch.
        travelled: since the epoch before [m], forward and back.
        out: flat record `EPOCH`, written.
    """
    s = record(state, STATE)
    p = record(parameters, RECEIVER)
    draws = record(normals, DRAWS)
    epoch = record(out, EPOCH)
    later_s = min(time_s - s.time_s, 1e6)
    s.time_s = time_s
    _advance_processes(state, normals, later_s / p.time + travelled / p.length)
    _change_solutions(state, parameters, normals, later_s, travelled)
    for antenna in range(2):
        for axis in range(2):
            epoch.error[antenna, axis] = (
                p.shared_sd * s.process[0, axis, 0]
                + p.own_sd * s.process[1 + antenna, axis, 0]
                + p.white_sd * draws.white[antenna, axis]
                + s.offset[antenna, axis]
            )
        epoch.status[antenna] = FLOAT if s.solution[antenna] == FLOAT else FIXED


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def _advance_processes(state: FloatArray, normals: FloatArray, u: float) -> None:
    """Advance the correlated processes by u.

    This is the exact step of x'' + 2 x' + x = noise over u, stationary with variances 1 and 1:
    F = e^-u [[1 + u, u], [-u, 1 - u]], covariance of the noise I - F F' = L L'.
    """
    s = record(state, STATE)
    draws = record(normals, DRAWS)
    u = min(u, _LONG)
    e = math.exp(-u)
    f_00 = e * (1.0 + u)
    f_01 = e * u
    f_10 = -e * u
    f_11 = e * (1.0 - u)
    q_00 = max(1.0 - f_00 * f_00 - f_01 * f_01, 0.0)
    q_01 = -(f_00 * f_10 + f_01 * f_11)
    l_00 = math.sqrt(q_00)
    l_10 = q_01 / l_00 if l_00 > 0.0 else 0.0
    l_11 = math.sqrt(max(1.0 - f_10 * f_10 - f_11 * f_11 - l_10 * l_10, 0.0))
    for process in range(3):
        for axis in range(2):
            x = s.process[process, axis, 0]
            rate = s.process[process, axis, 1]
            of_x = draws.process[process, axis, 0]
            of_rate = draws.process[process, axis, 1]
            s.process[process, axis, 0] = f_00 * x + f_01 * rate + l_00 * of_x
            s.process[process, axis, 1] = f_10 * x + f_11 * rate + l_10 * of_x + l_11 * of_rate


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def _change_solutions(
    state: FloatArray,
    parameters: FloatArray,
    normals: FloatArray,
    later_s: float,
    travelled: float,
) -> None:
    """Let each antenna lose or find its fix, and advance the offset of float and wrong solutions.

    A float solution's offset is a first-order process over u, of which the share `stays` remains.
    """
    s = record(state, STATE)
    p = record(parameters, RECEIVER)
    draws = record(normals, DRAWS)
    lost = p.lost_per_s * later_s + p.lost_per_m * travelled
    found = p.found_per_s * later_s + p.found_per_m * travelled
    # Share of the epoch's rates that acts, as the chain may change back
    acts = -math.expm1(-(lost + found)) / (lost + found) if lost + found > 0.0 else 0.0
    stays = math.exp(-min(later_s / p.time + travelled / p.float_length, _LONG))
    for antenna in range(2):
        floats = s.solution[antenna] == FLOAT
        keep = 1.0  # share of the offset that stays
        sd = 0.0  # of what is added to it
        changes = _uniform(draws.solution[antenna, 0])
        wrong = _uniform(draws.solution[antenna, 1])
        if changes < acts * (found if floats else lost):
            keep = 0.0
            if not floats:
                s.solution[antenna] = FLOAT
                sd = p.float_first_sd
            elif wrong < p.wrong_share:
                s.solution[antenna] = WRONG
                sd = p.wrong_sd
            else:
                s.solution[antenna] = FIXED
        elif floats:
            keep = stays
            sd = p.float_sd * math.sqrt(1.0 - stays * stays)
        for axis in range(2):
            added = sd * draws.offset[antenna, axis]
            s.offset[antenna, axis] = keep * s.offset[antenna, axis] + added


@cached_njit(error_model="numpy")
def _uniform(normal: float) -> float:
    """Return the probability erfc(-z / sqrt(2)) / 2 that a normal number is below z."""
    return 0.5 * math.erfc(-math.sqrt(0.5) * normal)
