"""A small simulation: a controller on exact kinematics, as a plant without soil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.reference.models.kinematics import advance
from tests.reference.models.valves import slew
from ttempc.models.kinematics import hitch_angle, trailer_point
from ttempc.reference.reference import Reference
from ttempc.types import Controller, ControlStep, Estimate, FloatArray
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
SUBSTEPS = 5
START_UP_S = 8.0
LOST_M = 5.0


def seen_truth(state: FloatArray, time_s: float, vehicle: Vehicle) -> Estimate:
    """Return an estimate without error."""
    return Estimate(
        time_s=time_s,
        state=state,
        covariance=np.zeros((7, 7)),
        trailer_xy=trailer_point(state, vehicle),
        hitch_angle=hitch_angle(state),
    )


@dataclass(frozen=True)
class Drive:
    """What happened at every tick until the end or until the vehicle was lost."""

    tractor_m: FloatArray  # (N,) distance from the tractor's own reference
    trailer_m: FloatArray  # (N,)
    curvature: FloatArray  # (N,) of the reference [1/m]
    steps: list[ControlStep]
    lost: bool

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
) -> Drive:
    """Drive along `reference`; `noise` (7,) is the standard deviation of the seen state.

    The start is `offset` (7,) from the reference's.
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
        seen = state if noise is None else state + noise * generator.standard_normal(7)
        steps.append(controller.step(seen_truth(seen, k * PERIOD_S, vehicle), k))
        command = steps[-1].command.as_array()
        for _ in range(SUBSTEPS):
            inputs, valves = slew(valves, command, vehicle, PERIOD_S / SUBSTEPS)
            state = advance(state, inputs, vehicle, PERIOD_S / SUBSTEPS)
    return Drive(
        np.array(tractor),
        np.array(trailer),
        grid.curvature[: len(tractor)],
        steps,
        tractor[-1] > LOST_M,
    )
