"""Vertical response to a single bump."""

from __future__ import annotations

from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import Terrain, flat
from .bench import SPEED, Bench, drive, wheel_places
from .check import Chart, Check, Line, between

_HEIGHT: Final = 0.15  # of the bump over the smallest wheel's radius
_LENGTH: Final = 1.0  # over the same: short enough to excite the wheel hop
_RUN_UP_M: Final = 2.0
_EVERY_S: Final = 0.01


def bump(bench: Bench) -> list[Check]:
    """Check loads and remaining energy after a (1 - cos) bump across the lane.

    The energy is that of vertical motion and of the tyre deflections relative to steady rolling,
    sum m vz^2 / 2 + sum (N - N0)^2 / 2k.
    """
    plant = bench.plant(flat((60.0, 8.0)))
    plant.reset(0.0, 0.0, 0.0, 0.0)
    radius = float(plant.tyres.radius.min())
    places = wheel_places(plant)[:, 0]
    length, ahead = _LENGTH * radius, places.max() + _RUN_UP_M
    plant = bench.plant(_lane(ahead, length, _HEIGHT * radius))
    plant.reset(0.0, 0.0, 0.0, SPEED)
    travel = ahead + length - places.min() + 0.3  # until the last wheel has left the bump
    seconds = travel / SPEED
    mass, stiffness = plant.model.body_mass, plant.tyres.stiffness
    loads, verticals = [], []
    for _ in range(round((seconds + 1.0) / _EVERY_S)):
        before = plant.data.xipos[:, 2].copy()
        load = drive(plant, bench.roll, _EVERY_S, _EVERY_S)[0].wheels.load
        loads.append(load)
        verticals.append((plant.data.xipos[:, 2] - before) / _EVERY_S)
    force, vertical = np.array(loads), np.array(verticals)
    run_up = _samples((_RUN_UP_M - 0.2) / SPEED)
    rest = force[run_up - _samples(0.5) : run_up].mean(axis=0)  # rolling
    energy = 0.5 * vertical**2 @ mass + 0.5 * (force - rest) ** 2 @ (1.0 / stiffness)
    remaining = float(energy[-_samples(0.2) :].mean() / energy[run_up:].max())
    time = _EVERY_S * np.arange(1.0, len(energy) + 1.0)
    rows: list[tuple[str, FloatArray]] = [
        ("front left", force[:, 0]),
        ("rear left", force[:, 2]),
        ("trailer left", force[:, 4]),
    ]
    chart = Chart(
        f"Over a bump of {100.0 * _HEIGHT * radius:.0f} cm",
        "time [s]",
        "wheel load [kN]",
        tuple(Line(name, time, 1e-3 * row) for name, row in rows),
    )
    return [
        between(
            "least wheel load over a bump",
            figure=force.min(),
            low=0.0,
            high=np.inf,
            unit="N",
            source="the ground does not pull",
            note=f"{np.mean(force <= 0.0):.1%} of the samples without load",
            chart=chart,
        ),
        between(
            "energy left a second after the bump",
            figure=100.0 * remaining,
            low=0.0,
            high=2.0,
            unit="% of its peak",
            source="the tyres damp a bump within a second (assumed)",
        ),
    ]


def _samples(seconds: float) -> int:
    """Return the number of samples in a time [s]."""
    return round(seconds / _EVERY_S)


def _lane(start: float, length: float, height: float) -> Terrain:
    """Return level ground with a bump from `start` on across the whole width; all in [m]."""
    lane = flat((60.0, 8.0), spacing_m=0.05)
    x = lane.origin[0] + lane.spacing_m * np.arange(lane.heights.shape[1])
    inside = (x > start) & (x < start + length)
    wave = 0.5 * height * (1.0 - np.cos(2.0 * np.pi * (x - start) / length))
    return Terrain(np.where(inside, wave, 0.0) + lane.heights, lane.spacing_m, lane.origin)
