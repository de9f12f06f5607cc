"""Law of an implement in the soil: compiled against reference, passivity, mirror, geometry."""

import math

import numpy as np
import pytest
from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.ground.terrain import flat, rough
from proving_ground.testbed.implement.implement import POINTS, Implement
from proving_ground.testbed.implement.tool_kernel import ToolLaw, tool_step

from tests.testbed.implement.reference import TrailerMotion, forces, lowered_after

FRAME = 0.3
LEVEL = flat((20.0, 20.0))
FIRM = Ground(LEVEL, np.full(LEVEL.heights.shape, 600.0))


def turn(yaw, pitch=0.0, roll=0.0):
    """Return the axes (3, 3) of a body with these angles [rad] (z, y', x'')."""
    cz, sz, cy, sy = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    cx, sx = math.cos(roll), math.sin(roll)
    about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    return about_z @ about_y @ about_x


def motion(velocity, rotation=(0.0, 0.0, 0.0), axle=(0.0, 0.0, FRAME), axes=None):
    axes = turn(0.0) if axes is None else axes
    return TrailerMotion(np.array(axle), axes, np.array(velocity, float), np.array(rotation))


def act(implement, state, ground=FIRM, lowered=1.0):
    law = ToolLaw.of(implement, FRAME, 600.0)
    return forces(law, implement.offsets, ground, state, lowered)


def rough_ground(rng):
    terrain = rough("E", rng, (20.0, 20.0))
    return Ground(terrain, rng.uniform(200.0, 900.0, terrain.heights.shape))


def random_motion(rng):
    axes = turn(rng.uniform(-3.0, 3.0), *rng.uniform(-0.1, 0.1, 2))
    axle = (*rng.uniform(-5.0, 5.0, 2), FRAME + rng.uniform(-0.05, 0.05))
    return motion(rng.normal(0.0, 1.0, 3), rng.normal(0.0, 0.3, 3), axle, axes)


@pytest.mark.parametrize("exponent", [0.0, 1.3])
@pytest.mark.parametrize("kind", ["field-cultivator", "subsoiler", "disk-harrow"])
def test_the_compiled_law_is_the_reference(kind, exponent):
    rng = np.random.default_rng(1)
    work = ((1.0, 2.0), (3.0, 4.0))
    tool = Implement(type=kind, depth_m=0.1, strength_exponent=exponent, work_m=work)
    law, ground, dt = ToolLaw.of(tool, FRAME, 600.0), rough_ground(rng), 0.002
    terrain = ground.terrain
    grid = np.array([*terrain.origin, terrain.spacing_m, dt])
    for _ in range(40):
        state, com, centre = random_motion(rng), rng.normal(size=3), rng.normal(size=3)
        lift = np.array([rng.uniform(), rng.uniform(0.0, 5.0)])
        at_com = state.velocity + np.cross(state.rotation, com - state.axle)
        output, xfrc = np.empty((POINTS, 3)), np.zeros((2, 6))
        distance = lift[1] + dt * abs(state.velocity @ state.axes[:, 0])
        lowered = lowered_after(law, np.array(work), lift[0], distance, dt)
        both = [np.tile(row, (2, 1)) for row in (state.axle, state.axes.ravel(), centre)]
        cvel = np.tile(np.concatenate([state.rotation, at_com]), (2, 1))
        tool_step(
            law.table(), tool.offsets, np.array(work), terrain.heights, ground.cone_index,
            grid, 1, *both, cvel, np.tile(com, (2, 1)), lift, output, xfrc,
        )  # fmt: skip
        expected = forces(law, tool.offsets, ground, state, lowered)
        assert lift == pytest.approx([lowered, distance], abs=1e-12)
        columns = np.column_stack([expected.depth, expected.draft, expected.side])
        assert output == pytest.approx(columns, rel=1e-9, abs=1e-9)
        moment = np.cross(expected.points - centre, expected.force).sum(axis=0)
        wrench = np.concatenate([expected.force.sum(axis=0), moment])
        assert xfrc[1] == pytest.approx(wrench, rel=1e-9, abs=1e-7)
        assert not xfrc[0].any()


def test_it_never_gives_energy_and_rests_without_force():
    rng = np.random.default_rng(2)
    tool, ground = Implement(depth_m=0.1), rough_ground(rng)
    worked = 0
    for _ in range(300):
        state = act(tool, random_motion(rng), ground)
        power = np.einsum("nk,nk->n", state.force, state.velocity)
        assert (power <= 0.0).all()
        worked += (power < 0.0).any()
    assert worked > 250
    assert not act(tool, motion((0.0, 0.0, 0.0))).force.any()
    creep = act(tool, motion((1e-6, 1e-6, 0.0)))
    assert np.abs(creep.force).max() < 1.0  # no jump from rest to motion


def test_draft_on_level_ground_is_that_of_the_standard():
    tool = Implement(type="field-cultivator", texture="coarse")
    for speed in (0.7, 1.0, 3.0):
        assert act(tool, motion((speed, 0.0, 0.0))).draft.sum() == pytest.approx(
            tool.draft(speed), rel=1e-5
        )
        back = act(tool, motion((-speed, 0.0, 0.0))).draft.sum()
        assert back == pytest.approx(-tool.draft(speed), rel=1e-5)


def test_side_force_is_stiffness_times_slip_angle_up_to_its_limit():
    tool = Implement()
    area = tool.width_m * tool.depth_m
    small = math.radians(0.5)
    side = act(tool, motion((math.cos(small), math.sin(small), 0.0))).side.sum()
    assert side == pytest.approx(-0.5 * tool.side_stiffness_n_per_deg_m2 * area, rel=0.01)
    large = act(tool, motion((0.0, 2.0, 0.0))).side.sum()
    assert large == pytest.approx(-tool.side_limit * tool.draft(0.0), rel=1e-3)


def test_forces_follow_the_strength_of_the_soil_only_where_asked():
    forward, soft = motion((1.0, 0.05, 0.0)), Ground(LEVEL, np.full(LEVEL.heights.shape, 300.0))
    for exponent in (0.0, 1.0, 2.0):
        tool = Implement(strength_exponent=exponent)
        weak, strong = (act(tool, forward, ground).force for ground in (soft, FIRM))
        assert weak == pytest.approx(0.5**exponent * strong)
