"""Compensation of the actuators' dead times around any controller."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple, TypeAlias

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
from ..types import (
    Command,
    Controller,
    Disturbance,
    Estimate,
    FloatArray,
    MapDisturbance,
    State,
)
from ..vehicle import CommandLimits, Vehicle

Record = Any
"""Record of a compiled call: fields by name, as `ttempc.jit.record` returns it."""

_MOST_SLIP: Final = 0.9  # disturbance up to which an estimate is predicted
_WHOLE: Final = 0  # columns of times: whole periods,
_REST: Final = 1  # rest [s]

_kernel: Final = cached_njit(error_model="numpy", nogil=True)


def compensated(
    make: Callable[[Vehicle, Reference], Controller], reference: Reference, period_s: float
) -> GuidedController:
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


def resume(
    controller: GuidedController, previous: GuidedController, sent: Sequence[Command]
) -> None:
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
    """Dead times around a controller for a vehicle that has none.

    `Supervisor` gives the controller the estimate of `predicted`, and keeps the `commands`. The
    whole of it: a command is computed ahead here, `command.py` sends each input when it is due.

    The controller gets the estimate for the time at which its command will act: predicted over
    D = `lead_s` by the model of the filter, with the disturbances of the estimate and the commands
    that are under way (Smith 1959; for estimates by a model Manitius and Olbrot 1979). Actuators
    with a shorter dead time d get their command later by D - d, so that the inputs of a command act
    together; between two ticks it is interpolated. The trailer steering may act later than that. A
    loop around the prediction has the margins of one without dead times; disturbances are corrected
    D later.
    """

    def __init__(self, controller: Controller, reference: Reference, period_s: float) -> None:
        vehicle = reference.vehicle
        ahead_s = lead_s(vehicle)
        self.controller = controller
        early_s = ahead_s - vehicle.dead_times
        self.hold_back = _split_all(early_s, period_s)  # by which an input is sent later
        late = _split_all(-early_s, period_s)  # by which it acts later than the lead
        whole, part_s = _split(ahead_s, period_s)
        self._lead = Lead(vehicle_parameters(vehicle), ahead_s, period_s, whole, part_s, late)
        start = CommandLimits.of(vehicle, period_s).clamp(reference.at(0.0).inputs)
        # Commands as they act together, the newest first; before the start those of the reference.
        count = whole + 3 + int(late[:, 0].max())
        self.commands: FloatArray = np.tile(start, (count, 1))
        self.space_based = controller.space_based

    def warm_up(self) -> None:
        self.controller.warm_up()
        state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        self.predicted(estimate_row(Estimate(0.0, state, np.eye(STATES), np.zeros(2), 0.0)))

    def predicted(self, row: FloatArray) -> FloatArray:
        """Return the record `ESTIMATE` for the time at which a command of now acts."""
        result = row.copy()
        predict_to(self._lead, self.commands, result)
        return result


@_kernel
def predict_to(lead: Lead, commands: FloatArray, estimate: FloatArray) -> None:
    """Advance the record `ESTIMATE` by a lead, but for its covariance.

    `commands` (count, 3) are the newest first.
    """
    e = record(estimate, ESTIMATE)
    covariance = e.covariance.copy()
    x = np.zeros(SIZE)
    _write_augmented_state(x, e, lead.parameters)
    _advance(x, lead, commands)
    write_estimate(x, np.zeros((SIZE, SIZE)), lead.parameters, estimate)
    e.covariance[:, :] = covariance
    e.time_s += lead.ahead_s


@_kernel
def _write_augmented_state(x: FloatArray, e: Record, parameters: FloatArray) -> None:
    """Write the augmented state (24,) of an estimate; what an estimate does not have stays 0.

    An estimate has total disturbances: the parts that are fixed in the map are taken off, and wheel
    slip turns into the speed of the wheels that the hydrostat drives.
    """
    for i in range(STATES):
        x[i] = e.state[i]
    for i in range(len(e.map_disturbance)):
        x[AugmentedState.SIDE_X + i] = e.map_disturbance[i]
    slip_t = min(e.disturbance[Disturbance.SLIP_T], _MOST_SLIP)
    slip_i = min(e.disturbance[Disturbance.SLIP_I], _MOST_SLIP)
    bias = min(e.disturbance[Disturbance.STEERING], _MOST_SLIP)
    drive = min(e.disturbance[Disturbance.DRIVE], _MOST_SLIP)
    wheel_slip = min(e.disturbance[Disturbance.WHEEL], _MOST_SLIP)

    speed = e.state[State.V]
    psi_t = e.state[State.PSI_T]
    psi_i = e.state[State.PSI_I]
    cos = math.cos(psi_t)
    sin = math.sin(psi_t)
    wheel_speed = speed / (1.0 - wheel_slip)
    gear = math.copysign(1.0, wheel_speed)
    side_x = gear * e.map_disturbance[MapDisturbance.SIDE_X]
    side_y = gear * e.map_disturbance[MapDisturbance.SIDE_Y]
    climb_x = gear * e.map_disturbance[MapDisturbance.CLIMB_X]
    climb_y = gear * e.map_disturbance[MapDisturbance.CLIMB_Y]

    # The slip of a slope changes as the vehicle turns, which accelerates the wheels.
    yaw_rate = speed * math.tan(e.state[State.DELTA_T] + bias)
    yaw_rate /= parameters[VehicleParameter.WHEELBASE]
    slip_rate = (climb_y * cos - climb_x * sin) * yaw_rate
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]

    x[AugmentedState.WHEEL_SPEED] = wheel_speed
    x[AugmentedState.STEERING] = bias
    x[AugmentedState.SLIP_T] = slip_t - (side_y * cos - side_x * sin)
    x[AugmentedState.SLIP_I] = slip_i - (side_y * math.cos(psi_i) - side_x * math.sin(psi_i))
    x[AugmentedState.DRIVE] = drive + wheel_speed * (wheel_slip / tau + slip_rate)
    x[AugmentedState.WHEEL] = wheel_slip - (climb_x * cos + climb_y * sin)


@_kernel
def _advance(x: FloatArray, lead: Lead, commands: FloatArray) -> None:
    """Advance an augmented state by a lead, by the commands that act in it.

    The first period of the lead is a part of one, since the commands of a tick begin to act within
    it; whole periods follow.
    """
    valves = np.empty(2)
    acting = np.empty(3)
    lasting = np.zeros(2 * (SIZE - STATES))  # rates of disturbances that do not fade
    step = Step(middle=np.empty(SIZE), inputs=np.empty(3), fading=np.empty(SIZE - STATES))

    first = lead.whole
    _write_acting(acting, lead, commands, first + 1)
    for axis in range(2):
        valves[axis] = acting[axis]
    for n in range(first, -1, -1):
        span_s = lead.part_s if n == first else lead.period_s
        _write_acting(acting, lead, commands, n)
        if n == first:
            _move_valves(valves, acting, lead)
        if span_s <= SAME_TIME_S:
            continue
        steps = steps_over(span_s)
        step_s = span_s / steps
        for _ in range(steps):
            move_augmented_state(x, valves, acting, lead.parameters, lasting, step_s, step)


@_kernel
def _write_acting(acting: FloatArray, lead: Lead, commands: FloatArray, n: int) -> None:
    """Write the command (3,) that acts `n` periods before the newest one does.

    An input with a longer dead time than the lead acts later; between two ticks it is interpolated.
    """
    for i in range(3):
        at = n + int(lead.late[i, _WHOLE])
        share = lead.late[i, _REST] / lead.period_s
        acting[i] = commands[at, i] + share * (commands[at + 1, i] - commands[at, i])


@_kernel
def _move_valves(valves: FloatArray, acting: FloatArray, lead: Lead) -> None:
    """Move the set points of the valves (2,) through the part of a period before the lead.

    A valve reaches its command within a period: commands keep to the same rate limit.
    """
    for axis in range(2):
        rate = lead.parameters[VehicleParameter.STEERING_RATE_T + axis]
        reach = rate * (lead.period_s - lead.part_s)
        valves[axis] = min(max(acting[axis], valves[axis] - reach), valves[axis] + reach)


GuidedController: TypeAlias = Controller | DeadTimeCompensation


def _split(time_s: float, period_s: float) -> tuple[int, float]:
    """Return the whole periods in a time [s] and the rest of it [s]."""
    whole = math.floor((time_s + SAME_TIME_S) / period_s)
    return whole, max(0.0, time_s - whole * period_s)


def _split_all(spans_s: FloatArray, period_s: float) -> FloatArray:
    """Return whole periods and rest [s] of times [s] above 0, of others 0; (n, 2)."""
    return np.array([_split(span_s, period_s) for span_s in np.maximum(spans_s, 0.0).tolist()])
