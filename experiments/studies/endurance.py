"""Validity of the simulation over hours of random driving on every class of ground.

    python -m experiments.studies.endurance [HOURS [SCENARIO]]

Drives the scenario's vehicle (default: grass) for HOURS of simulated time (default: 3), divided
among classes A to F, on soft to hard soil, with random steering and speeds up to the top speed. A
warning, a reset or a NaN of MuJoCo ends a drive and is counted. Roll-overs and jack-knives are
counted, too; they are no error of the simulation. Exit code 1 if the simulation was invalid once.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ttempc.types import Command

from ...testbed.errors import PlantDiverged
from ...testbed.ground.soil import SoilMap
from ...testbed.ground.terrain import ISO_8608, rough
from ...testbed.randomness import generator
from ...testbed.simulation.plant import Plant
from ...testbed.simulation.termination import TerminationLimits, check_termination
from ...testbed.validation.bench import Bench, steps
from ..scenario.scenario import load
from ..validation.validation_report import bench

_PERIOD_S: Final = 0.2
_HOLD: Final = 10  # periods between two random commands
_EDGE_M: Final = 6.0  # distance to the edge of the field at which a drive ends
_DRIVE_S: Final = 120.0  # longest drive
_STRENGTHS_KPA: Final = (150.0, 2000.0)


@dataclass(frozen=True, slots=True)
class Endurance:
    """Result of random driving on one class of ground."""

    iso_class: str
    driven_s: float
    drives: int
    losses: int  # roll-overs and jack-knives
    invalid: tuple[str, ...]  # reasons of PlantDiverged
    top_speed: float  # [m/s]
    unloaded: float  # share of wheel samples in the air


def endure(bench: Bench, iso_class: str, seconds: float, seed: int = 1) -> Endurance:
    """Drive at random on one class of ground for a simulated time [s]."""
    rng = generator(seed, f"endurance {iso_class}")
    driven, drives, losses, invalid, top, loads = 0.0, 0, 0, [], 0.0, []
    while driven < seconds - _PERIOD_S:
        strength = float(np.exp(rng.uniform(*np.log(_STRENGTHS_KPA))))
        plant = bench.plant(rough(iso_class, rng), SoilMap(strength))
        drives += 1
        try:
            spent, lost, fastest, samples = _drive(
                plant, bench, rng, min(_DRIVE_S, seconds - driven)
            )
        except PlantDiverged as error:
            invalid.append(f"class {iso_class}, drive {drives}, {strength:.0f} kPa: {error}")
            driven += _DRIVE_S
            continue
        driven, losses, top = driven + spent, losses + lost, max(top, fastest)
        loads.append(samples)
    unloaded = float(np.mean(np.concatenate(loads) <= 0.0)) if loads else math.nan
    return Endurance(iso_class, driven, drives, losses, tuple(invalid), top, unloaded)


def _drive(
    plant: Plant, bench: Bench, rng: np.random.Generator, seconds: float
) -> tuple[float, bool, float, np.ndarray]:
    """Drive to the end of time or field, or to a roll-over or jack-knife.

    Returns:
        Time [s], whether the vehicle was lost, top speed [m/s], wheel loads (n, wheels) [N].
    """
    vehicle, limits = bench.nominal, replace(TerminationLimits(), deviation=math.inf)
    truth = plant.reset(0.0, 0.0, rng.uniform(-math.pi, math.pi), 0.0)
    command, fastest, loads = Command(0.0, 0.0, 0.0), 0.0, []
    for period in range(round(seconds / _PERIOD_S)):
        if period % _HOLD == 0:
            command = Command(
                rng.uniform(-1.0, 1.0) * vehicle.steering_limit_t,
                rng.uniform(-1.0, 1.0) * vehicle.steering_limit_i,
                rng.choice([0.0, rng.uniform(0.0, 1.0), 1.0]),
            )
        truth = plant.advance(command, steps(plant, _PERIOD_S))
        loads.append(truth.wheels.load)
        fastest = max(fastest, truth.speed)
        if not plant.terrain.contains(truth.tractor.x, truth.tractor.y, _EDGE_M):
            break
        if check_termination(truth, (truth.tractor.x, truth.tractor.y), plant.terrain, limits):
            return truth.time_s, True, fastest, np.array(loads)
    return truth.time_s, False, fastest, np.array(loads)


def main(hours: str = "3", scenario: str = "grass") -> None:
    """Print one line per class; exit code 1 if the simulation was invalid once."""
    vehicle = bench(load(scenario)[1])
    wrong = 0
    for iso_class in ISO_8608:
        result = endure(vehicle, iso_class, 3600.0 * float(hours) / len(ISO_8608))
        print(
            f"class {iso_class}: {result.driven_s / 60.0:6.1f} min in {result.drives} drives, "
            f"{result.losses} roll-overs or jack-knives, up to {result.top_speed:.2f} m/s, "
            f"{result.unloaded:.2%} of wheel samples in the air, "
            f"invalid {len(result.invalid)} times",
            flush=True,
        )
        for reason in result.invalid:
            print(f"  {reason}")
        wrong += len(result.invalid)
    if wrong:
        raise SystemExit(1)


if __name__ == "__main__":
    main(*sys.argv[1:3])
