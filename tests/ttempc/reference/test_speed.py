"""Speed profiles and corridors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from ttempc.errors import InvalidReference, InvalidTuning
from ttempc.models.kinematics import trailer_point
from ttempc.reference.corridor import Corridor, SpeedTube
from ttempc.reference.path import Path, Segment, figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference, check_pace
from ttempc.reference.speed import (
    Backward,
    PlannedSpeed,
    limited_in_corridor,
    limited_in_curves,
)
from ttempc.vehicle import Vehicle

PLACES = np.array([0.0, 20.0, 20.5, 40.0, 41.0, 60.0])
SPEEDS = np.array([1.0, 1.0, 0.4, 0.4, 1.2, 1.2])
PLANNED = PlannedSpeed(PLACES, SPEEDS, 0.2)
PROFILES = {"constant": ConstantSpeed(0.7), "planned": PLANNED, "backward": Backward(PLANNED, 60.0)}


@pytest.fixture(params=PROFILES)
def profile(request):
    return PROFILES[request.param]


def test_speed_and_acceleration_are_the_derivatives_of_the_travel(profile):
    t, h = np.linspace(-3.0, profile.duration_s(60.0) + 3.0, 4001), 1e-4
    (before, slower, _), (after, faster, _) = profile.travel(t - h), profile.travel(t + h)
    _, speed, acceleration = profile.travel(t)
    np.testing.assert_allclose((after - before) / (2 * h), speed, atol=1e-6)
    np.testing.assert_allclose((faster - slower) / (2 * h), acceleration, atol=1e-3)


def test_the_duration_of_a_length_is_that_of_its_travel(profile):
    start = profile.travel(np.zeros(1))[0]
    for length in (10.0, 35.0, 60.0, 70.0):
        end = profile.travel(np.array([profile.duration_s(length)]))[0]
        assert abs(end - start) == pytest.approx(length, abs=1e-6)


def test_planned_acceleration_is_continuous_and_within_its_limit():
    t = np.linspace(-3.0, PLANNED.duration_s(60.0) + 3.0, 20001)
    _, speed, acceleration = PLANNED.travel(t)
    assert np.abs(acceleration).max() <= 1.03 * 0.2
    assert np.abs(np.diff(acceleration)).max() <= 1.5 * 0.2 * (t[1] - t[0])  # 0.2 in each of 2 s
    assert np.all((speed >= 0.4 - 1e-9) & (speed <= 1.2 + 1e-9))


S_BEND = Path(
    (
        Segment(5.0, 0.0, 0.0),
        Segment(3.0, 0.0, 0.1),
        Segment(4.0, 0.1, -0.1),
        Segment(3.0, -0.1, 0.0),
        Segment(5.0, 0.0, 0.0),
    )
)


@pytest.mark.parametrize("path", [S_BEND, figure_eight(laps=1)], ids=["S-bend", "eight"])
def test_a_path_and_its_reverse_are_one_curve(path):
    s = np.linspace(0.0, path.length_m, 300)
    forward, backward = path.pose(s), path.reversed().pose(path.length_m - s)
    np.testing.assert_allclose(forward[:, :2], backward[:, :2], atol=1e-9)
    np.testing.assert_allclose(np.cos(forward[:, 2] - backward[:, 2]), -1.0, atol=1e-12)
    np.testing.assert_allclose(
        path.curvature(s), -path.reversed().curvature(path.length_m - s), atol=1e-12
    )


def test_in_reverse_the_exact_model_stays_on_the_reference_for_a_while():
    """In reverse the model is unstable: integration errors grow by a factor e every 2 m."""
    vehicle, path = Vehicle(reverse=True), S_BEND.reversed()
    reference = Reference(path, vehicle, Backward(ConstantSpeed(1.0), path.length_m))
    assert reference.at(0.0).state[-1] == -1.0
    step_s = 0.01
    state = reference.at(0.0).state
    for inputs in reference.at((np.arange(1200) + 0.5) * step_s).inputs:
        state = advance(state, inputs, vehicle, step_s)
    expected = reference.at(12.0)
    np.testing.assert_allclose(state, expected.state, atol=0.02)
    np.testing.assert_allclose(trailer_point(state, vehicle), expected.trailer_xy, atol=0.02)


@pytest.mark.parametrize(
    ("blend", "speed", "message"),
    [
        (0.05, ConstantSpeed(1.0), r"s = .* m \(x = .*front steering would need .* are 55.00"),
        (
            0.5,
            PlannedSpeed(np.array([0.0, 99.0]), np.array([0.6, 1.4]), 0.5),
            "hydrostat would need",
        ),
    ],
)
def test_references_too_fast_for_the_actuators_are_refused_with_their_place(blend, speed, message):
    path = figure_eight(blend_m=blend, laps=1)
    with pytest.raises(InvalidReference, match=message):
        check_pace(Reference(path, Vehicle(), speed), 0.2)


@pytest.mark.parametrize("limit", [0.3, 0.55])
def test_a_limit_holds_in_the_corridor_and_the_desired_speed_far_from_it(profile, limit):
    corridor = Corridor(0.1, ((12.0, 18.0), (40.2, 48.0)))
    slower = limited_in_corridor(profile, 60.0, corridor, limit)
    t = np.linspace(0.0, slower.duration_s(60.0), 20001)
    place, speed, _ = slower.travel(t)
    _, desired, _ = profile.travel(np.linspace(0.0, profile.duration_s(60.0), 20001))
    assert place[0] == pytest.approx(profile.travel(np.zeros(1))[0][0])
    assert np.sign(speed).min() == np.sign(speed).max() == np.sign(desired[0])
    held = np.isfinite(corridor.half_width(place))
    assert np.abs(speed[held]).max() <= limit + 1e-9
    # 2 v a s of distance are needed to brake, and the moving average reaches 1 s ahead.
    far = (place > 25.0) & (place < 31.0)
    unlimited = np.interp(place[far], *sorted_travel(profile))
    assert np.all(np.abs(speed[far]) <= unlimited + 1e-3)
    if unlimited.max() < 0.8:
        np.testing.assert_allclose(np.abs(speed[far]), unlimited, atol=0.12)


def test_in_curves_the_lateral_acceleration_keeps_to_its_limit_and_straights_to_their_speed():
    path = figure_eight(radius_m=10.0, centre_distance_m=60.0, laps=1)
    slower = limited_in_curves(ConstantSpeed(3.0), path, 0.5, 0.3)
    place, speed, along = slower.travel(np.linspace(0.0, slower.duration_s(path.length_m), 20001))
    lateral = speed**2 * np.abs(path.curvature(place))
    assert lateral.max() <= 0.5 * (1.0 + 1e-9)
    assert lateral.max() == pytest.approx(0.5, rel=0.01)  # the limit is used
    assert speed.max() == pytest.approx(3.0)
    assert np.abs(along).max() <= 1.03 * 0.3
    gentle = ConstantSpeed(1.0)
    assert limited_in_curves(gentle, path, 0.5, 0.3) is gentle


def sorted_travel(profile):
    place, speed, _ = profile.travel(np.linspace(0.0, profile.duration_s(60.0), 20001))
    order = np.argsort(place)
    return place[order], np.abs(speed[order])


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


def test_what_cannot_be_driven_is_refused_with_its_place_or_key():
    ones, forward = np.ones(3), ConstantSpeed(1.0)
    for error, word, refused in (
        (InvalidReference, "point 1", lambda: PlannedSpeed(np.arange(3.0), 1.0 - np.arange(3))),
        (InvalidReference, "forward", lambda: PlannedSpeed(np.array([0.0, 4.0, 3.0]), ones)),
        (InvalidReference, "acceleration", lambda: PlannedSpeed(np.arange(3.0), ones, 0.0)),
        (InvalidReference, "lateral", lambda: limited_in_curves(forward, S_BEND, 0.0, 0.1)),
        (InvalidReference, "forward", lambda: Reference(S_BEND, Vehicle(), Backward(forward, 9.0))),
        (InvalidReference, "in rev", lambda: Reference(S_BEND, Vehicle(reverse=True), forward)),
        (InvalidTuning, "half_width_m", lambda: Corridor(0.0)),
        (InvalidTuning, "hitch_limit", lambda: Corridor(0.1, hitch_limit=-1.0)),
        (InvalidTuning, "along_m", lambda: Corridor(0.1, ((0.0, 4.0), (3.0, 5.0)))),
    ):
        with pytest.raises(error, match=word):
            refused()
