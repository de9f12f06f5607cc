"""Cost of the soil wheels: the physics loop relative to a bare `mj_step` of the same vehicle.

    python -m experiments.benchmarks.physics_loop

The baseline is `mujoco.mj_step`, called from Python, of the plant's own model (without visual
shapes) with no wheel forces. The bare vehicle floats without gravity: it has no ground to stand on.
Both kinds of step alternate in short blocks within one run, and their 5 % quantiles are compared:
other processes only slow a block down.
"""

from __future__ import annotations

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false
import time
from collections.abc import Callable
from typing import Final

import mujoco
import numpy as np

from ttempc.types import Command

from ...testbed.ground import terrain
from ...testbed.ground.soil import SoilMap
from ...testbed.randomness import generator
from ...testbed.simulation.plant import Plant
from ...testbed.vehicle.vehicle import PlantVehicle, read_vehicle, shipped_vehicles

STEPS: Final = 500  # of a block
REPEATS: Final = 200
QUANTILE: Final = 0.05
LARGEST_RATIO: Final = 1.45


def _seconds(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def measure(vehicle: PlantVehicle) -> tuple[float, float, float]:
    """Return soil loop and bare step [s per step], and the time step of both [s]."""
    ground = terrain.rough("D", generator(1, "terrain"))
    plant = Plant(vehicle, ground, SoilMap(600.0))
    plant.reset(0.0, 0.0, 0.0, 1.0)
    command = Command(0.05, 0.0, 1.0 / vehicle.hydrostat.speed_gain_mps)
    plant.advance(command, 500)
    start = plant.snapshot()
    model, data = plant.model, plant.data
    gravity = model.opt.gravity[2]

    def bare() -> None:
        step = mujoco.mj_step
        for _ in range(STEPS):
            step(model, data)

    soil_times, bare_times = [], []
    for _ in range(REPEATS):
        plant.restore(start)
        soil_times.append(_seconds(lambda: plant.advance(command, STEPS)) / STEPS)
        plant.restore(start)
        data.xfrc_applied[:] = 0.0
        model.opt.gravity[2] = 0.0
        bare_times.append(_seconds(bare) / STEPS)
        model.opt.gravity[2] = gravity
    soil, bare_step = np.quantile([soil_times, bare_times], QUANTILE, axis=1)
    return float(soil), float(bare_step), model.opt.timestep


def main() -> None:
    """Print the figures; exit code 1 if a soil loop exceeds the largest ratio."""
    slow = False
    for name in shipped_vehicles():
        soil, bare, timestep = measure(read_vehicle(name))
        print(name)
        print(f"  soil loop     {1e6 * soil:7.2f} us/step, {timestep / soil:5.0f} x real time")
        print(f"  bare mj_step  {1e6 * bare:7.2f} us/step")
        print(f"  ratio         {soil / bare:7.2f}          (at most {LARGEST_RATIO})")
        slow |= soil > LARGEST_RATIO * bare
    if slow:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
