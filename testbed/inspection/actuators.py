"""Step responses of the steering actuators: rate, lag and stop of each."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ttempc.vehicle import Vehicle

from .bench import Bench, drive
from .check import Chart, Check, Line, near

_EVERY_S: Final = 0.01
_COMMAND: Final = 1.5  # [rad] beyond every stop


@dataclass(frozen=True, slots=True)
class _Axis:
    """Nominal step response of one steering axis."""

    angle: str  # of `Truth` and `Command`
    name: str
    limit: float  # [rad]
    rate: float  # [rad/s]
    lag: float  # [s]


def _axes(vehicle: Vehicle) -> tuple[_Axis, _Axis]:
    return (
        _Axis(
            angle="delta_t",
            name="front steering",
            limit=vehicle.steering_limit_t,
            rate=vehicle.steering_rate_t,
            lag=vehicle.steering_lag_t,
        ),
        _Axis(
            angle="delta_i",
            name="trailer steering",
            limit=vehicle.steering_limit_i,
            rate=vehicle.steering_rate_i,
            lag=vehicle.steering_lag_i,
        ),
    )


def steering_steps(bench: Bench) -> list[Check]:
    """Check the response of both steering angles to a command beyond their stops."""
    checks = []
    for axis in _axes(bench.nominal):
        limit, rate, lag = axis.limit, axis.rate, axis.lag
        plant = bench.plant()
        plant.reset(0.0, 0.0, 0.0, 1.0)
        command = replace(bench.roll, **{axis.angle: _COMMAND})
        truths = drive(plant, command, limit / rate + 8.0 * lag, _EVERY_S)
        angle = np.array([getattr(truth, axis.angle) for truth in truths])
        time = np.array([truth.time_s for truth in truths])
        ideal = np.clip(np.degrees(rate * (time - lag)), 0.0, math.degrees(limit))
        chart = Chart(
            f"Step of the {axis.name}",
            "time [s]",
            "angle [deg]",
            (Line("plant", time, np.degrees(angle)), Line("rate, lag, stop", time, ideal, False)),
        )
        middle = int(np.searchsorted(angle, 0.7 * limit))
        middle = min(middle, len(angle) - 1)
        behind = time[middle] - angle[middle] / rate  # a lag trails a ramp by its time constant
        degrees = np.degrees([np.diff(angle).max() / _EVERY_S, rate, angle[-1], limit])
        source = "vehicle; rates of the paper's: Kayacan et al. 2016, constraints"
        checks += [
            near(
                f"{axis.name}, rate",
                figure=degrees[0],
                expected=degrees[1],
                tolerance=0.05 * degrees[1],
                unit="deg/s",
                source=source,
                chart=chart,
            ),
            near(
                f"{axis.name}, stop",
                figure=degrees[2],
                expected=degrees[3],
                tolerance=0.6,
                unit="deg",
                source="vehicle",
            ),
            near(
                f"{axis.name}, lag",
                figure=behind,
                expected=lag,
                tolerance=0.25 * lag,
                unit="s",
                source="vehicle",
            ),
        ]
    return checks
