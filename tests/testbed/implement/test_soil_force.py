"""Compiled law of an implement in the soil: closed forms, passivity, moments, lift."""

import math

import numpy as np
import pytest
from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.implement.implement import Implement

FRAME, DT = 0.3, 0.002
LEVEL = flat((20.0, 20.0))
FIRM = Ground(LEVEL, np.full(LEVEL.heights.shape, 600.0))


def turn(yaw, pitch=0.0, roll=0.0):
    """Return the axes (3, 3) of a body with these angles [rad] (z, y', x'')."""
    cz, sz, cy, sy = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    cx, sx = math.cos(roll), math.sin(roll)
    aside = tool.offsets * math.cos(roll) + (FRAME + tool.depth_m) * math.sin(roll)
    about_z = (state.draft * aside - tool.behind_m * state.side * math.cos(roll)).sum()
    assert state.moment[2] == pytest.approx(about_z)
    assert state.moment[2] < 0.0  # clockwise, to the right


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
