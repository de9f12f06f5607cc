"""Soil strength: background, layers, tramlines."""

import math

import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidField
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.ground.soil import (
    NAMED_SOILS,
    Gradient,
    Patch,
    RandomStrength,
    SoilMap,
    StrengthMap,
    Tracks,
    Tramlines,
)
from proving_ground.testbed.ground.terrain import Terrain
from pydantic import ValidationError

FIELD = terrain.flat((40.0, 30.0), 0.25)
TRACKS = Tracks(track_m=1.0, width_m=0.3, strength_factor=1.5)
STRAIGHT = np.array([[-10.0, 0.0], [10.0, 0.0]])


def patch(x_m, radius_m, cone_index_kpa):
    return Patch(x_m=x_m, y_m=0.0, radius_m=radius_m, cone_index_kpa=cone_index_kpa)


def test_named_soils_have_their_strength_and_an_unknown_name_is_refused():
    for name, strength in NAMED_SOILS.items():
        assert SoilMap.named(name).cone_index(0.0, 0.0) == strength
    with pytest.raises(InvalidField, match="hard"):
        SoilMap.named("concrete")


def test_the_cone_index_is_that_of_the_nearest_point_and_of_the_border_beyond():
    strength = np.arange(12.0).reshape(3, 4)  # rows along y, columns along x
    ground = Ground(Terrain(np.zeros((3, 4)), 0.5, (10.0, -1.0)), strength)
    x = np.array([10.0, 10.24, 10.26, 11.5, 99.0, -99.0])
    y = np.array([-1.0, -0.76, -0.74, 0.0, 99.0, -99.0])
    expected = strength[[0, 0, 1, 2, 2, 0], [0, 0, 1, 3, 3, 0]]
    np.testing.assert_array_equal(ground.cone_index_at(x, y), expected)


def drawn(seed, cv=0.4, correlation_m=2.0, field=FIELD):
    strength = RandomStrength(coefficient_of_variation=cv, correlation_m=correlation_m)
    return strength.draw(np.random.default_rng(seed), field)


# --- gradient --------------------------------------------------------------------------------


@pytest.mark.parametrize(("first", "second"), [(300.0, 900.0), (900.0, 300.0), (400.0, 400.0)])
def test_a_gradient_is_linear_over_its_distance_and_constant_beyond(first, second):
    gradient = Gradient(
        from_kpa=first,
        to_kpa=second,
        distance_m=20.0,
        x_m=1.0,
        y_m=2.0,
        towards_deg=math.degrees(0.7),
    )
    soil = SoilMap(100.0, (gradient,))
    u = np.linspace(-5.0, 30.0, 71)
    across = 7.0
    x = 1.0 + u * math.cos(0.7) - across * math.sin(0.7)
    y = 2.0 + u * math.sin(0.7) + across * math.cos(0.7)
    expected = first + (second - first) * np.clip(u / 20.0, 0.0, 1.0)
    np.testing.assert_allclose(soil.cone_index(x, y), expected, rtol=1e-12)


# --- random field ----------------------------------------------------------------------------


def test_random_strength_has_its_mean_and_its_coefficient_of_variation():
    # 60 x 45 correlation lengths, 6 draws: some 2000 independent areas, so that the standard
    # error of the mean is 0.4 / sqrt(2000) = 0.009; the bounds are about four of those
    values = np.stack([drawn(seed, correlation_m=0.7).values for seed in range(6)])
    assert values.min() > 0.0
    assert values.mean() == pytest.approx(1.0, abs=0.035)
    assert values.std() / values.mean() == pytest.approx(0.4, rel=0.1)
    logarithm = np.log(values)
    variance = math.log(1.0 + 0.4**2)
    assert logarithm.mean() == pytest.approx(-0.5 * variance, abs=0.035)
    # log-normal: the logarithm is as symmetric as a normal distribution is
    assert ((logarithm - logarithm.mean()) ** 3).mean() / logarithm.std() ** 3 == pytest.approx(
        0.0, abs=0.15
    )


@pytest.mark.parametrize("axis", [0, 1])
def test_correlation_of_the_logarithm_falls_by_e_over_the_correlation_length(axis):
    variance = math.log(1.0 + 0.4**2)
    products = {1.0: [], 2.0: [], 4.0: []}
    for seed in range(30):
        deviation = np.log(drawn(seed).values) + 0.5 * variance
        if axis:
            deviation = deviation.T
        for lag in products:
            cells = round(lag / FIELD.spacing_m)
            products[lag].append((deviation[cells:] * deviation[:-cells]).mean() / variance)
    for lag, values in products.items():
        error = np.std(values) / math.sqrt(len(values))
        assert np.mean(values) == pytest.approx(math.exp(-lag / 2.0), abs=max(3.5 * error, 0.01))
        assert error < 0.03


@pytest.mark.parametrize(("size_m", "spacing_m"), [((12.2, 10.0), 0.2), ((15.25, 10.0), 0.25)])
def test_opposite_edges_of_a_random_field_do_not_correlate(size_m, spacing_m):
    """The torus on which a field is drawn is wider than the field by four correlation lengths."""
    field = terrain.flat(size_m, spacing_m)
    edges = []
    for seed in range(60):
        logarithm = np.log(drawn(seed, correlation_m=2.0, field=field).values)
        edges.append(logarithm[:, [0, 1, -1]])
    first, neighbour, last = np.concatenate(edges).T
    assert abs(np.corrcoef(first, last)[0, 1]) < 0.15
    assert np.corrcoef(first, neighbour)[0, 1] == pytest.approx(
        math.exp(-spacing_m / 2.0), abs=0.05
    )


# --- map -------------------------------------------------------------------------------------


def test_a_map_replaces_the_soil_inside_its_extent(tmp_path):
    values = np.random.default_rng(0).uniform(200.0, 900.0, (9, 13))
    np.save(tmp_path / "map.npy", values)
    layer = StrengthMap.from_file(tmp_path / "map.npy", 0.5, (2.0, -1.0))
    soil = SoilMap(600.0, (layer,))
    x, y = layer.points()
    np.testing.assert_allclose(soil.cone_index(x, y), values)
    assert soil.cone_index(-1.01, -1.0) == 600.0
    assert soil.cone_index(-0.75, -3.0) == pytest.approx(values[0, :2].mean())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("300 400\n500 nan\n", "got nan at row 1, column 1"),
        ("300 -400\n500 600\n", "got -400.0 at row 0, column 1"),
        ("300 400\n500\n", "columns"),
        ("", "2 x 2 or larger"),
    ],
)
def test_an_unusable_map_is_refused_in_one_line_that_names_it(tmp_path, text, message):
    file = tmp_path / "soil.csv"
    file.write_text(text)
    with pytest.raises(InvalidField) as caught:
        StrengthMap.from_file(file, 0.5)
    assert str(caught.value).startswith("soil map file")
    assert message in str(caught.value)
    assert "soil.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


# --- layers ----------------------------------------------------------------------------------


# --- tramlines -------------------------------------------------------------------------------


def factor(tramlines, x, y):
    return SoilMap(1.0, (tramlines,)).cone_index(x, y)


def test_tracks_lie_left_and_right_of_the_line_and_nowhere_else():
    tramlines = Tramlines((STRAIGHT,), TRACKS)
    y = np.array([-0.7, -0.64, -0.5, -0.36, 0.0, 0.36, 0.5, 0.64, 0.7])
    for x in (-9.0, 0.013, 3.3):
        np.testing.assert_array_equal(factor(tramlines, x, y) > 1.0, abs(abs(y) - 0.5) < 0.15)
    assert factor(tramlines, 10.2, 0.5) == 1.0


def test_tracks_cover_two_widths_of_ground_and_end_round():
    ground = terrain.flat((24.0, 24.0), 0.05)
    tracks = Tracks(track_m=1.0, width_m=0.4, strength_factor=2.0)
    turned = STRAIGHT[:, :1] * np.array([math.cos(0.3), math.sin(0.3)])
    angle = np.linspace(0.0, 2.0 * math.pi, 300)
    circle = 8.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    for line, length, ends in ((turned, 20.0, 2), (circle, 2.0 * math.pi * 8.0, 0)):
        raster = SoilMap(400.0, (Tramlines((line,), tracks),)).rasterised(ground)
        assert set(np.unique(raster)) == {400.0, 800.0}
        area = 2.0 * 0.4 * length + ends * math.pi * 0.2**2
        assert (raster > 400.0).sum() * 0.05**2 == pytest.approx(area, rel=0.02)


def test_crossing_tracks_of_one_kind_count_once_and_two_kinds_twice():
    across = STRAIGHT[:, ::-1]
    once = Tramlines((STRAIGHT, across), TRACKS)
    assert factor(once, 0.5, 0.5) == 1.5
    loose = Tramlines((across,), Tracks(track_m=1.0, strength_factor=0.5))
    twice = SoilMap(1.0, (once, loose))
    assert twice.cone_index(0.5, 0.5) == 0.75


# --- refusals --------------------------------------------------------------------------------


def test_impossible_layers_are_refused_by_their_keys():
    gradient = {"from_kpa": 300.0, "to_kpa": 900.0, "distance_m": 1.0}
    centre = {"x_m": 0.0, "y_m": 0.0, "radius_m": 1.0, "cone_index_kpa": 100.0}
    for kind, values, key in (
        (Gradient, gradient | {"distance_m": 0.0}, "distance_m"),
        (Gradient, gradient | {"to_kpa": math.nan}, "to_kpa"),
        (Patch, centre | {"cone_index_kpa": 0.0}, "cone_index_kpa"),
        (Patch, centre | {"x_m": math.inf}, "x_m"),
        (RandomStrength, {"coefficient_of_variation": -0.1}, "coefficient_of_variation"),
        (Tracks, {"width_m": 0.0}, "width_m"),
        (Tracks, {"track_m": 1.0, "width_m": 1.1}, r"1\.1 m wide and 1\.0 m apart"),
        (Tracks, {"strength_factor": math.inf}, "strength_factor"),
    ):
        with pytest.raises(ValidationError, match=key):
            kind(**values)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SoilMap(-5.0), "cone index"),
        (lambda: SoilMap(math.nan), "cone index"),
        (lambda: drawn(0, 0.3, 0.1), "random soil"),
        (lambda: drawn(0, 0.3, 99.0), "random soil"),
        (lambda: Tramlines((STRAIGHT[:1],), TRACKS), "tramlines"),
        (lambda: Tramlines((STRAIGHT[[0, 0]],), TRACKS), "tramlines"),
        (lambda: Tramlines((STRAIGHT * math.nan,), TRACKS), "tramlines"),
        (lambda: Tramlines((), TRACKS), "tramlines"),
        (
            lambda: SoilMap(1.0, (Tramlines((STRAIGHT,), Tracks(width_m=0.05)),)).rasterised(FIELD),
            r"soil: got tramlines 0\.05 m wide",
        ),
    ],
)
def test_what_fits_no_field_is_refused(make, message):
    with pytest.raises(InvalidField, match=message):
        make()
