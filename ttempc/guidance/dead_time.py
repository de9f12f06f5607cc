"""Compensation of the actuators' dead times around any controller."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from ..estimation.filter.predict import steps_over
from ..estimation.filter.records import SAME_TIME_S
from ..jit import cached_njit, record
from ..layout import ESTIMATE, estimate_row
from ..models.augmented_state import (
    SIZE,
    STATES,
    AugmentedState,
    Step,
    VehicleParameter,
    move_augmented_state,
    vehicle_parameters,
    write_estimate,
)
from ..reference.reference import Reference
from ..types import Command, Controller, Estimate, FloatArray, Resuming, SpaceBased, WarmingUp
from ..vehicle import CommandLimits, Vehicle

_MOST_SLIP: Final = 0.9  # of the wheels, up to which an estimate is predicted


def compensated(
    make: Callable[[Vehicle, Reference], Controller], reference: Reference, period_s: float
) -> Guided:
    """Return the controller that `make` returns, with the dead times of its vehicle compensated.

    `make` gets a vehicle without dead times and the reference ahead by `lead_s` of the vehicle.
    Without a lead the controller is returned as it is made.
    """
    lead = lead_s(reference.vehicle)
    prompt = reference.vehicle.without_dead_times()
    ahead = replace(reference, vehicle=prompt, lead_s=reference.lead_s + lead)
    controller = make(prompt, ahead)
    return DeadTimeCompensation(controller, reference, period_s) if lead else controller


def lead_s(vehicle: Vehicle) -> float:
    """Return the time by which a command is computed ahead [s].

    It is the longer dead time of front steering and hydrostat. Waiting for the trailer's valves
    would cost the tractor more than it gives the trailer.
    """
    return max(vehicle.dead_time_t, vehicle.dead_time_hp)


def resume(controller: Guided, previous: Guided, sent: Sequence[Command]) -> None:
    """Let `controller` continue after `previous`; around either dead times may be compensated.

    `sent` are the last commands, oldest first.
    """
    if isinstance(controller, DeadTimeCompensation):
        for command in sent:
            controller.commands[1:] = controller.commands[:-1].copy()
            controller.commands[0] = command.as_array()
        controller = controller.controller
    if isinstance(previous, DeadTimeCompensation):
        previous = previous.controller
    if isinstance(controller, Resuming):
        controller.resume(previous)


class Lead(NamedTuple):
    """Time by which a command is computed ahead, and by how much longer its inputs take."""

    parameters: FloatArray  # of the vehicle, see `VehicleParameter`
    ahead_s: float  # see `lead_s`
    period_s: float
    whole: int  # periods of the lead
    part_s: float  # the rest of it
    late: FloatArray  # (3, 2) whole periods and rest [s]


class DeadTimeCompensation:
    """What lets a controller for a vehicle without dead times drive one that has them.

    `Supervisor` asks the controller with it, and keeps its `commands`.

    The controller gets the estimate for the time at which its command will act: predicted over
    D = `lead_s` by the model of the filter, with the disturbances of the estimate and the commands
    that are under way (Smith 1959; for estimates by a model Manitius and Olbrot 1979). Actuators
    with a shorter dead time d get their command later by D - d, so that the inputs of a command act
    together; between two ticks it is interpolated. The trailer steering may act later than that. A
    loop around the prediction has the margins of one without dead times; disturbances are corrected
    D later.
    """

    def __init__(self, controller: Controller, reference: Reference, period_s: float) -> None:
        vehicle, ahead_s = reference.vehicle, lead_s(reference.vehicle)
        self.controller = controller
        early = ahead_s - vehicle.dead_times
        # (3, 2) whole periods and rest [s] by which an input is sent later, and acts later
        self.hold_back, late = (
            np.array([_split(time_s, period_s) for time_s in np.maximum(spans, 0.0).tolist()])
            for spans in (early, -early)
        )
        whole, part_s = _split(ahead_s, period_s)
        self._lead = Lead(vehicle_parameters(vehicle), ahead_s, period_s, whole, part_s, late)
        start = CommandLimits.of(vehicle, period_s).clamp(reference.at(0.0).inputs)
        # Commands as they act together, the newest first; before the start those of the reference.
        count = whole + 3 + int(late[:, 0].max())
        self.commands: FloatArray = np.tile(start, (count, 1))
        self.space_based = isinstance(controller, SpaceBased) and controller.space_based

    def warm_up(self) -> None:
        if isinstance(self.controller, WarmingUp):
            self.controller.warm_up()
        state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        self.predicted(estimate_row(Estimate(0.0, state, np.eye(STATES), np.zeros(2), 0.0)))

    def predicted(self, row: FloatArray) -> FloatArray:
        """Return the record `ESTIMATE` for the time at which a command of now acts."""
        result = row.copy()
        predict_to(self._lead, self.commands, result)
        return result


@cached_njit(error_model="numpy", nogil=True)
def predict_to(lead: Lead, commands: FloatArray, estimate: FloatArray) -> None:
    """Advance the record `ESTIMATE` by a lead, but for its covariance.

    `commands` (count, 3) are the newest first.
    """
    e, parameters = record(estimate, ESTIMATE), lead.parameters
    period_s, part_s = lead.period_s, lead.part_s
    x, covariance, kept = np.zeros(SIZE), np.zeros((SIZE, SIZE)), e.covariance.copy()
    for i in range(STATES):
        x[i] = e.state[i]
    slip_t, slip_i = min(e.disturbance[0], _MOST_SLIP), min(e.disturbance[1], _MOST_SLIP)
    bias, drive = min(e.disturbance[2], _MOST_SLIP), min(e.disturbance[3], _MOST_SLIP)
    wheel = min(e.disturbance[4], _MOST_SLIP)
    v, cos, sin = x[6], math.cos(x[2]), math.sin(x[2])
    wheel_speed = v / (1.0 - wheel)
    gear = math.copysign(1.0, wheel_speed)
    gx, gy = gear * e.map_disturbance[0], gear * e.map_disturbance[1]
    cx, cy = gear * e.map_disturbance[2], gear * e.map_disturbance[3]
    yaw_rate = v * math.tan(x[4] + bias) / parameters[VehicleParameter.WHEELBASE]
    slip_rate = (cy * cos - cx * sin) * yaw_rate
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    x[AugmentedState.WHEEL_SPEED], x[AugmentedState.STEERING] = wheel_speed, bias
    x[AugmentedState.SLIP_T] = slip_t - (gy * cos - gx * sin)  # the part that turns along
    x[AugmentedState.SLIP_I] = slip_i - (gy * math.cos(x[3]) - gx * math.sin(x[3]))
    x[AugmentedState.DRIVE] = drive + wheel_speed * (wheel / tau + slip_rate)
    x[AugmentedState.WHEEL] = wheel - (cx * cos + cy * sin)
    for i in range(4):
        x[AugmentedState.SIDE_X + i] = e.map_disturbance[i]
    valves, acting = np.empty(2), np.empty(3)
    lasting = np.zeros(2 * (SIZE - STATES))  # rates of disturbances that do not fade
    step = Step(middle=np.empty(SIZE), inputs=np.empty(3), fading=np.empty(SIZE - STATES))
    for n in range(lead.whole + 1, -1, -1):
        span_s = part_s if n == lead.whole else period_s
        for j in range(3):
            at, share = n + int(lead.late[j, 0]), lead.late[j, 1] / period_s
            acting[j] = commands[at, j] + share * (commands[at + 1, j] - commands[at, j])
        # A valve reaches its command within the period: commands keep to the same rate limit.
        for j in range(2):
            reach = parameters[VehicleParameter.STEERING_RATE_T + j] * (period_s - part_s)
            if n == lead.whole + 1:
                valves[j] = acting[j]
            elif n == lead.whole:
                valves[j] = min(max(acting[j], valves[j] - reach), valves[j] + reach)
        if n == lead.whole + 1 or span_s <= SAME_TIME_S:
            continue
        steps = steps_over(span_s)
        for _ in range(steps):
            move_augmented_state(x, valves, acting, parameters, lasting, span_s / steps, step)
    write_estimate(x, covariance, parameters, estimate)
    e.time_s += lead.ahead_s
    for i in range(STATES):
        for j in range(STATES):
            e.covariance[i, j] = kept[i, j]


Guided: TypeAlias = Controller | DeadTimeCompensation


def _split(time_s: float, period_s: float) -> tuple[int, float]:
    """Return the whole periods in a time [s] and the rest of it [s]."""
    whole = math.floor((time_s + SAME_TIME_S) / period_s)
    return whole, max(0.0, time_s - whole * period_s)
