"""Safety: limits of a supervisor, codes of what it decides, and its memory."""

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidTuning
from ..types import FloatArray

# Modes of a tick, the mildest first:
DRIVE: Final = 0  # the controller drives, at half speed where there is a reason
ON_PATH: Final = 1  # stop, and the controller steers
HOLD: Final = 2  # the last command is held
STOP: Final = 3  # stop, and hold the steering

# Reasons of a mode or of half speed:
NO_ESTIMATE: Final = 1
NOT_FINITE: Final = 2
LOST: Final = 3  # and the next five: the tractor is far off, beside, turned; the trailer
ALARM_HELD: Final = 9
POSITION_LOST: Final = 10  # GNSS outage: no sample was accepted for too long
UNCERTAIN: Final = 11
CORRIDOR: Final = 12
NO_COMMAND: Final = 13
NOT_STARTED: Final = 14  # there was no finite estimate yet

# How a body is lost, added to `LOST` and three times its number:
FAR: Final = 0
BESIDE: Final = 1
TURNED: Final = 2
WAYS_TO_BE_LOST: Final = 3

# What is wrong with a command of a user's controller:
CUT_NOT_FINITE: Final = 1
CUT_RANGE: Final = 2
CUT_RATE: Final = 3

LAG_M: Final = 1.0
"""Distance behind the reference up to which a corridor slows the vehicle down [m]; assumed."""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Limits at which a supervisor slows down and stops; all assumed.

    How far the vehicle leaves its path in an outage of GNSS is in the row "GNSS out" of the table
    of docs/appendix/faults.md.

    Raises:
        InvalidTuning: a value is not above 0.

    Examples:
        >>> SafetyLimits(gnss_outage_stop_s=6.0).gnss_outage_stop_s
        6.0
    """

    gnss_outage_slow_s: float = 10.4  # without an accepted GNSS sample, or age of the estimate
    gnss_outage_stop_s: float = 12.0
    blind_s: float = 1.0  # without a finite estimate or command: hold the last so long, then stop
    uncertain_slow_m: float = 0.25  # standard deviation of the tractor point
    uncertain_stop_m: float = 0.50
    cross_m: float = 2.0  # cross-track error of either point
    distance_m: float = 4.0  # of either point from its reference
    yaw: float = math.radians(60.0)  # yaw error of either body [rad]
    jump_m: float = 0.3  # change of the error in one period beyond that of the speeds

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not value > 0.0:
                raise InvalidTuning(f"{item.name}: got {value}, must be above 0")


SAFETY: Final = np.dtype([(item.name, "f8") for item in fields(SafetyLimits)])
"""Record of `SafetyLimits`."""

GUARD: Final = np.dtype(
    [
        ("sent", "f8", 3),  # command of the tick before
        ("unanswered_s", "f8"),  # time in which the controller gave no finite command [s]
        ("rates_hold", "f8"),  # 0: a user's first command is free of the rate limits
        ("started", "f8"),  # whether there was a finite estimate
        ("finite_s", "f8"),  # time of the last one, before it of the first tick
        ("gnss_s", "f8"),  # time of the last accepted GNSS sample, NaN: none
        ("body_error", "f8", 7),  # of the tick before, see `BodyError`; NaN: none
        ("lost", "f8"),  # reason of a stop for good
        ("distance_allowance_m", "f8"),  # by which distances may exceed their limits
        ("yaw_allowance", "f8"),  # by which yaw errors may [rad]
        ("overridden", "f8"),  # whether the last command was not the controller's
        ("waiting", "f8"),  # whether the reference waits where it is ahead
        ("stop_alarm", "f8"),  # row of the alarm whose stop is held, -1: none
        ("stop_numbers", "f8", 3),  # numbers of that alarm, for its words
        ("stop_reaction", "f8"),
        ("alarm_s", "f8"),  # time of the last alarm that asked for a stop
        ("restarts", "f8"),
    ]
)
"""Memory of the supervisor from tick to tick."""


class LimitRow(IntEnum):
    """Row of the limits of a command."""

    LOWER = 0
    UPPER = 1
    STEP = 2  # largest change in a period


class SupervisedReference(NamedTuple):
    """Constants of a supervisor along a reference of N ticks."""

    state: FloatArray  # (N, 7) see `State`
    trailer_xy: FloatArray  # (N, 2) [m]
    inputs: FloatArray  # (N, 3)
    beyond: NDArray[np.bool_]  # (N, 3) inputs beyond the limits
    limits: FloatArray  # (3, 3) of each input, see `LimitRow`
    safety: FloatArray  # `SafetyLimits` as a record `SAFETY`
    period_s: float
    speed: float  # largest one of the reference [m/s]
    radius: float  # of the turn by which a vehicle comes back to its path [m]
    gear: float  # 1, in reverse -1
    hold_back: FloatArray  # (3, 2) whole periods and rest [s] of inputs with a shorter dead time
