"""Side force: mobility numbers, slip angles of the axles on side slopes, drift on a contour."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import flat
from ..truth import WHEELS
from ..vehicle.servos import tyres_of, wheel_loads
from ..wheels import tyre
from ..wheels.wheel_models import wheel_model
from .bench import DRIVEN, SPEED, TRAILER, Bench, drive, steps
from .check import Chart, Check, Line, between, near, not_applicable
from .steady_motion import Planar, steady_motion

_SLOPES: Final = np.radians([2.0, 4.0, 6.0, 8.0, 10.0])
_CONTOUR: Final = 0.10  # [rad] slope where the scenario is level
_SETTLE_S: Final = 2.0
_MEAN_S: Final = 1.0
_DRIFT_S: Final = 8.0


def mobility_numbers(bench: Bench) -> list[Check]:
    """Check that the mobility number of each axle at rest is one at which no assumed limit acts.

    Outside, side stiffness or side force are at the limit of the law, which no source gives.
    """
    law, vehicle = bench.wheel_law, bench.vehicle
    load, strength = wheel_loads(vehicle), np.full(len(WHEELS), bench.cone_index)
    bn, numbers = tyre.mobility(law, tyres_of(vehicle), load, strength)
    low = law.side_mobility / (law.side_most - law.side) if law.side_most > law.side else math.inf
    growth = law.side_stiffness_mobility_per_rad
    spare = law.side_stiffness_most_per_rad - law.side_stiffness_per_rad
    high = spare / growth if growth > 0.0 else math.inf
    checks = []
    for axle, wheel in (("front", 0), ("rear", 2), ("trailer", 4)):
        m = numbers[wheel : wheel + 1]
        name = f"mobility number M at {bench.cone_index:.0f} kPa, {axle} axle"
        note = (
            f"Bn = {bn[wheel]:.1f}, M = {m[0]:.1f}, side stiffness "
            f"{law.side_stiffness(m)[0]:.2f} per rad, side force at most "
            f"{law.largest_side_ratio(m)[0]:.2f} of the load"
        )
        if not wheel_model(bench.wheels).follows_soil_law:
            checks.append(not_applicable(name, "Coulomb friction has no mobility number"))
        elif not low <= m[0] <= high:
            limit = "the cap of side stiffness" if m[0] > high else "the limit of side force"
            checks.append(not_applicable(name, f"at {limit}, which is assumed: {note}"))
        else:
            source = "side force law without its assumed limits; the range of its data is unknown"
            checks.append(
                between(name, figure=m[0], low=low, high=high, unit="", source=source, note=note)
            )
    return checks


def side_force(bench: Bench) -> list[Check]:
    """Check side force over load at the slip angle of rear and trailer axle on side slopes.

    Slip angles follow from the motion of the axle points, not from the report of the wheels.
    """
    law, angles, ratios, expectations = bench.wheel_law, [], [], []
    for slope in _SLOPES:
        plant = bench.plant(
            flat((40.0, 20.0)).tilted(float(slope), 0.5 * math.pi), bench.cone_index
        )
        plant.reset(-10.0, 0.0, 0.0, SPEED)
        plant.advance(bench.roll, steps(plant, _SETTLE_S))
        truths = drive(plant, bench.roll, _MEAN_S, 0.05)
        load = np.mean([t.wheels.load for t in truths], axis=0)
        side = np.mean([t.wheels.force_lat for t in truths], axis=0)
        mobility = tyre.mobility(law, plant.tyres, load, np.full(len(WHEELS), bench.cone_index))
        slip = np.mean([t.wheels.slip for t in truths], axis=0)
        # the slip angle of the law refers to the speed of travel, or of sliding where it is larger
        travel = [max(t.speed, abs(t.rim_speed - t.speed)) for t in truths]
        rear = np.mean(
            [math.atan2(t.lateral_speed, v) for t, v in zip(truths, travel, strict=True)]
        )
        span = truths[-1].time_s - truths[0].time_s
        first, last = truths[0].trailer, truths[-1].trailer
        # the field's y rises with the slope
        velocity = np.array([last.x - first.x, (last.y - first.y) / math.cos(slope)]) / span
        yaw = np.mean([t.trailer.yaw for t in truths])
        trailer = math.atan2(
            velocity[1] * math.cos(yaw) - velocity[0] * math.sin(yaw),
            velocity[0] * math.cos(yaw) + velocity[1] * math.sin(yaw),
        )
        for axle, angle in ((DRIVEN, float(rear)), (TRAILER, trailer)):
            angles.append(angle)
            ratios.append(float(side[axle].sum() / load[axle].sum()))
            bn, m = (number[axle] for number in mobility)
            _, both = law.combined_ratios(bn, m, slip[axle], np.full(2, angle))
            expectations.append(float(load[axle] @ both / load[axle].sum()))
    order = np.argsort(angles)
    degrees = np.degrees(np.array(angles)[order])
    measured, expected = np.array(ratios)[order], np.array(expectations)[order]
    chart = Chart(
        f"Side force, {bench.cone_index:.0f} kPa",
        "slip angle [deg]",
        "side force / load",
        (Line("plant", degrees, measured), Line("lateral law", degrees, expected, False)),
    )
    return [
        between(
            f"side force over load at {bench.cone_index:.0f} kPa, off the law",
            figure=np.abs(measured - expected).max(),
            low=0.0,
            high=0.01,
            unit="",
            source="lateral law, mu (1 - exp(-C/mu |alpha|)) by similarity with slip",
            note=f"slip angles {degrees.min():.2f} to {degrees.max():.2f} deg",
            chart=chart,
        )
    ]


def contour(bench: Bench) -> list[Check]:
    """Check the drift down the slope along a contour, steering straight, by the force balance."""
    slope = bench.slope_rad or _CONTOUR
    plant = bench.plant(flat((60.0, 30.0)), bench.cone_index)
    plant.reset(0.0, 0.0, 0.0, 0.0)
    planar = Planar.of(bench.nominal, plant)
    plant = bench.plant(flat((60.0, 30.0)).tilted(slope, 0.5 * math.pi), bench.cone_index)
    plant.reset(-20.0, 0.0, 0.0, SPEED)
    truths = drive(plant, bench.roll, _DRIFT_S, 0.1)
    speed = float(np.mean([t.speed for t in truths]))
    load = np.mean([t.wheels.load for t in truths], axis=0)  # leaning downhill
    pull = plant.model.opt.gravity[2] * math.sin(slope)
    motion = steady_motion(planar, 0.0, speed, load, bench.cone_index, pull)
    time = np.array([t.time_s for t in truths])
    down = -np.array([t.tractor.y for t in truths]) / math.cos(slope)
    predicted = -_drift(motion.lateral_speed, motion.yaw_rate, speed, time)
    chart = Chart(
        f"Along a contour, slope {slope:.2f} rad, {bench.cone_index:.0f} kPa",
        "time [s]",
        "drift down the slope [m]",
        (Line("plant", time, down), Line("balance of forces", time, predicted, False)),
    )
    return [
        near(
            f"drift along a contour of {slope:.2f} rad in {speed * _DRIFT_S:.1f} m",
            figure=100.0 * down[-1],
            expected=100.0 * predicted[-1],
            tolerance=max(2.0, 15.0 * float(abs(predicted[-1]))),
            unit="cm",
            source="planar balance of forces with the same lateral law",
            chart=chart,
        )
    ]


def _drift(lateral: float, yaw_rate: float, speed: float, time: FloatArray) -> FloatArray:
    return lateral * time + 0.5 * speed * yaw_rate * time**2
