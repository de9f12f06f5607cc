"""Drives of the evidence: straight passes of the farm machine, with sensors as in the field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from proving_ground.testbed.recording.channels import REFERENCE, Channel
from proving_ground.testbed.recording.record import Record
from ttempc.types import FloatArray

from ...results.summary import Summary
from ...results.tracking_errors import START_UP_S, rows_at_same_time
from ...run.simulate import simulate
from ...scenario.scenario import load

FIRST_SEED: Final = 201  # seeds below are those of tuning
FIELD_SENSORS: Final = (
    'sensors.gnss_error="correlated"',
    'sensors.gnss_antenna="corrected"',
    "sensors.imu.on=true",
    "sensors.gnss_latency_s=0.2",
)
FARM: Final = ('plant.vehicle.file="farm4500"', "soil.cone_index_kpa=900.0")  # as in `farm`
LONGEST_M: Final = 190.0  # straight line from the middle of the largest field


def seeds(count: int) -> range:
    """Return the seeds of `count` runs."""
    return range(FIRST_SEED, FIRST_SEED + count)


def gear(speed: float) -> tuple[str, ...]:
    """Return the settings of the gear in which the farm machine drives a speed [m/s].

    The hydrostat ends at 3.1 m/s in the working gear; the transport gear is assumed to reach 5 m/s.
    """
    fast = ("plant.vehicle.speed_gain_mps=5.0", "controller.vehicle.speed_gain_mps=5.0")
    return fast if speed > 3.0 else ()


def straight_pass(
    speed: float,
    seed: int,
    changes: Sequence[str] = (*FARM, *FIELD_SENSORS),
    length_m: float = LONGEST_M,
) -> tuple[Summary, Record]:
    """Drive a straight line on `grass` with changes, and return its numbers.

    Args:
        speed: along the line [m/s].
        seed: of the run.
        changes: overrides of the scenario; by default the farm machine with field sensors.
        length_m: of the line, which goes east from the middle of the field.
    """
    path = f'path={{kind="straight",length_m={length_m},speed_mps={speed}}}'
    field = ("terrain.size_x_m=400.0", "terrain.size_y_m=20.0")
    return simulate(*load("grass", (path, *field, *gear(speed), *changes)), seed)


def cross_error(record: Record, channel: Channel, behind_m: float | None = None) -> FloatArray:
    """Return cross-track errors after the start-up on a straight line to the east, (n,) [m].

    Args:
        record: of `straight_pass`.
        channel: `STATE` for true positions, `ESTIMATE` for those that the guidance itself sees.
        behind_m: point this far behind the trailer axle; None: the tractor point.
    """
    _, rows, line = rows_at_same_time(record, channel, REFERENCE)
    counted = record[channel].time_s[rows] >= START_UP_S
    if behind_m is None:
        offset = record[channel]["y_t_m"][rows] - record[REFERENCE]["y_t_m"][line]
    else:
        offset = record[channel]["y_i_m"][rows] - record[REFERENCE]["y_i_m"][line]
        offset = offset - behind_m * np.sin(record[channel]["psi_i_rad"][rows])
    return offset[counted]


