"""Detector of positions that move while the vehicle stands, whenever it does."""

import math
from typing import Final

import numpy as np

from ..layout import AlarmColumn, SampleColumn
from ..types import FloatArray, State
from .board import Record, TickData
from .history import kernel
from .table import DetectorIndex

STANDSTILL: Final = np.dtype(
    [
        ("since_s", "f8"),  # since when the vehicle stands in this check, NaN: not yet
        ("origin", "f8", (2, 2)),  # first position [m] of each receiver, NaN: none yet
        # Sums over the positions of both receivers, from which a line is fitted; t from the begin
        # of the fit on [s], x and y from the origins [m]
        ("count", "f8"),
        ("sum_t", "f8"),
        ("sum_tt", "f8"),
        ("sum_x", "f8"),
        ("sum_xt", "f8"),
        ("sum_y", "f8"),
        ("sum_yt", "f8"),
        ("before", "f8", (2, 2)),  # latest position of each receiver [m], NaN: none yet
        ("steps", "f8"),  # sum of the squared differences from one to the next [m^2]
        ("moved", "f8"),  # checks in succession in which GNSS moved
    ]
)
"""Memory of the check."""

_SETTLES_S: Final = 1.6  # of a vehicle that comes to rest, before the fit begins; assumed
_LEAST_S: Final = 4.0  # of a check; assumed
_MOST_S: Final = 20.0  # of a check, where the noise is large; assumed
_RESTS_MPS: Final = 0.05  # largest speed of the estimate of a vehicle at rest
_STILL_MPS: Final = 0.012  # largest speed of GNSS at rest; assumed
_SIGMAS: Final = 5.0  # of the white noise in that speed; assumed
_LIVES: Final = 0.2  # least share of the usual noise in that of positions at rest; assumed
_FOUND: Final = 2.0  # statistic of a drift that is confirmed
_CONFIRMED: Final = 2.0  # checks in succession that confirm a drift: a vehicle may creep in one


def new_standstill() -> FloatArray:
    """Return a record `STANDSTILL` of no check, flat."""
    flat = np.zeros(STANDSTILL.itemsize // 8)
    flat.view(STANDSTILL)[0]["since_s"] = math.nan
    return flat


@kernel
def add_position(memory: Record, sample: FloatArray, receiver: int) -> None:
    """Add a position to the sums of the fit, if the vehicle stands in a check."""
    time_s = sample[SampleColumn.TIME_S]
    if not time_s >= memory.since_s + _SETTLES_S:  # it does not where that is NaN
        return
    origin = memory.origin[receiver]
    if math.isnan(origin[0]):
        origin[0] = sample[SampleColumn.FIRST]
        origin[1] = sample[SampleColumn.SECOND]
        memory.before[receiver, 0] = origin[0]
        memory.before[receiver, 1] = origin[1]
    before = memory.before[receiver]
    memory.steps += (sample[SampleColumn.FIRST] - before[0]) ** 2
    memory.steps += (sample[SampleColumn.SECOND] - before[1]) ** 2
    before[0] = sample[SampleColumn.FIRST]
    before[1] = sample[SampleColumn.SECOND]
    t = time_s - memory.since_s - _SETTLES_S
    x = sample[SampleColumn.FIRST] - origin[0]
    y = sample[SampleColumn.SECOND] - origin[1]
    memory.count += 1.0
    memory.sum_t += t
    memory.sum_tt += t**2
    memory.sum_x += x
    memory.sum_xt += x * t
    memory.sum_y += y
    memory.sum_yt += y * t


@kernel
def check_standstill(
    memory: Record, board: Record, data: TickData, position_sd: float, planned_mps: float
) -> None:
    """Watch both receivers for as long as the vehicle stands, for whatever reason it does.

    It does where the estimate is slow and no faster creep is asked of the hydrostat than what
    counts as a drift.

    Both receivers have one velocity w, by least squares. With n positions, sums S over them and the
    standard deviation s of their white noise,

        D = S_tt - S_t^2 / n,   |w| = |(S_xt - S_t S_x / n, S_yt - S_t S_y / n)| / D,

    and w has the standard deviation s / sqrt(D). A fit ends after 4 s if five of these are below
    1.2 cm/s, else after 20 s, and the next one begins. GNSS has moved where |w| is above both;
    twice in succession is an alarm, until `resume`, since a vehicle may creep in the first one.

    There is no verdict where the positions lack their usual noise: a receiver that holds its
    position at rest would pass every check. To pass has no consequence.

    Args:
        memory: record `STANDSTILL`.
        board: record `BOARD`.
        data: of the tick.
        position_sd: of the white noise of the positions [m].
        planned_mps: speed that the commands ask for, without a sign.
    """
    index = DetectorIndex.AT_REST
    if memory.moved >= _CONFIRMED:
        return  # the statistic stays
    rests = abs(data.estimate.state[State.V]) <= _RESTS_MPS and not planned_mps > _STILL_MPS
    if not rests:
        memory.moved = 0.0
    if not rests or math.isnan(memory.since_s):
        _begin(memory, data.now)

    count = max(memory.count, 1.0)
    spread = max(memory.sum_tt - memory.sum_t * memory.sum_t / count, 1e-9)
    drift_mps = (
        math.hypot(
            memory.sum_xt - memory.sum_t * memory.sum_x / count,
            memory.sum_yt - memory.sum_t * memory.sum_y / count,
        )
        / spread
    )
    noise_mps = _SIGMAS * position_sd / math.sqrt(spread)
    least_s = _LEAST_S if noise_mps <= _STILL_MPS else _MOST_S
    if data.now - memory.since_s - _SETTLES_S < least_s:
        return

    # A difference of two positions has twice the variance of one, on each of two axes
    memory.since_s = math.nan
    lives = memory.steps / count >= 4.0 * (_LIVES * position_sd) ** 2
    moved = lives and drift_mps > max(_STILL_MPS, noise_mps)
    memory.moved = memory.moved + 1.0 if moved else 0.0
    board.statistic[index] = _FOUND if memory.moved >= _CONFIRMED else 0.0
    board.residual[index] = drift_mps
    board.proposed[index, AlarmColumn.FIRST] = 100.0 * drift_mps


@kernel
def _begin(memory: Record, now: float) -> None:
    """Begin a check at a time."""
    memory.since_s = now
    memory.origin[:] = math.nan
    memory.count = 0.0
    memory.sum_t = 0.0
    memory.sum_tt = 0.0
    memory.sum_x = 0.0
    memory.sum_xt = 0.0
    memory.sum_y = 0.0
    memory.sum_yt = 0.0
    memory.steps = 0.0
