"""Closed loop of a controller and the exact kinematic model with valves, a plant without soil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.reference.models.kinematics import advance
from tests.reference.models.valves import slew
from ttempc.guidance.dead_time import DeadTimeCompensation
from ttempc.guidance.own_parts import as_controller
from ttempc.guidance.safety import SafetyLimits
from ttempc.guidance.supervisor import Supervisor
from ttempc.layout import ALARM, estimate_row
from ttempc.models.kinematics import NO_DISTURBANCE, hitch_angle, trailer_point
from ttempc.reference.reference import Reference
from ttempc.types import Command, Controller, ControlStep, Estimate, FloatArray
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
SUBSTEPS = 5
START_UP_S = 8.0
LOST_M = 5.0


def seen_truth(
    state: FloatArray, time_s: float, vehicle: Vehicle, disturbance: FloatArray = NO_DISTURBANCE
) -> Estimate:
    """Return the estimate without error of a state (7,) and a disturbance (5,)."""
    return Estimate(
        time_s=time_s,
        state=state,
        covariance=np.zeros((7, 7)),
        trailer_xy=trailer_point(state, vehicle),
        hitch_angle=hitch_angle(state),
        disturbance=disturbance,
    )


class Supervised(Supervisor):
    """A supervisor on estimates and alarms as objects, a controller on the time of its ticks."""

    def __init__(self, controller, reference, period_s, safety=None):
        if not isinstance(controller, DeadTimeCompensation):
            controller = as_controller(controller)
        limits = safety or SafetyLimits()
        super().__init__(controller, reference, period_s, limits, self.said)

    def said(self, row, numbers):
        return self.alarms[row].reason

    def step(self, estimate, k, time_s=None, alarms=()):
        """Return the step of tick `k`; the estimate is None where there is none."""
        self.alarms = alarms
        rows = np.array([[alarm.reaction, 0.0, 0.0, 0.0] for alarm in alarms]).reshape(-1, ALARM)
        row = None if estimate is None else estimate_row(estimate)
        if self.decide(row, k, k * PERIOD_S if time_s is None else time_s, rows):
            self.compute_command(row, k, lambda: estimate)
        command = self.finish()
        return ControlStep(Command(*command.tolist()), self.diagnostics())


@dataclass(frozen=True)
class Drive:
    """Result of a run at every tick, until its end or until the vehicle was lost."""

    tractor_m: FloatArray  # (N,) distance from the tractor's own reference
    trailer_m: FloatArray  # (N,)
    curvature: FloatArray  # (N,) of the reference [1/m]
    steps: list[ControlStep]
    lost: bool  # whether the tractor got farther from its reference than `LOST_M`

    @property
    def largest_m(self) -> float:
        """Return the largest distance of either point."""
        return float(max(self.tractor_m.max(), self.trailer_m.max()))

    @property
    def commands(self) -> FloatArray:
        """Return the commands, (N, 3)."""
        return np.array([step.command.as_array() for step in self.steps])

    def after(self, time_s: float) -> Drive:
        """Return the run from `time_s` on."""
        k = round(time_s / PERIOD_S)
        distances = self.tractor_m[k:], self.trailer_m[k:]
        return Drive(*distances, self.curvature[k:], self.steps[k:], self.lost)

    def mean_cm(self) -> tuple[float, float, float, float]:
        """Return tractor and trailer on straights, then on curves, after start-up."""
        counted = np.arange(len(self.tractor_m)) * PERIOD_S >= START_UP_S
        curve = np.abs(self.curvature) > 1e-9
        return tuple(
            100.0 * float(distance[counted & where].mean())
            for where in (~curve, curve)
            for distance in (self.tractor_m, self.trailer_m)
        )  # pyright: ignore[reportReturnType]


def drive(
    controller: Controller,
    reference: Reference,
    noise: FloatArray | None = None,
    seed: int = 0,
    ticks: int | None = None,
    offset: FloatArray | float = 0.0,
    disturbance: FloatArray = NO_DISTURBANCE,
) -> Drive:
    """Drive along a reference, at most for `ticks`.

    `noise` is the standard deviation of the estimated state (7,), white; `offset` that of the first
    state from the reference's; the `disturbance` (5,) is constant and known to the controller.
    """
    vehicle, generator = reference.vehicle, np.random.default_rng(seed)
    grid = reference.on_grid(PERIOD_S)
    state, valves = grid.state[0] + offset, grid.inputs[0, :2]
    tractor, trailer, steps = [], [], []
    for k in range(ticks or len(grid.time_s) - 1):
        tractor.append(np.hypot(*(state - grid.state[k])[:2]))
        trailer.append(np.hypot(*(trailer_point(state, vehicle) - grid.trailer_xy[k])))
        if tractor[-1] > LOST_M:
            break
        estimated = state if noise is None else state + noise * generator.standard_normal(7)
        estimate = seen_truth(estimated, k * PERIOD_S, vehicle, disturbance)
        steps.append(controller.step(estimate, k))
        command = steps[-1].command.as_array()
        for _ in range(SUBSTEPS):
            inputs, valves = slew(valves, command, vehicle, PERIOD_S / SUBSTEPS)
            state = advance(state, inputs, vehicle, PERIOD_S / SUBSTEPS, disturbance)
    return Drive(
        np.array(tractor),
        np.array(trailer),
        grid.curvature[: len(tractor)],
        steps,
        tractor[-1] > LOST_M,
    )
