import math

import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidField
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.features import Bump, Ditch, Furrows, Rise, Step
from pydantic import ValidationError

UPHILL = {"x_m": 1.0, "y_m": -2.0, "uphill_deg": math.degrees(0.4)}
LINE = {"x_m": 1.0, "y_m": -2.0, "along_deg": math.degrees(0.4), "width_m": 0.8, "length_m": 3.0}
FURROWS = Furrows(period_m=0.8, depth_m=0.1, along_deg=math.degrees(1.1))
FEATURES = (
    Rise(**UPHILL, slope_rad=0.2, length_m=8.0),
    Rise(**UPHILL, slope_rad=-0.2, length_m=4.0),
    FURROWS,
    Bump(**LINE, height_m=0.1),
    Bump(**LINE, height_m=0.4, profile="cylinder"),
    Ditch(**LINE, depth_m=0.4),
    Step(**UPHILL, height_m=-0.15, ramp_m=0.3),
)


def on_line(feature, direction, distances):
    """Heights of a feature at (1, -2) at distances from there in a direction."""
    distances = np.asarray(distances, dtype=float)
    return feature.height(
        1.0 + math.cos(direction) * distances, -2.0 + math.sin(direction) * distances
    )


def test_features_add_up_in_any_order():
    ground = terrain.rough("D", np.random.default_rng(0), (20.0, 16.0))
    x, y = ground.points()
    total = ground.heights + sum(feature.height(x, y) for feature in FEATURES)
    np.testing.assert_allclose(ground.shaped(FEATURES).heights, total, atol=1e-12)
    np.testing.assert_allclose(ground.shaped(FEATURES[::-1]).heights, total, atol=1e-12)


@pytest.mark.parametrize("slope", [0.2, -0.2])
def test_a_rise_turns_smoothly_into_its_slope_and_back(slope):
    rise = Rise(**UPHILL, slope_rad=slope, length_m=8.0)
    heights = on_line(rise, 0.4, [-5.0, 0.0, 2.0, 4.0, 6.0, 8.0, 50.0])
    grade = math.tan(slope)
    np.testing.assert_allclose(heights, grade * np.array([0, 0, 1, 3, 5, 6, 6]), atol=1e-12)
    fine = np.linspace(-1.0, 9.0, 10_001)
    slopes = np.diff(on_line(rise, 0.4, fine)) / 1e-3
    assert np.abs(slopes).max() == pytest.approx(abs(grade), rel=1e-6)
    # no edge: the slope changes by at most tan(slope) / rounding per metre
    assert np.abs(np.diff(slopes)).max() / 1e-3 == pytest.approx(abs(grade) / 2.0, rel=1e-3)
    np.testing.assert_allclose(on_line(rise, 0.4 + 0.5 * math.pi, [-9.0, 9.0]), 0.0, atol=1e-12)


def test_furrows_repeat_after_their_period_and_are_as_deep_as_stated():
    across, along = 1.1 - 0.5 * math.pi, 1.1
    u = np.linspace(0.0, 0.8, 81)
    profile = FURROWS.height(u * math.cos(across), u * math.sin(across))
    np.testing.assert_allclose(profile, 0.05 * np.cos(2.0 * math.pi * u / 0.8), atol=1e-12)
    assert np.ptp(profile) == pytest.approx(0.1)
    ridge = FURROWS.height(u * math.cos(along), u * math.sin(along))
    np.testing.assert_allclose(ridge, 0.05, atol=1e-12)


@pytest.mark.parametrize(
    ("bump", "height"), [(Bump(**LINE, height_m=0.1), 0.1), (Ditch(**LINE, depth_m=0.1), -0.1)]
)
def test_a_cosine_bump_is_half_as_high_half_way_and_ends_level(bump, height):
    heights = on_line(bump, 0.4 + 0.5 * math.pi, [-0.41, -0.4, -0.2, 0.0, 0.2, 0.4, 9.0])
    np.testing.assert_allclose(heights, height * np.array([0, 0, 0.5, 1, 0.5, 0, 0]), atol=1e-12)


@pytest.mark.parametrize("height", [0.1, 0.4])
def test_a_cylinder_bump_lies_on_a_circle(height):
    bump = Bump(**LINE, height_m=height, profile="cylinder")
    u = np.linspace(-0.4, 0.4, 41)
    heights = on_line(bump, 0.4 + 0.5 * math.pi, u)
    assert heights[[0, 20, 40]] == pytest.approx([0.0, height, 0.0], abs=1e-7)
    radius = (0.4**2 + height**2) / (2.0 * height)
    np.testing.assert_allclose(np.hypot(u, heights + radius - height), radius, rtol=1e-7)


def test_a_bump_has_its_length_round_ends_and_is_round_without_length():
    long, short = (Bump(**(LINE | {"length_m": length}), height_m=0.1) for length in (3.0, 0.0))
    np.testing.assert_allclose(on_line(long, 0.4, [0.0, 1.5, 1.7, 1.9]), [0.1, 0.1, 0.05, 0.0])
    for direction in np.linspace(0.0, 6.0, 7):
        assert on_line(short, direction, [0.2]) == pytest.approx(0.05)


@pytest.mark.parametrize("rise", [0.1, -0.1])
def test_a_step_climbs_along_its_ramp_and_stays(rise):
    step = Step(**UPHILL, height_m=rise, ramp_m=0.2)
    heights = on_line(step, 0.4, [-3.0, 0.0, 0.05, 0.1, 0.2, 30.0])
    np.testing.assert_allclose(heights, rise * np.array([0, 0, 0.25, 0.5, 1, 1]), atol=1e-12)


def test_features_that_do_not_fit_the_field_or_its_grid_are_refused_in_one_line():
    at = {"x_m": 0.0, "y_m": 0.0}
    for feature, start in (
        (Bump(x_m=99.0, y_m=0.0, width_m=0.8, height_m=0.1), "bump: got a place at (99.0, 0.0) m"),
        (Rise(x_m=0.0, y_m=-9.0, slope_rad=0.1, length_m=8.0), "rise: got a place"),
        (Step(x_m=-11.0, y_m=0.0, height_m=0.1, ramp_m=0.5), "step: got a place"),
        (Step(**at, height_m=0.1, ramp_m=0.1), "step: rises over 0.1 m, must be 0.2 m"),
        (Bump(**at, width_m=0.3, height_m=0.1), "bump: rises over 0.15 m"),
        (Furrows(period_m=0.3, depth_m=0.1), "furrows: rises over 0.15 m"),
        (Rise(**at, slope_rad=0.1, length_m=8.0, rounding_m=0.1), "rise: rises over 0.1 m"),
    ):
        with pytest.raises(InvalidField) as caught:
            terrain.flat((20.0, 16.0)).shaped((feature,))
        assert str(caught.value).startswith(start)
        assert "\n" not in str(caught.value)


def test_impossible_features_are_refused_by_their_keys():
    for kind, values, key in (
        (Rise, {**UPHILL, "slope_rad": 0.1, "length_m": 3.0}, "rounding_m 2.0"),
        (Rise, {**UPHILL, "slope_rad": 0.7, "length_m": 8.0}, "slope_rad"),
        (Rise, {**UPHILL, "y_m": math.nan, "slope_rad": 0.1, "length_m": 8.0}, "y_m"),
        (Furrows, {"period_m": 1.0, "depth_m": 0.6}, "depth_m 0.6"),
        (Bump, {**LINE, "length_m": -1.0, "height_m": 0.1}, "length_m"),
        (Bump, {**LINE, "height_m": 0.5}, "height_m 0.5"),
        (Bump, {**LINE, "height_m": 0.1, "profile": "square"}, "profile"),
        (Ditch, {**LINE, "depth_m": 0.5}, "depth_m 0.5"),
        (Step, {**UPHILL, "height_m": -0.3, "ramp_m": 0.2}, "height_m -0.3"),
    ):
        with pytest.raises(ValidationError, match=key):
            kind(**values)
