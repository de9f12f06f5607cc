"""Ruts: depth and passes against published values, work against resistance, snapshots."""

import math

import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.ground.surface import Grid
from proving_ground.testbed.wheels.ruts import Ruts, press
from proving_ground.testbed.wheels.tyre import mobility

from tests.testbed.plants import plant_on
from ttempc.types import Command

CONE_INDEX, EXPONENT = 250.0, 0.62
AHEAD = Command(0.0, 0.0, 0.5)
FRONT = slice(0, 2)


def plant_with(ruts=True, tilt=0.0):
    ground = terrain.flat((40.0, 12.0)).tilted(tilt, math.radians(90.0))
    plant = plant_on(ground, SoilMap(CONE_INDEX, ruts=ruts))
    plant.reset(-10.0, 0.0, 0.0, 0.6)
    return plant


def depths(plant):
    heights = plant.wheels.state[30:].reshape(plant.terrain.heights.shape)
    return plant.terrain.heights - heights


def test_rolling_resistance_is_the_work_of_sinkage():
    """Front wheels on new soil: Brixius' 1 / Bn, and the work of the ruts that they leave.

    The work is that of a plate, p = p_1 (z / z_1)^n with p_1 = W / (b l), in every cell.
    """
    plant = plant_with()
    plant.advance(AHEAD, 3000)
    truths = [plant.advance(AHEAD, 20) for _ in range(100)]
    load, force = (
        np.mean([getattr(t.wheels, name)[FRONT] for t in truths], axis=0)
        for name in ("load", "force_long")
    )
    law, tyres = plant.wheel_law, plant.tyres
    bn, _ = mobility(law, tyres, np.repeat(load, 3), np.full(6, CONE_INDEX))
    expected = -load * law.motion_resistance_ratio(bn[:1], np.zeros(1))
    np.testing.assert_allclose(force, expected, rtol=0.1)  # edges of ruts are those of the grid

    x, y = truths[-1].body_xyz[plant.body_names.index("front_left"), :2]
    column = round((x - 1.0 - plant.terrain.origin[0]) / 0.1)
    row = round((y - plant.terrain.origin[1]) / 0.1)
    assert x - truths[-1].tractor.x > 0.35  # ahead of the rear wheels
    rut = depths(plant)[row - 3 : row + 4, column + 5 : column + 9]
    give = 0.2 * tyres.section_height[0] * load[0] / tyres.rated_load[0]
    length = 2.0 * math.sqrt(give * (2.0 * tyres.radius[0] - give))
    first = rut.max()
    pressure = load[0] / ((tyres.width[0] + 0.03) * length)
    work = pressure * first / (EXPONENT + 1.0) * ((rut / first) ** (EXPONENT + 1.0)).sum()
    per_metre = work * 0.01 / (0.1 * rut.shape[1])
    assert per_metre == pytest.approx(load[0] / bn[0], rel=0.2)


def test_passes_deepen_a_rut_as_published():
    """Equal passes: z_2 / z_1 is 1.26 to 1.41, z_10 / z_1 2.2 to 3.2 for a of 3 to 2 (Abebe).

    The second pass costs less work than the first one, and a lighter wheel hardly deepens the rut.
    """
    ground = terrain.flat((4.0, 4.0))
    ruts = Ruts(ground.heights, np.zeros(ground.heights.shape), np.zeros(1), np.zeros(1))
    grid = Grid(*ground.origin, 0.1)

    def drive_over(sinkage):
        steps = np.arange(-1.0, 1.0, 0.025)
        works = [press(ruts, grid, x, 0.0, (0.0, 0.3), 0.025, sinkage) for x in steps]
        middle = ruts.heights[20, 12:28]
        return -float(np.mean(middle)), float(np.mean(works))

    (first, work), (second, less) = drive_over(0.03), drive_over(0.03)
    assert first == pytest.approx(0.03, rel=1e-6)
    assert work == pytest.approx(1.0, abs=0.1)
    assert 1.25 < second / first < 1.42
    assert less < 0.6 * work
    assert drive_over(0.01)[0] < 1.01 * second
    for _ in range(8):
        tenth, _ = drive_over(0.03)
    assert 2.1 < tenth / first < 3.2


def test_flanks_push_a_wheel_to_the_middle_of_its_rut():
    """Beside the middle of a rut, the ground's force on the vehicle points towards it."""
    plant = plant_with()
    plant.advance(AHEAD, 6000)
    pushed = []
    for offset in (-0.06, 0.06):
        rutted = plant.wheels.state.copy()
        plant.reset(-3.0, 0.0, 0.0, 0.0)
        plant.wheels.state[:] = np.concatenate([np.zeros(30), rutted[30:]])
        plant.data.qpos[1] += offset
        plant.data.qpos[2] -= 0.03
        plant.advance(Command(0.0, 0.0, 0.0), 2)
        pushed.append(float(plant.data.xfrc_applied[:, 1].sum()))
        plant.wheels.state[:] = rutted
    assert pushed[0] > 0.0 > pushed[1]


def test_a_snapshot_holds_the_ruts_and_a_reset_removes_them():
    plant = plant_with()
    plant.advance(AHEAD, 2000)
    snapshot = plant.snapshot()
    one = plant.advance(AHEAD, 500).body_xyz
    plant.restore(snapshot)
    np.testing.assert_array_equal(plant.advance(AHEAD, 500).body_xyz, one)
    assert depths(plant).max() > 0.01
    plant.reset(-10.0, 0.0, 0.0, 0.6)
    assert depths(plant).max() == 0.0
