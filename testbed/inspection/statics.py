"""Statics: axle loads, load transfer on a slope, creep."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import flat
from ..simulation.plant import Plant
from ..truth import WHEELS, Truth
from ..vehicle.vehicle import AxleLoads
from ..wheels import tyre
from .bench import (
    DRIVEN,
    FIRM_KPA,
    STOP,
    TRAILER,
    Bench,
    bodies,
    centre_of_mass,
    drive,
    steps,
    weight,
    wheel_motion,
    wheel_places,
)
from .check import Check, between, near

_SLOPE: Final = math.radians(10.0)
_STEEP: Final = math.radians(15.0)
_CREEP_S: Final = 30.0
_REST_S: Final = 5.0
_UPHILL: Final = 0.5  # [m/s]
_CLIMB_S: Final = 4.0
_FRONT: Final = ~(DRIVEN | TRAILER)


def static_loads(bench: Bench) -> list[Check]:
    """Check the axle loads on level ground by the moments of the vehicle's file."""
    plant = bench.plant(flat((20.0, 20.0)))
    load = _standing(plant, 0.0).wheels.load
    measured = np.array([load[axle].sum() for axle in (_FRONT, DRIVEN, TRAILER)])
    source = "rule of the lever on masses and lengths of the vehicle's file"
    static = AxleLoads.of(bench.vehicle)
    expectations = {"front": static.front, "rear": static.rear, "trailer": static.trailer}
    total = sum(expectations.values())
    checks = [
        near(
            "weight on the wheels",
            figure=load.sum(),
            expected=total,
            tolerance=0.005 * total,
            unit="N",
            source=source,
        )
    ]
    for (axle, expected), figure in zip(expectations.items(), measured, strict=True):
        name = f"static load, {axle} axle"
        checks.append(
            near(
                name,
                figure=figure,
                expected=expected,
                tolerance=0.01 * expected,
                unit="N",
                source=source,
            )
        )
    return checks


def load_transfer(bench: Bench) -> list[Check]:
    """Check the shift of the centre of the wheel loads on a slope.

    h is the height of the centre of mass. With soil wheels motion resistance counts at the hub
    (`testbed.wheels.soil_law`: that of the tyre is a torque on the wheel, which is a force at the
    hub and its opposite, a part of gross traction, at the rim), all other forces along the slope
    act in the plane of the ground. Moments about the ground give

        shift = h tan(slope) + lever,   lever = (sum R_i h_i - T (h_rear - r)) / sum N_i

    down the slope from the foot of the centre of mass; the lever is that of motion resistance R_i
    at the heights h_i of the hubs and of gross traction T at the rim. It is zero across the slope.
    """
    ground = flat((30.0, 20.0)).tilted(_SLOPE, 0.5 * math.pi)
    across = bench.plant(ground)
    load = _standing(across, 0.0).wheels.load
    checks = [_transfer("across", across, load, _feet(across))]
    up = bench.plant(ground)
    up.reset(0.0, -4.0, 0.5 * math.pi, _UPHILL)
    command = bench.command(_UPHILL)
    up.advance(command, steps(up, _CLIMB_S))
    load = np.mean([truth.wheels.load for truth in drive(up, command, 0.5, 0.05)], axis=0)
    if up.wheels.follows_soil_law:
        lever = _resistance_lever(up, load)
        return [*checks, _transfer("up", up, load, wheel_places(up), lever)]
    return [*checks, _transfer("up", up, load, _feet(up))]


def _standing(plant: Plant, yaw: float) -> Truth:
    """Return the vehicle at rest, after the tread deflections of settling have faded."""
    plant.reset(0.0, 0.0, yaw, 0.0)
    return plant.advance(STOP, steps(plant, _REST_S))


def _feet(plant: Plant) -> FloatArray:
    """Return the centres of pressure under the wheels, (6, 3) [m]."""
    return tyre.contact(plant.tyres, plant.terrain, wheel_motion(plant)).point


def _transfer(
    name: str, plant: Plant, load: FloatArray, feet: FloatArray, lever: float = 0.0
) -> Check:
    uphill = np.array([0.0, math.cos(_SLOPE), math.sin(_SLOPE)])
    normal = np.array([0.0, -math.sin(_SLOPE), math.cos(_SLOPE)])
    centre = centre_of_mass(plant, bodies(plant, "tractor"))[1]
    shift = float(centre @ uphill - load @ (feet @ uphill) / load.sum())
    expected = float(centre @ normal) * math.tan(_SLOPE) + lever
    return near(
        f"load transfer {name} a slope of 10 deg",
        figure=1e3 * shift,
        expected=1e3 * expected,
        tolerance=20.0 * expected,
        unit="mm",
        source="moments about the ground: h tan(slope), lever of motion resistance",
    )


def _resistance_lever(plant: Plant, load: FloatArray) -> float:
    law = plant.wheel_law
    bn, _ = tyre.mobility(law, plant.tyres, load, np.full(len(WHEELS), FIRM_KPA))
    resistance = load * law.motion_resistance_ratio(bn, np.zeros(len(WHEELS)))  # (6,)
    normal = np.array([0.0, -math.sin(_SLOPE), math.cos(_SLOPE)])
    heights = wheel_places(plant) @ normal  # the plane runs through the origin
    traction = weight(plant) * math.sin(_SLOPE) + float(resistance.sum())
    sunk = float((heights - plant.tyres.radius)[DRIVEN].mean())
    return (float(resistance @ heights) - traction * sunk) / float(load.sum())


def creep(bench: Bench) -> list[Check]:
    """Check the displacement of the vehicle after 30 s at rest across a slope of 15 deg."""
    plant = bench.plant(flat((20.0, 20.0)).tilted(_STEEP, 0.5 * math.pi), bench.cone_index)
    before = plant.reset(0.0, 0.0, 0.0, 0.0)
    after = plant.advance(STOP, steps(plant, _CREEP_S))
    moved = [
        math.hypot(b.x - a.x, b.y - a.y)
        for a, b in ((before.tractor, after.tractor), (before.trailer, after.trailer))
    ]
    return [
        between(
            "creep across a slope of 15 deg in 30 s",
            figure=1e3 * max(moved),
            low=0.0,
            high=5.0,
            unit="mm",
            source="a wheel at rest does not move; 5 mm assumed, 1/6 of the paper's GNSS noise",
        )
    ]
