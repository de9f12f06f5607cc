"""Handling of the farm machine on a firm, level plane: response of the yaw rate to the steering."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.inspection.bench import FIRM_KPA, Bench, steps
from proving_ground.testbed.inspection.check import between
from proving_ground.testbed.vehicle.vehicle import PlantVehicle
from proving_ground.testbed.vehicle.vehicle_file import read_vehicle

from .evidence import Evidence

_UMEDA: Final = "Umeda and Honami 1975, J. Jpn. Soc. Agric. Mach. 37(3)"
_FREQUENCY_HZ: Final = 0.2
_AMPLITUDE: Final = math.radians(4.0)
_SPEEDS: Final = (0.7, 1.4, 2.8)  # [m/s]
_MASSES: Final = (0.75, 1.0, 1.25)  # times the mass of the tractor
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
        replace(vehicle, tractor=tractor, hydrostat=hydrostat), flat((300.0, 60.0)), SoilMap(FIRM_KPA)
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
