"""Compiled law of an implement in the soil: closed forms, passivity, moments, lift."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from proving_ground.testbed.bodies import Bodies
from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.ground.terrain import flat, rough
from proving_ground.testbed.implement.implement import POINTS, Implement
from proving_ground.testbed.implement.tool_kernel import ToolLaw, Tools, tool_step, tool_surface

FRAME, DT = 0.3, 0.002
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


def act(tool, velocity, rotation=(0.0, 0.0, 0.0), *, axes=None, height=FRAME, xy=(0.0, 0.0),
        ground=FIRM, lowered=1.0, distance=0.0, variation=None):  # fmt: skip
    """Return depth, draft and side force of the points, total force, moment about the axle."""
    axes = turn(0.0) if axes is None else axes
    axle, velocity, rotation = np.array([*xy, height]), np.array(velocity), np.array(rotation)
    com, centre = np.array([0.3, -0.2, 0.5]), axle + np.array([0.2, 0.1, -0.1])
    cvel = np.concatenate([rotation, velocity + np.cross(rotation, com - axle)])
    bodies = Bodies(
        positions=np.tile(axle, (2, 1)),
        axes=np.tile(axes.ravel(), (2, 1)),
        mass_centres=np.tile(centre, (2, 1)),
        velocities=np.tile(cvel, (2, 1)),
        subtree_centres=np.tile(com, (2, 1)),
        wrenches=np.zeros((2, 6)),
    )
    tools = Tools(
        law=ToolLaw.of(tool, FRAME).row(),
        offsets=tool.offsets,
        work=np.array(tool.work_m).reshape(-1, 2),
        surface=tool_surface(tool, ground, 600.0, variation),
        bodies=bodies,
        trailer=1,
        lift=np.array([lowered, distance]),
        output=np.empty((POINTS, 3)),
        timestep=DT,
    )
    tool_step(tools)
    force = bodies.wrenches[1, :3]
    moment = bodies.wrenches[1, 3:] + np.cross(centre - axle, force)
    depth, draft, side = tools.output.T
    power = force @ velocity + moment @ rotation
    return SimpleNamespace(depth=depth, draft=draft, side=side, force=force, moment=moment,
                           power=power, lowered=tools.lift[0], distance=tools.lift[1])  # fmt: skip


def test_it_never_gives_energy_and_rests_without_force():
    rng = np.random.default_rng(2)
    terrain = rough("E", rng, (20.0, 20.0))
    ground = Ground(terrain, rng.uniform(200.0, 900.0, terrain.heights.shape))
    worked = 0
    for _ in range(300):
        state = act(
            Implement(depth_m=0.1, strength_exponent=1.3, vertical_share=0.0),
            rng.normal(0.0, 1.0, 3),
            rng.normal(0.0, 0.3, 3),
            axes=turn(rng.uniform(-3.0, 3.0), *rng.uniform(-0.1, 0.1, 2)),
            height=FRAME + rng.uniform(-0.05, 0.05),
            xy=rng.uniform(-5.0, 5.0, 2),
            ground=ground,
        )
        assert state.power <= 1e-9
        worked += state.power < 0.0
    assert worked > 250
    assert not act(Implement(), (0.0, 0.0, 0.0)).force.any()
    creep = act(Implement(), (1e-6, 1e-6, 0.0))
    assert np.abs(creep.force).max() < 1.0  # no jump from rest to motion


@pytest.mark.parametrize("kind", ["field-cultivator", "subsoiler", "disk-harrow"])
def test_draft_on_level_ground_is_that_of_the_standard(kind):
    tool, yaw = Implement(type=kind, texture="coarse"), 0.7
    ahead = turn(yaw)[:, 0]
    for speed in (0.7, 1.0, 3.0, -1.0):
        state, draft = act(tool, speed * ahead, axes=turn(yaw)), tool.draft(abs(speed))
        assert state.draft.sum() == pytest.approx(math.copysign(draft, speed), rel=1e-5)
        assert state.force[:2] == pytest.approx(-state.draft.sum() * ahead[:2])
        assert state.depth == pytest.approx(tool.depth_m)


def test_tools_are_pulled_down_and_disks_pushed_up_by_a_share_of_the_draft():
    for settings, share in (
        ({"type": "field-cultivator"}, 0.2),
        ({"type": "disk-harrow"}, -0.5),
        ({"vertical_share": 0.35}, 0.35),
    ):
        tool = Implement(**settings)
        for speed in (2.0, -1.0):
            state = act(tool, (speed, 0.0, 0.0))
            assert state.force[2] == pytest.approx(-share * tool.draft(abs(speed)), rel=1e-6)


def test_draft_by_place_has_its_mean_and_coefficient_of_variation():
    """And the draft of the standard times the field's own factor where it does not vary."""
    tool = Implement(draft_cv=0.2, draft_correlation_m=0.5, draft_factor=1.3)
    variation = tool.variation(np.random.default_rng(8), LEVEL)
    places = np.random.default_rng(9).uniform(-9.0, 9.0, (400, 2))
    draft = np.array(
        [act(tool, (1.0, 0.0, 0.0), xy=xy, variation=variation).draft[0] for xy in places]
    )
    usual = act(tool, (1.0, 0.0, 0.0)).draft[0]
    assert usual == pytest.approx(1.3 * act(Implement(), (1.0, 0.0, 0.0)).draft[0])
    assert draft.mean() == pytest.approx(usual, rel=0.04)
    assert draft.std() == pytest.approx(0.2 * usual, rel=0.15)
    assert Implement(draft_cv=0.0).variation(np.random.default_rng(8), LEVEL) is None


def test_side_force_is_stiffness_times_slip_angle_up_to_its_limit():
    tool = Implement()
    area = tool.width_m * tool.depth_m
    small = math.radians(0.5)
    side = act(tool, (math.cos(small), math.sin(small), 0.0)).side.sum()
    assert side == pytest.approx(-0.5 * tool.side_stiffness_n_per_deg_m2 * area, rel=0.01)
    large = act(tool, (0.0, 2.0, 0.0)).side.sum()
    assert large == pytest.approx(-tool.side_limit * tool.draft(0.0), rel=1e-3)


def test_a_rolled_trailer_works_deeper_on_one_side_and_forces_act_at_the_points():
    roll, tool = 0.02, Implement(vertical_share=0.0)  # left side up
    state = act(tool, (1.0, 0.0, 0.0), axes=turn(0.0, 0.0, roll))
    across = tool.offsets[-1] - tool.offsets[0]
    assert state.depth[0] - state.depth[-1] == pytest.approx(across * math.sin(roll), rel=1e-3)
    aside = tool.offsets * math.cos(roll) + (FRAME + tool.depth_m) * math.sin(roll)
    turning = (state.draft * aside - tool.behind_m * state.side * math.cos(roll)).sum()
    assert state.moment[2] == pytest.approx(turning)
    assert turning < 0.0  # clockwise, to the right


def test_forces_follow_the_strength_of_the_soil_only_where_asked():
    soft = Ground(LEVEL, np.full(LEVEL.heights.shape, 300.0))
    for exponent in (0.0, 1.0, 2.0):
        tool = Implement(strength_exponent=exponent)
        weak, strong = (act(tool, (1.0, 0.05, 0.0), ground=ground).force for ground in (soft, FIRM))
        assert weak == pytest.approx(0.5**exponent * strong)


def test_tools_are_lowered_in_their_intervals_and_raised_tools_have_no_force():
    tool = Implement(work_m=((1.0, 2.0),), lift_s=1.0)
    for distance, change in ((0.5, -DT), (1.5, DT), (2.5, -DT)):
        state = act(tool, (2.0, 0.0, 0.0), lowered=0.5, distance=distance)
        assert state.lowered == pytest.approx(0.5 + change)
        assert state.distance == pytest.approx(distance + 2.0 * DT)
    raised = act(tool, (1.0, 0.0, 0.0), lowered=0.0)
    assert not raised.depth.any()
    assert not raised.force.any()
