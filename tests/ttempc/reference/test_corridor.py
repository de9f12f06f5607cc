"""Corridor of a reference: where it holds, what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ttempc.errors import InvalidTuning
from ttempc.reference.corridor import Corridor, SpeedTube


def test_half_width_is_infinite_outside_the_intervals():
    distance = np.linspace(-5.0, 60.0, 1301)
    corridor = Corridor(0.1, ((0.0, 10.0), (30.0, 40.5)))
    inside = ((distance >= 0.0) & (distance < 10.0)) | ((distance >= 30.0) & (distance < 40.5))
    np.testing.assert_array_equal(np.isfinite(corridor.half_width(distance)), inside)
    assert set(corridor.half_width(distance)[inside]) == {0.1}
    assert np.all(Corridor(0.2).half_width(distance) == 0.2)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"half_width_m": 0.0}, "half_width_m: got 0.0"),
        ({"half_width_m": math.nan}, "half_width_m: got nan"),
        ({"half_width_m": 0.1, "hitch_limit": -1.0}, "hitch_limit: got -1.0"),
        ({"half_width_m": 0.1, "tool_behind_m": -0.1}, "tool_behind_m: got -0.1"),
        ({"half_width_m": 0.1, "along_m": ((5.0, 4.0),)}, r"along_m: got \[\[5.0, 4.0\]\]"),
        ({"half_width_m": 0.1, "along_m": ((0.0, 4.0), (3.0, 5.0))}, "must increase"),
    ],
)
def test_impossible_corridors_are_refused(values, named):
    with pytest.raises(InvalidTuning, match=named):
        Corridor(**values)


def test_a_hitch_limit_below_the_reference_is_refused():
    corridor = Corridor(0.1, hitch_limit=math.radians(20.0))
    corridor.require_hitch(np.radians([-19.0, 19.0]))
    with pytest.raises(InvalidTuning, match=r"got 20.0 deg, must exceed .* 21.0 deg"):
        corridor.require_hitch(np.radians([3.0, -21.0]))


def test_the_speed_within_a_corridor_is_the_largest_at_which_the_tube_fits():
    tube = SpeedTube((0.05, 0.02), (0.08, 0.2))
    for half_width in (0.07, 0.1, 0.3):
        speed = tube.speed_within(half_width)
        assert tube.half_width(speed).max() == pytest.approx(half_width)
    assert SpeedTube().speed_within(0.001) == math.inf
    assert SpeedTube((0.1, 0.0)).speed_within(0.1) == math.inf
    slowest = SpeedTube((0.2, 0.0)).speed_within(0.1)
    assert 0.0 < slowest == tube.speed_within(0.051)  # no tube of 0.1 m fits: still driven, slowly
    with pytest.raises(InvalidTuning, match="corridor_at_rest_m"):
        SpeedTube((-0.1, 0.0))
