"""A tick of all built-in detectors, one compiled call; what they remember, one flat record."""

import math
from typing import Final

import numpy as np

from ..jit import record
from ..layout import ESTIMATE
from ..sensors import SensorIndex
from ..types import FloatArray
from .board import BOARD, Record, TickData, has_alarm, latch_alarms, new_board
from .clock import CLOCK, observe_clock
from .drift import DRIFT, new_drift, observe_drift
from .exclusion import exclude_sensors
from .gyro import GYRO, new_gyro, observe_gyro
from .history import kernel
from .hitch import HITCH, observe_hitch
from .innovations import INNOVATIONS, observe_innovations
from .many import MANY, observe_many
from .motion import (
    HYDROSTAT,
    SPEED_SUMS,
    hold_motion,
    observe_hydrostat,
    observe_motion,
    observe_wheels,
)
from .position import (
    LAST_ESTIMATE,
    POSITION,
    average_roughness,
    new_last_estimate,
    new_position,
    observe_position,
    observe_protection,
    remember_estimate,
)
from .readings import READINGS, new_readings, observe_readings
from .receiver import RECEIVER, observe_receiver
from .speeds import SPEEDS, latest_plan, measure_speeds, new_speeds
from .standstill import STANDSTILL, check_standstill, new_standstill
from .steering import observe_standstill, observe_steering
from .steps import STEPS, observe_steps
from .table import DetectorIndex
from .valve import VALVE, compare_valve, new_valve
from .velocity import VELOCITY, confirms, new_velocity, observe_velocity

# The first detectors are those of the readings of a sensor each.
_SENSORS_WITH_READINGS: Final = int(DetectorIndex.STEERING_FRONT)

DETECTORS: Final = np.dtype(
    [
        ("board", BOARD),
        ("readings", READINGS, _SENSORS_WITH_READINGS),  # of each sensor by `SensorIndex`
        ("speeds", SPEEDS),
        ("motion", SPEED_SUMS),
        ("wheels", SPEED_SUMS),
        ("hydrostat", HYDROSTAT),
        ("last", LAST_ESTIMATE),
        ("hitch", HITCH),
        ("position", POSITION),
        ("drift", DRIFT),
        ("standstill", STANDSTILL),
        ("velocity", VELOCITY),
        ("steps", STEPS),
        ("gyros", GYRO, 2),  # of tractor and trailer
        ("clocks", CLOCK, _SENSORS_WITH_READINGS),  # of each sensor by `SensorIndex`
        ("many", MANY),
        ("receivers", RECEIVER, 2),  # of tractor and trailer
        ("valves", VALVE, 2),  # of front steering and trailer steering
        ("innovations", INNOVATIONS, 4),  # GNSS of tractor and trailer, hitch, encoder
    ]
)
"""What the built-in detectors remember; flat, an array of `DETECTORS.itemsize // 8` numbers."""


def new_detectors(velocity_wander_mps: float) -> FloatArray:
    """Return the record `DETECTORS` before the first tick, flat.

    `velocity_wander_mps` is as in `new_velocity`.
    """
    flat = np.zeros(DETECTORS.itemsize // 8)
    detectors = flat.view(DETECTORS)[0]
    detectors["board"] = new_board().view(BOARD)[0]
    detectors["readings"] = new_readings().view(READINGS)[0]
    detectors["speeds"] = new_speeds().view(SPEEDS)[0]
    detectors["last"] = new_last_estimate().view(LAST_ESTIMATE)[0]
    detectors["position"] = new_position().view(POSITION)[0]
    detectors["drift"] = new_drift().view(DRIFT)[0]
    detectors["standstill"] = new_standstill().view(STANDSTILL)[0]
    detectors["velocity"] = new_velocity(velocity_wander_mps).view(VELOCITY)[0]
    detectors["gyros"] = new_gyro().view(GYRO)[0]
    detectors["clocks"]["time_s"] = math.nan
    detectors["valves"] = new_valve().view(VALVE)[0]
    return flat


@kernel
def observe_detectors(
    parameters: FloatArray,
    state: FloatArray,
    rows: FloatArray,
    now: float,
    command: FloatArray,
    estimate: FloatArray,
    innovations: FloatArray,
) -> None:
    """Advance all built-in detectors by a tick, in place.

    Samples come first: their readings decide which of them the others see. Every detector reads the
    alarms of the tick before; the new ones begin and end at the end.

    Args:
        parameters: of the vehicle, see `VehicleParameter`.
        state: record `DETECTORS`; changes.
        rows: samples (n, `SAMPLE`) that arrived since the tick before, in the order of arrival.
        now: time of the tick [s].
        command: of the period before (3,), NaN where there was none.
        estimate: record `ESTIMATE` of this tick.
        innovations: of the samples of this tick (n, `INNOVATION`).
    """
    s = record(state, DETECTORS)
    board = s.board
    span_s = now - s.last.time_s
    seen = record(estimate, ESTIMATE)
    data = TickData(now, span_s, parameters, rows, command, seen, innovations)

    board.excluded[:] = 0.0
    for sensor in range(_SENSORS_WITH_READINGS):
        if board.enabled[sensor]:
            observe_readings(s.readings[sensor], board, data, sensor)
    _observe_receivers(s, data)
    _observe_speeds(s, data)
    _observe_estimate(s, data)
    _observe_valves(s, data)
    _observe_innovations(s, data)

    hold_motion(board)
    latch_alarms(board)
    exclude_sensors(board, s.position, s.last, _is_confirmed(s), now)


@kernel
def _is_confirmed(s: Record) -> bool:
    """Return whether velocities of GNSS confirm its positions."""
    return confirms(s.velocity) and not has_alarm(s.board, DetectorIndex.VELOCITY)


@kernel
def _observe_receivers(s: Record, data: TickData) -> None:
    """Run the detectors of what receivers say: of themselves, and of their velocity."""
    board = s.board
    for body in range(2):
        if board.enabled[DetectorIndex.RECEIVER_TRACTOR + body]:
            observe_receiver(s.receivers[body], board, data, body)
        if board.enabled[DetectorIndex.GYRO_TRACTOR + body]:
            observe_gyro(s.gyros[body], board, data, body)
    board.statistic[DetectorIndex.CLOCK] = 0.0
    for sensor in range(_SENSORS_WITH_READINGS):
        if board.enabled[DetectorIndex.CLOCK]:
            observe_clock(s.clocks[sensor], board, data, sensor)
    if board.enabled[DetectorIndex.VELOCITY]:
        observe_velocity(s.velocity, board, data, s.clocks, s.speeds.position_sd)


@kernel
def _observe_speeds(s: Record, data: TickData) -> None:
    """Run the detectors of motion, wheels and hydrostat."""
    board = s.board
    measure_speeds(s.speeds, s.standstill, board, data)
    if board.enabled[DetectorIndex.MOTION]:
        observe_motion(s.motion, s.speeds, board)
    if board.enabled[DetectorIndex.WHEELS]:
        observe_wheels(s.wheels, s.speeds, board)
    if board.enabled[DetectorIndex.HYDROSTAT]:
        observe_hydrostat(s.hydrostat, s.speeds, board)


@kernel
def _observe_estimate(s: Record, data: TickData) -> None:
    """Run the detectors that compare the estimate with what a vehicle can do."""
    board = s.board
    average_roughness(s.last, board, data)
    if board.enabled[DetectorIndex.HITCH]:
        observe_hitch(s.hitch, board, data, s.gyros)
    if board.enabled[DetectorIndex.POSITION]:
        observe_position(s.position, s.last, s.motion, s.wheels, board, data)
    if board.enabled[DetectorIndex.PROTECTION]:
        observe_protection(s.position, s.last, board, data)
    if board.enabled[DetectorIndex.DRIFT]:
        observe_drift(s.drift, s.velocity, board, data, _is_confirmed(s))
    if board.enabled[DetectorIndex.STEPS]:
        observe_steps(
            s.steps,
            s.drift,
            s.velocity,
            board,
            data,
            s.last.roughness,
            s.speeds.position_sd,
            s.many.count,
        )
    if board.enabled[DetectorIndex.AT_REST]:
        planned_mps = latest_plan(s.speeds)
        check_standstill(s.standstill, board, data, s.speeds.position_sd, planned_mps)
    remember_estimate(s.last, data)


@kernel
def _observe_valves(s: Record, data: TickData) -> None:
    """Run both detectors of each steering valve."""
    board = s.board
    for axis in range(2):
        valve = s.valves[axis]
        follows = board.enabled[DetectorIndex.STEERING_FRONT + axis]
        stands_still = board.enabled[DetectorIndex.STANDSTILL_FRONT + axis]
        if follows or stands_still:
            compare_valve(valve, board, data, axis)
        if follows:
            observe_steering(valve, board, axis)
        if stands_still:
            observe_standstill(valve, board, axis)


@kernel
def _observe_innovations(s: Record, data: TickData) -> None:
    """Run the detectors of the innovations of four sensors."""
    _of_sensor(s, data, DetectorIndex.INNOVATIONS_GNSS_TRACTOR, SensorIndex.GNSS_TRACTOR)
    _of_sensor(s, data, DetectorIndex.INNOVATIONS_GNSS_TRAILER, SensorIndex.GNSS_TRAILER)
    _of_sensor(s, data, DetectorIndex.INNOVATIONS_HITCH, SensorIndex.HITCH)
    _of_sensor(s, data, DetectorIndex.INNOVATIONS_ENCODER, SensorIndex.ENCODER)
    if s.board.enabled[DetectorIndex.MANY]:
        observe_many(s.many, s.board, data)


@kernel
def _of_sensor(s: Record, data: TickData, index: int, sensor: int) -> None:
    """Run the detector of the innovations of a sensor."""
    if s.board.enabled[index]:
        memory = s.innovations[index - DetectorIndex.INNOVATIONS_GNSS_TRACTOR]
        observe_innovations(memory, s.board, data, index, sensor)
