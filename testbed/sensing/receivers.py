"""Errors of two RTK receivers of one vehicle, fitted to public records of real ones.

An error is the sum of parts, each with independent axes of the map:

* white noise;
* a second-order Gauss-Markov process (Gelb 1974) whose course is not time but
  u = dt / T + ds / L: multipath changes with the way travelled, and slowly at rest. Its
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
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np

from ttempc.jit import cached_njit, record
from ttempc.layout import FLOAT
from ttempc.types import FloatArray

Place = Literal["open-sky", "wood", "street"]
PLACES: Final[tuple[Place, ...]] = get_args(Place)

TABLE: Final = Path(__file__).with_name("receivers.toml")
FIXED, WRONG = 1.0, 3.0  # beside `FLOAT`, as RTKLIB says them; a wrong fix says `FIXED`
SHARED_VARIANCE: Final = 0.5  # of the correlated part under an open sky; assumed
_LONG: Final = 50.0  # u by which a process has forgotten its past
NORMALS: Final = 24  # of an epoch: processes, white parts, offsets, changes and kinds of solution


@dataclass(frozen=True, slots=True)
class Receiver:
    """Parameters of both receivers; deviations are those of an axis [m]."""

    white_sd: float
    shared_sd: float  # of the process that both antennas share
    own_sd: float  # of an antenna's own process
    time: float  # T [s]
    length: float  # L [m]
    lost_per_s: float  # rates of fix to float
    lost_per_m: float
    found_per_s: float  # of float to fix
    found_per_m: float
    wrong_share: float  # of the fixes that are found
    wrong_sd: float  # of the offset of a wrong fix
    float_first_sd: float  # of a float solution's offset as the fix is lost
    float_sd: float  # long after
    float_length: float  # [m] to get there

    @property
    def sd(self) -> float:
        """Deviation of the whole error of a correct fix."""
        return math.hypot(self.white_sd, self.shared_sd, self.own_sd)


@functools.cache
def receiver(place: Place) -> Receiver:
    """Return the receivers of a vehicle under an open sky, at the edge of a wood, in a street."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    own, white = table[place], table[place]["white_sd_m"]
    correlated = own["sd_m"] ** 2 - white**2
    sky = table["open-sky"]
    shared = SHARED_VARIANCE * (sky["sd_m"] ** 2 - sky["white_sd_m"] ** 2)
    keys = ("lost_per_s", "lost_per_m", "found_per_s", "found_per_m", "wrong_share", "wrong_sd_m")
    floating = ("float_first_sd_m", "float_sd_m", "float_length_m")
    return Receiver(
        white,
        math.sqrt(shared),
        math.sqrt(correlated - shared),
        table["rest"]["correlation_time_s"],
        table["motion"]["correlation_length_m"],
        *(own[key] for key in keys),
        *(own.get(key, 1.0) for key in floating),  # never used where no fix is lost
    )


STATE: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("process", "f8", (3, 2, 2)),  # shared, tractor, trailer; axis; value, rate in u; unit sd
        ("offset", "f8", (2, 2)),  # [m] of a float solution or a wrong fix: antenna, axis
        ("solution", "f8", 2),
    ]
)
"""State of both receivers, as a flat array; a copy of it goes on with the same errors."""


def new_state() -> FloatArray:
    """Return the `STATE` before the first epoch, flat: both receivers have a fix."""
    state = np.zeros(STATE.itemsize // 8)
    view = state.view(STATE)[0]
    view["time_s"], view["solution"] = -math.inf, FIXED
    return state


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def advance(
    state: FloatArray,
    p: FloatArray,
    normals: FloatArray,
    time_s: float,
    travelled: float,
    out: FloatArray,
) -> None:
    """Advance both receivers to an epoch.

    Args:
        state: flat record `STATE`, changed.
        p: (14,) fields of `Receiver` in their order.
        normals: (24,) standard normal numbers.
        time_s: of the epoch.
        travelled: since the epoch before [m], forward and back.
        out: (6,) x and y [m] of tractor and trailer, then their states; written.
    """
    s = record(state, STATE)
    later = min(time_s - s.time_s, 1e6)
    s.time_s = time_s
    # exact step of x'' + 2 x' + x = noise over u, stationary with variances 1, 1:
    # F = e^-u [[1 + u, u], [-u, 1 - u]], noise I - F F'
    u = min(later / p[3] + travelled / p[4], _LONG)
    e = math.exp(-u)
    f00, f01, f10, f11 = e * (1.0 + u), e * u, -e * u, e * (1.0 - u)
    q00 = max(1.0 - f00 * f00 - f01 * f01, 0.0)
    q01 = -(f00 * f10 + f01 * f11)
    l00 = math.sqrt(q00)
    l10 = q01 / l00 if l00 > 0.0 else 0.0
    l11 = math.sqrt(max(1.0 - f10 * f10 - f11 * f11 - l10 * l10, 0.0))
    k = 0
    for process in range(3):
        for axis in range(2):
            x, rate = s.process[process, axis, 0], s.process[process, axis, 1]
            s.process[process, axis, 0] = f00 * x + f01 * rate + l00 * normals[k]
            s.process[process, axis, 1] = (
                f10 * x + f11 * rate + l10 * normals[k] + l11 * normals[k + 1]
            )
            k += 2
    lost, found = p[5] * later + p[6] * travelled, p[7] * later + p[8] * travelled
    left = -math.expm1(-(lost + found)) / (lost + found) if lost + found > 0.0 else 0.0
    kept = math.exp(-min(later / p[3] + travelled / p[13], _LONG))
    for antenna in range(2):
        floats = s.solution[antenna] == FLOAT
        sd, keep = 0.0, 1.0  # of what is added to the offset, and how much of it is kept
        # that a normal number is below z has the probability erfc(-z / sqrt(2)) / 2
        changes = 0.5 * math.erfc(-math.sqrt(0.5) * normals[20 + 2 * antenna])
        wrong = 0.5 * math.erfc(-math.sqrt(0.5) * normals[21 + 2 * antenna])
        if changes < left * (found if floats else lost):
            keep = 0.0
            if not floats:
                s.solution[antenna], sd = FLOAT, p[11]
            elif wrong < p[9]:
                s.solution[antenna], sd = WRONG, p[10]
            else:
                s.solution[antenna] = FIXED
        elif floats:
            keep, sd = kept, p[12] * math.sqrt(1.0 - kept * kept)
        for axis in range(2):
            i = 2 * antenna + axis
            s.offset[antenna, axis] = keep * s.offset[antenna, axis] + sd * normals[16 + i]
            out[i] = (
                p[1] * s.process[0, axis, 0]
                + p[2] * s.process[1 + antenna, axis, 0]
                + p[0] * normals[12 + i]
                + s.offset[antenna, axis]
            )
        out[4 + antenna] = FLOAT if s.solution[antenna] == FLOAT else FIXED
