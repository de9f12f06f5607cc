"""Drive and motion resistance: hydrostat step, coast-down."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from scipy.optimize import curve_fit

from ttempc.types import Command

from ..ground.terrain import flat
from ..simulation.plant import Plant
from ..truth import WHEELS
from ..wheels import tyre
from .bench import SPEED, STOP, Bench, bodies, centre_of_mass, drive
from .check import Chart, Check, Line, near

_TAUS: Final = 6.0  # length of the step over the time constant
_COAST_S: Final = 0.8
_BUILD_UP_S: Final = 0.2  # in which motion resistance builds up over its relaxation length


def hydrostat_step(bench: Bench) -> list[Check]:
    """Check the speed after a full hydrostat step on firm level ground: a first-order lag."""
    vehicle = bench.nominal
    plant = bench.plant(flat((120.0, 10.0)))
    plant.reset(-50.0, 0.0, 0.0, 0.0)
    truths = drive(plant, Command(0.0, 0.0, 1.0), _TAUS * vehicle.speed_time_constant, 0.05)
    time = np.array([truth.time_s for truth in truths])
    speed = np.array([truth.speed for truth in truths])

    def lag(t: np.ndarray, gain: float, tau: float) -> np.ndarray:
        return gain * (1.0 - np.exp(-t / tau))

    (gain, tau), _ = curve_fit(lag, time, speed, (1.0, 1.0))
    ideal = lag(time, vehicle.speed_gain, vehicle.speed_time_constant)
    chart = Chart(
        "Hydrostat step",
        "time [s]",
        "speed [m/s]",
        (Line("plant", time, speed), Line("K (1 - exp(-t/tau))", time, ideal, measured=False)),
    )
    source = "vehicle's K and tau; for the paper's vehicle: Kayacan et al. 2016, sec. II"
    return [
        near(
            "hydrostat gain K",
            figure=gain,
            expected=vehicle.speed_gain,
            tolerance=0.05 * vehicle.speed_gain,
            unit="m/s",
            source=source,
            chart=chart,
        ),
        near(
            "hydrostat time constant tau",
            figure=tau,
            expected=vehicle.speed_time_constant,
            tolerance=0.05 * vehicle.speed_time_constant,
            unit="s",
            source=source,
        ),
    ]


def coast_down(bench: Bench) -> list[Check]:
    """Check the deceleration without drive: motion resistance over inertia.

    (m + sum I/r^2) dv/dt = -sum R, with R the motion resistance of each wheel without torque and I
    its inertia about the axle.
    """
    plant = bench.plant(flat((20.0, 20.0)), bench.cone_index)
    plant.reset(0.0, 0.0, 0.0, SPEED)
    plant.model.actuator("hydrostat").forcerange[:] = 0.0
    truths = drive(plant, STOP, _COAST_S, 0.02)
    time = np.array([truth.time_s for truth in truths])
    speed = np.array([truth.speed for truth in truths])
    load = np.mean([truth.wheels.load for truth in truths], axis=0)
    law = plant.wheel_law
    bn, _ = tyre.mobility(law, plant.tyres, load, np.full(len(WHEELS), bench.cone_index))
    resistance = -float(load @ law.net_traction_ratio(bn, law.towed_slip(bn)))
    mass, _ = centre_of_mass(plant, bodies(plant, "tractor"))
    spin = np.array([_axle_inertia(plant, wheel) for wheel in WHEELS])
    expected = resistance / (mass + float((spin / plant.tyres.radius**2).sum()))
    late = (time > _BUILD_UP_S) & (speed > 0.1)
    measured = -float(np.polyfit(time[late], speed[late], 1)[0])
    chart = Chart(
        f"Coast-down, {bench.cone_index:.0f} kPa",
        "time [s]",
        "speed [m/s]",
        (
            Line("plant", time, speed),
            Line("motion resistance", time, SPEED - expected * time, measured=False),
        ),
    )
    return [
        near(
            f"coast-down at {bench.cone_index:.0f} kPa",
            figure=measured,
            expected=expected,
            tolerance=0.01 * expected,
            unit="m/s²",
            source="Brixius 1987: motion resistance without slip",
            chart=chart,
        )
    ]


def _axle_inertia(plant: Plant, wheel: str) -> float:
    """Return the inertia of a wheel about its axle [kg m^2], the y axis of its body."""
    body, axes = plant.model.body(wheel), np.empty(9)
    mujoco.mju_quat2Mat(axes, body.iquat)  # MuJoCo sorts the principal moments
    principal = float(axes.reshape(3, 3)[1] ** 2 @ body.inertia)
    return principal + float(plant.model.joint(wheel).armature[0])
