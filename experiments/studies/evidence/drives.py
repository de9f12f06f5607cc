"""Drives of the evidence: straight passes of the farm machine, with sensors as in the field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

from ttempc.types import FloatArray

from ....testbed.recording.channels import ESTIMATE, REFERENCE
from ....testbed.recording.record import Record
from ...results.summary import Summary
from ...results.tracking_errors import START_UP_S, rows_at_same_time, tracking_errors
from ...run.assembly import EDGE_M
from ...run.simulate import simulate
from ...scenario.scenario import load

FIRST_SEED: Final = 201  # smaller ones are for tuning
FIELD_SENSORS: Final = ('sensors.preset="field"',)
FARM: Final = ('plant.vehicle.file="farm4500"', "soil.cone_index_kpa=900.0")  # as in `farm`
# As wide as the machine, at a usual depth.
FARM_TOOL: Final = (*FARM, 'implement={type="field-cultivator",width_m=2.0,depth_m=0.10}')
CULTIVATOR: Final = "farm machine with a field cultivator of 2.0 m x 10 cm on its trailer"
LONGEST_M: Final = 190.0  # straight line from the middle of the largest field

Point = Literal["tractor", "trailer", "tool"]


def seeds(count: int) -> range:
    """Return the seeds of `count` runs."""
    return range(FIRST_SEED, FIRST_SEED + count)


def seed_text(count: int) -> str:
    """Return the seeds of `count` runs as text.

    >>> seed_text(3)
    'seeds 201-203'
    """
    return f"seeds {FIRST_SEED}-{FIRST_SEED + count - 1}" if count > 1 else f"seed {FIRST_SEED}"


def gear(speed: float) -> tuple[str, ...]:
    """Return the settings of the gear in which the farm machine drives a speed [m/s].

    The hydrostat ends at 3.1 m/s in the working gear; the transport gear is assumed to reach 5 m/s.
    """
    fast = ("plant.vehicle.speed_gain_mps=5.0", "controller.vehicle.speed_gain_mps=5.0")
    return fast if speed > 3.0 else ()


def straight_pass(
    speed: float, seed: int, changes: Sequence[str], length_m: float = LONGEST_M
) -> tuple[Summary, Record]:
    """Drive a straight line on `grass` with changes, and return its numbers.

    Args:
        speed: along the line [m/s].
        seed: of the run.
        changes: overrides of the scenario.
        length_m: of the line, which goes east from the middle of the field.
    """
    path = f'path={{kind="straight",length_m={length_m},speed_mps={speed}}}'
    field = (f"terrain.size_x_m={2.0 * (length_m + EDGE_M)}", "terrain.size_y_m=20.0")
    return simulate(*load("grass", (path, *field, *gear(speed), *changes)), seed)


def cross_error(record: Record, point: Point) -> FloatArray:
    """Return the true cross-track errors of a point after the start-up, (n,) [m]."""
    errors = tracking_errors(record)
    return errors.by_point[point].cross_m[errors.time_s >= START_UP_S]


def seen_cross_error(record: Record) -> FloatArray:
    """Return the trailer's cross-track errors by the estimate, on a line to the east, (n,) [m]."""
    time_s, rows, line = rows_at_same_time(record, ESTIMATE, REFERENCE)
    offset = record[ESTIMATE]["y_i_m"][rows] - record[REFERENCE]["y_i_m"][line]
    return offset[time_s >= START_UP_S]
