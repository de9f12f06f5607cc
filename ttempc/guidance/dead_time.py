"""Compensation of the actuators' dead times around any controller."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..estimation.filter import SAME_TIME_S, steps_over
from ..models.augmented_state import (
    SIZE,
    STATES,
    augmented_of,
    estimate_of,
    move_augmented_state,
    vehicle_parameters,
)
from ..reference.reference import Reference
from ..types import (
    Command,
    Controller,
    ControlStep,
    Estimate,
    FloatArray,
    Preparing,
    Resuming,
    SpaceBased,
    WarmingUp,
)
from ..vehicle import CommandLimits, Vehicle

_MOST_SLIP = 0.9  # of the wheels, up to which an estimate is predicted


def compensated(
    make: Callable[[Vehicle, Reference], Controller], reference: Reference, period_s: float
) -> Controller:
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
    would cost the tractor more than it gives the trailer (docs/actuators.md).
    """
    return max(vehicle.dead_time_t, vehicle.dead_time_hp)


def resume(controller: Controller, previous: Controller, sent: Sequence[Command]) -> None:
    """Let `controller` continue after `previous`; around either dead times may be compensated.

    `sent` are the last commands, oldest first.
    """
    if isinstance(controller, DeadTimeCompensation):
        for command in sent:
            controller.record(command)
        controller = controller.controller
    if isinstance(previous, DeadTimeCompensation):
        previous = previous.controller
    if isinstance(controller, Resuming):
        controller.resume(previous)


class DeadTimeCompensation:
    """Let a controller for a vehicle without dead times drive one that has them.

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
        self.controller, self._vehicle, self._period_s = controller, vehicle, period_s
        self._parameters = vehicle_parameters(vehicle)
        dead_times = vehicle.dead_times
        self._lead_s = lead_s(vehicle)
        self._whole, self._part_s = _split(self._lead_s, period_s)
        early = self._lead_s - dead_times
        # (3, 2) whole periods and rest [s] by which an input is sent later
        self.hold_back: FloatArray = np.array(
            [_split(time_s, period_s) for time_s in np.maximum(early, 0.0).tolist()]
        )
        self._late = [_split(time_s, period_s) for time_s in np.maximum(-early, 0.0).tolist()]
        start = CommandLimits.of(vehicle, period_s).clamp(reference.at(0.0).inputs)
        # Commands as they act together, the newest first; before the start those of the reference.
        count = self._whole + 3 + max(whole for whole, _ in self._late)
        self.commands: FloatArray = np.tile(start, (count, 1))
        self._sent: FloatArray | None = None  # by the last step, until it is recorded
        self.space_based = isinstance(controller, SpaceBased) and controller.space_based

    def warm_up(self) -> None:
        if isinstance(self.controller, WarmingUp):
            self.controller.warm_up()
        state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        self.predicted(Estimate(0.0, state, np.eye(STATES), np.zeros(2), 0.0))

    def prepare(self, k: int) -> None:
        if isinstance(self.controller, Preparing):
            self.controller.prepare(k)

    def step(self, estimate: Estimate, k: int) -> ControlStep:
        """Return the command for the period that starts at tick `k`."""
        step = self.controller.step(self.predicted(estimate), k)
        if isinstance(step, Command):
            step = ControlStep(step)
        self._begin(step.command.as_array())
        self._sent = self._earlier(0, [(int(whole), part_s) for whole, part_s in self.hold_back])
        return replace(step, command=Command(*self._sent.tolist()))

    def record(self, sent: Command) -> None:
        """Record the command of a period: in the place of the last step's, if there was one."""
        command = sent.as_array()
        if self._sent is None:
            self._begin(command)
        else:  # an input that is held back and was sent as it was has its newest command
            changed = command != self._sent
            self.commands[0] = np.where(changed, command, self.commands[0])
        self._sent = None

    def _begin(self, command: FloatArray) -> None:
        self.commands[1:] = self.commands[:-1].copy()
        self.commands[0] = command

    def _earlier(self, i: int, by: Sequence[tuple[int, float]]) -> FloatArray:
        """Return the `i`-th newest command, each input as it was earlier by whole periods + s."""
        result = np.empty(len(by))
        for j, (whole, part_s) in enumerate(by):
            later, earlier = self.commands[i + whole][j], self.commands[i + whole + 1][j]
            result[j] = later + part_s / self._period_s * (earlier - later)
        return result

    def predicted(self, estimate: Estimate) -> Estimate:
        """Return the estimate for the time at which a command of now acts."""
        vehicle = self._vehicle
        disturbance = np.minimum(estimate.disturbance, _MOST_SLIP)
        augmented = augmented_of(replace(estimate, disturbance=disturbance), vehicle)
        # A valve reaches its command within the period: commands keep to the same rate limit.
        before, acting = (self._earlier(i, self._late)[:2] for i in (self._whole + 1, self._whole))
        reach = vehicle.input_rate[:2] * (self._period_s - self._part_s)
        valves = np.clip(acting, before - reach, before + reach)
        lasting, faded = np.zeros(2 * (SIZE - STATES)), np.empty(SIZE - STATES)
        middle, inputs = np.empty(SIZE), np.empty(3)
        spans = [(self._whole, self._part_s)]
        spans += [(i, self._period_s) for i in reversed(range(self._whole))]
        for i, span_s in spans:
            if span_s <= SAME_TIME_S:
                continue
            acting, steps = self._earlier(i, self._late), steps_over(span_s)
            for _ in range(steps):
                move_augmented_state(
                    augmented,
                    valves,
                    acting,
                    self._parameters,
                    lasting,
                    span_s / steps,
                    middle,
                    inputs,
                    faded,
                )
        time_s = estimate.time_s + self._lead_s
        predicted = estimate_of(augmented, np.zeros((SIZE, SIZE)), time_s, vehicle, ())
        return replace(
            estimate,
            time_s=time_s,
            state=predicted.state,
            trailer_xy=predicted.trailer_xy,
            hitch_angle=predicted.hitch_angle,
            disturbance=predicted.disturbance,
        )


def _split(time_s: float, period_s: float) -> tuple[int, float]:
    """Return the whole periods in a time [s] and the rest of it [s]."""
    whole = math.floor((time_s + SAME_TIME_S) / period_s)
    return whole, max(0.0, time_s - whole * period_s)
