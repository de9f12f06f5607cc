"""Steady turning: yaw rate of the tractor, off-tracking of the trailer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..ground.terrain import flat
from .bench import FIRM_KPA, SPEED, Bench, drive, steps
from .check import Chart, Check, Line, between, near
from .steady_motion import Planar, steady_motion

_RADII: Final = (6.0, 8.0, 10.0, 14.0, 20.0)  # [m]
_STRENGTHS: Final = (FIRM_KPA, 600.0, 300.0)  # [kPa]
_RADIUS: Final = 10.0  # [m] of turns on softer soil
_SETTLE: Final = 8.0  # lengths behind the pin: the transient has decayed to e^-8
_MEAN_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class _Turn:
    ratio: float  # yaw rate over Ackermann's v tan(delta) / L
    predicted: float  # the same by `steady_motion`
    radius: float  # [m] of the tractor point
    off_tracking: float  # [m] by which the trailer point cuts in


def _turn(bench: Bench, radius: float, cone_index: float) -> _Turn:
    """Drive a circle at walking pace until it is steady, and return its mean values."""
    wheelbase = bench.nominal.wheelbase
    plant = bench.plant(flat((50.0, 50.0)), cone_index)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    planar = Planar.of(bench.nominal, plant)
    plant.reset(0.0, -radius, 0.0, SPEED)
    command = bench.command(SPEED, delta_t=math.atan(wheelbase / radius))
    behind = bench.nominal.drawbar_length + bench.nominal.trailer_length
    plant.advance(command, steps(plant, _SETTLE * behind / SPEED))
    truths = drive(plant, command, _MEAN_S, 0.05)
    delta, yaw_rate, speed, lateral, trailer_rate = np.mean(
        [(t.delta_t, t.yaw_rate_t, t.speed, t.lateral_speed, t.yaw_rate_i) for t in truths], axis=0
    )
    load = np.mean([t.wheels.load for t in truths], axis=0)
    ackermann = speed * math.tan(delta) / wheelbase
    motion = steady_motion(planar, delta, speed, load, cone_index)
    apart = np.diff([(t.trailer.x, t.trailer.y) for t in truths], axis=0)
    trailer_speed = float(
        np.linalg.norm(apart, axis=1).sum() / (truths[-1].time_s - truths[0].time_s)
    )
    tractor_radius = math.hypot(speed, lateral) / yaw_rate
    return _Turn(
        ratio=yaw_rate / ackermann,
        predicted=motion.yaw_rate / ackermann,
        radius=tractor_radius,
        off_tracking=tractor_radius - trailer_speed / trailer_rate,
    )


def circles(bench: Bench) -> list[Check]:
    """Check yaw rate and off-tracking on circles of 6 to 20 m on firm ground."""
    turns = [_turn(bench, radius, FIRM_KPA) for radius in _RADII]
    ratios = np.array([turn.ratio for turn in turns])
    predicted = np.array([turn.predicted for turn in turns])
    measured = np.array([turn.off_tracking for turn in turns])
    closed = np.array([off_tracking(bench, turn.radius) for turn in turns])
    radii = np.array(_RADII)
    turning = Chart(
        "Steady turning on firm ground",
        "radius by Ackermann [m]",
        "yaw rate / Ackermann",
        (Line("plant", radii, ratios), Line("balance of forces", radii, predicted, False)),
    )
    cutting = Chart(
        "Off-tracking, trailer unsteered",
        "radius by Ackermann [m]",
        "trailer inside tractor [m]",
        (Line("plant", radii, measured), Line("closed form", radii, closed, False)),
    )
    worst = np.abs(measured - closed).argmax()
    return [
        between(
            "turning, R = 6 to 20 m, least yaw rate over Ackermann",
            figure=ratios.min(),
            low=0.92,
            high=1.0,
            unit="",
            source="Ackermann; 0.08 below it for slip angles on firm ground (assumed)",
        ),
        between(
            "turning, R = 6 to 20 m, most yaw rate over Ackermann",
            figure=ratios.max(),
            low=0.92,
            high=1.0,
            unit="",
            source="Ackermann: slip angles at walking pace do not reduce the radius",
        ),
        between(
            "turning, R = 6 to 20 m, off the balance of forces",
            figure=np.abs(ratios - predicted).max(),
            low=0.0,
            high=0.015,
            unit="",
            source="planar balance of the same tyre law (steady_motion.py)",
            chart=turning,
        ),
        between(
            "off-tracking, R = 6 to 20 m, off the closed form",
            figure=1e3 * abs(measured - closed).max(),
            low=0.0,
            high=20.0,
            unit="mm",
            source="R - sqrt(R² + a² - (d + L_i)²); 20 mm for slip of the trailer's axle",
            note=f"worst at R = {radii[worst]:g} m: {measured[worst]:.3f} m, "
            f"closed form {closed[worst]:.3f} m",
            chart=cutting,
        ),
    ]


def softening(bench: Bench) -> list[Check]:
    """Check the loss of yaw rate by slip angles on one circle as the ground softens."""
    turns = [_turn(bench, _RADIUS, strength) for strength in _STRENGTHS]
    ratios = np.array([turn.ratio for turn in turns])
    predicted = np.array([turn.predicted for turn in turns])
    strengths = np.array(_STRENGTHS)
    chart = Chart(
        "Turning at R = 10 m on softer soil",
        "cone index [kPa]",
        "yaw rate / Ackermann",
        (Line("plant", strengths, ratios), Line("balance of forces", strengths, predicted, False)),
    )
    source = "planar balance of the lateral law: slip angles grow as soil softens"
    return [
        near(
            f"loss of yaw rate from {strengths[0]:.0f} to {strengths[-1]:.0f} kPa at R = 10 m",
            figure=ratios[0] - ratios[-1],
            expected=predicted[0] - predicted[-1],
            tolerance=0.01,
            unit="",
            source=source,
            chart=chart,
        ),
        between(
            "least loss of yaw rate from one soil to the next softer one",
            figure=-np.diff(ratios).max(),
            low=0.001,
            high=math.inf,
            unit="",
            source=source,
        ),
    ]


def off_tracking(bench: Bench, radius: float) -> float:
    """Return by how much an unsteered trailer cuts into a circle of a radius [m], both [m].

    The pin runs on a circle of radius sqrt(R^2 + a^2); the trailer's axle is tangent to its own
    circle.
    """
    vehicle = bench.nominal
    behind = vehicle.drawbar_length + vehicle.trailer_length
    return radius - math.sqrt(radius**2 + vehicle.hitch_offset**2 - behind**2)
