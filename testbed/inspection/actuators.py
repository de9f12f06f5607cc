"""The steering actuators: rate, lag and stop of each."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .bench import Bench, drive
from .check import Chart, Check, Line, near

_EVERY_S = 0.01


def steering_steps(bench: Bench) -> list[Check]:
    """Answer of both steering angles to a command far beyond their stops."""
    vehicle = bench.nominal
    checks = []
    for name, what, limit, rate, lag in (
        (
            *("delta_t", "front steering", vehicle.steering_limit_t),
            *(vehicle.steering_rate_t, vehicle.steering_lag_t),
        ),
        (
            *("delta_i", "trailer steering", vehicle.steering_limit_i),
            *(vehicle.steering_rate_i, vehicle.steering_lag_i),
        ),
    ):
        plant = bench.plant()
        plant.reset(0.0, 0.0, 0.0, 1.0)
        truths = drive(
            plant, replace(bench.roll, **{name: 1.5}), limit / rate + 8.0 * lag, _EVERY_S
        )
        angle = np.array([getattr(truth, name) for truth in truths])
        time = np.array([truth.time_s for truth in truths])
        ideal = np.clip(np.degrees(rate * (time - lag)), 0.0, math.degrees(limit))
        chart = Chart(
            f"Step of the {what}",
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
                f"{what}, rate",
                degrees[0],
                degrees[1],
                0.05 * degrees[1],
                "deg/s",
                source,
                chart=chart,
            ),
            near(f"{what}, stop", degrees[2], degrees[3], 0.6, "deg", "vehicle"),
            near(f"{what}, lag", behind, lag, 0.25 * lag, "s", "vehicle"),
        ]
    return checks
