"""Handling of the farm machine on a firm, level plane: response of the yaw rate to the steering."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ....testbed.ground.soil import SoilMap
from ....testbed.ground.terrain import flat
from ....testbed.validation.bench import FIRM_KPA, Bench, drive, steps
from ....testbed.validation.check import between
from ....testbed.vehicle.vehicle import PlantVehicle, read_vehicle
from ....testbed.wheels.soil_law import SoilLaw
from .evidence import ASSUMED_RULE, Evidence, around

_UMEDA: Final = "Umeda and Honami 1975, J. Jpn. Soc. Agric. Mach. 37(3)"
_FREQUENCY_HZ: Final = 0.2
_AMPLITUDE: Final = math.radians(4.0)
_SPEEDS: Final = (0.7, 1.4, 2.8)  # [m/s]
_MASSES: Final = (0.75, 1.0, 1.25)  # times the mass of the tractor
_STEP: Final = math.radians(3.0)
_STEP_SPEED: Final = 4.5  # [m/s] of the source
_RESPONSE_S: Final = 6.0
_SAME: Final = 0.05  # spread of responses that count as the same; assumed
_RULE: Final = f'"independent" taken as a spread of at most {100 * _SAME:.0f} %, assumed'


def farm(mass: float = 1.0, speed_gain: float | None = None) -> Bench:
    """Return the farm machine on firm, level ground.

    Args:
        mass: times the mass of the tractor in the file, same centre of mass.
        speed_gain: steady speed at hydrostat position 1 [m/s]; None: as in the file.
    """
    vehicle: PlantVehicle = read_vehicle("farm4500")
    tractor = replace(vehicle.tractor, mass_kg=mass * vehicle.tractor.mass_kg)
    hydrostat = vehicle.hydrostat
    if speed_gain is not None:
        hydrostat = replace(hydrostat, speed_gain_mps=speed_gain)
    return Bench(
        replace(vehicle, tractor=tractor, hydrostat=hydrostat),
        flat((300.0, 60.0)),
        SoilMap(FIRM_KPA),
    )


def yaw_gain(bench: Bench, speed: float, periods: int = 3) -> float:
    """Return the amplitude of the yaw rate over that of v tan(delta) / L, sinusoidal steering."""
    plant = bench.plant(bench.terrain)
    plant.reset(-140.0, 0.0, 0.0, speed)
    every, period = 0.05, 1.0 / _FREQUENCY_HZ
    rows = []
    for k in range(round((periods + 1) * period / every)):
        phase = 2.0 * math.pi * _FREQUENCY_HZ * k * every
        command = bench.command(speed, delta_t=_AMPLITUDE * math.sin(phase))
        truth = plant.advance(command, steps(plant, every))
        ackermann = truth.speed * math.tan(truth.delta_t) / bench.nominal.wheelbase
        rows.append((truth.yaw_rate_t, ackermann))
    steady = np.array(rows[round(period / every) :])  # the first period is the transient
    angles = 2.0 * math.pi * _FREQUENCY_HZ * every * np.arange(len(steady))
    yaw, ackermann = np.abs(np.exp(-1j * angles) @ steady)
    return float(yaw / ackermann)


def yaw_response(
    masses: Sequence[float] = _MASSES, speeds: Sequence[float] = _SPEEDS
) -> list[Evidence]:
    """Return how far the response of the yaw rate depends on weight and on speed."""
    by_mass = [yaw_gain(farm(mass), speeds[-1]) for mass in masses]
    by_speed = [yaw_gain(farm(), speed) for speed in speeds]
    rows = (
        ("weight", by_mass, f"{masses[0]:g} to {masses[-1]:g} times its mass, {speeds[-1]:g} m/s"),
        ("speed", by_speed, f"{speeds[0]:g} to {speeds[-1]:g} m/s"),
    )
    items = []
    for what, gains, text in rows:
        check = between(
            f"spread of the tractor's yaw response over {what}",
            figure=100.0 * (max(gains) - min(gains)) / float(np.mean(gains)),
            low=0.0,
            high=100.0 * _SAME,
            unit="%",
            source=_UMEDA,
            note="gains over Ackermann " + ", ".join(f"{gain:.3f}" for gain in gains),
        )
        items.append(
            Evidence(
                check,
                f"independent of {what}",
                _RULE,
                f"farm machine on firm, level ground, front wheels at {_FREQUENCY_HZ:g} Hz and "
                f"{math.degrees(_AMPLITUDE):g} deg, {text}, no seed",
                above="unknown",
            )
        )
    return items


def sensitivity(
    changes: Sequence[float] = (0.1, 0.5), seconds: float = _RESPONSE_S
) -> list[Evidence]:
    """Return how far cornering stiffness changes the responses to a step of the steering."""
    nominal = _step_response(1.0, seconds)
    items = []
    for change in changes:
        share = max(
            float(np.linalg.norm(response - nominal, axis=0)[k] / np.linalg.norm(nominal[:, k]))
            for response in (_step_response(1.0 + sign * change, seconds) for sign in (-1, 1))
            for k in range(nominal.shape[1])
        )
        small = change <= 0.1
        low, high = around(2.0) if small else (0.0, 20.0)
        check = between(
            f"change of responses by ± {100.0 * change:.0f} % of all cornering stiffnesses",
            figure=100.0 * share,
            low=low,
            high=high,
            unit="%",
            source="Karkee and Steward 2010, J. Terramechanics 47(6), tractor with grain cart",
        )
        items.append(
            Evidence(
                check,
                "2 %" if small else "at most 20 %",
                ASSUMED_RULE if small else "the source's limit",
                f"largest relative RMS change of the yaw rates of tractor and trailer over "
                f"{seconds:g} s after a step of {math.degrees(_STEP):g} deg at {_STEP_SPEED:g} "
                f"m/s, farm machine at 900 kPa, no seed",
                below="yaw rates alone are compared, of a machine that is lighter than the "
                "source's; slip angles follow the stiffness more than they do",
                above="unknown",
            )
        )
    return items


def _step_response(stiffness: float, seconds: float) -> FloatArray:
    """Return yaw rates of tractor and trailer after a step of the steering, (n, 2) [rad/s].

    Args:
        stiffness: times the cornering stiffness of every tyre.
        seconds: after the step.
    """
    law = SoilLaw()
    keys = (
        "side_stiffness_per_rad",
        "side_stiffness_mobility_per_rad",
        "side_stiffness_most_per_rad",
    )
    law = replace(law, **{key: stiffness * getattr(law, key) for key in keys})
    bench = replace(farm(speed_gain=5.0), wheel_law=law)
    plant = bench.plant(bench.terrain, 900.0)
    plant.reset(-140.0, 0.0, 0.0, _STEP_SPEED)
    plant.advance(bench.command(_STEP_SPEED), steps(plant, 1.0))
    truths = drive(plant, bench.command(_STEP_SPEED, delta_t=_STEP), seconds, 0.02)
    return np.array([(truth.yaw_rate_t, truth.yaw_rate_i) for truth in truths])
