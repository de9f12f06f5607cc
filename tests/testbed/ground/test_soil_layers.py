import itertools
import math

import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidField
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import Gradient, Patch, RandomStrength, SoilMap, StrengthMap
from proving_ground.testbed.randomness import generator
from pydantic import ValidationError

FIELD = terrain.flat((40.0, 30.0), 0.25)


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


def test_opposite_edges_are_uncorrelated():
    pairs = np.array([drawn(seed).values[::8][:, [0, -1]] for seed in range(40)])
    west, east = np.log(pairs).reshape(-1, 2).T
    assert abs(np.corrcoef(west, east)[0, 1]) < 0.15


def test_no_variation_is_no_change():
    soil = SoilMap(450.0, (drawn(0, cv=0.0),))
    np.testing.assert_allclose(soil.rasterised(FIELD), 450.0, rtol=1e-12)


def test_the_seed_alone_decides_and_does_not_touch_the_terrain():
    strength = RandomStrength(correlation_m=2.0)
    fields = [strength.draw(generator(s, "soil"), FIELD).values for s in (1, 1, 2)]
    assert np.array_equal(fields[0], fields[1])
    assert not np.array_equal(fields[0], fields[2])


@pytest.mark.parametrize("cv", [-0.1, math.nan, 3.0])
def test_impossible_coefficients_of_variation_are_refused(cv):
    with pytest.raises(ValidationError, match="coefficient_of_variation"):
        drawn(0, cv)


@pytest.mark.parametrize("length", [0.1, 99.0])
def test_correlation_lengths_that_do_not_fit_the_grid_are_refused(length):
    with pytest.raises(InvalidField, match="random soil"):
        drawn(0, 0.3, length)


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
        ("300 400\n500 0\n", "got 0.0 at row 1, column 1, every cone index must be above 0 kPa"),
        ("300 -400\n500 600\n", "got -400.0 at row 0, column 1"),
        ("300 400\n500\n", "columns"),
        ("300 400\n", "2 x 2 or larger"),
        ("300 ,\n400 500\n", "columns"),
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


def test_layers_lie_on_each_other_in_their_order():
    patch = Patch(x_m=0.0, y_m=0.0, radius_m=3.0, cone_index_kpa=150.0)
    gradient = Gradient(from_kpa=300.0, to_kpa=900.0, distance_m=10.0, x_m=-5.0)
    factors = drawn(3)
    places = np.array([0.0, 4.0]), np.zeros(2)
    for order in itertools.permutations((patch, gradient, factors)):
        expected = np.full(2, 700.0)
        for layer in order:
            if layer is patch:
                expected[0] = 150.0
            elif layer is gradient:
                expected = np.array([600.0, 840.0])
            else:
                expected = expected * factors.at(*places)
        np.testing.assert_allclose(SoilMap(700.0, order).cone_index(*places), expected)


def test_raster_of_all_layers_is_the_map_at_the_grid_s_points():
    layers = (
        Gradient(from_kpa=300.0, to_kpa=900.0, distance_m=10.0, x_m=-5.0, towards_deg=17.0),
        StrengthMap(np.full((5, 5), 500.0), 1.0, (-2.0, -2.0)),
        drawn(1),
        Patch(x_m=2.0, y_m=1.0, radius_m=1.5, cone_index_kpa=120.0),
    )
    soil = SoilMap(500.0, layers)
    raster = soil.rasterised(FIELD)
    x, y = FIELD.points()
    for row, column in np.random.default_rng(0).integers(0, (121, 161), (40, 2)):
        assert raster[row, column] == soil.cone_index(x[column], y[row, 0])


def test_patches_finer_than_the_grid_are_refused():
    patch = Patch(x_m=0.0, y_m=0.0, radius_m=0.1, cone_index_kpa=100.0)
    with pytest.raises(InvalidField, match=r"soil: got patch 0\.2 m wide"):
        SoilMap(500.0, (patch,)).rasterised(FIELD)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("x_m", math.nan),
        ("towards_deg", math.inf),
        ("distance_m", 0.0),
        ("from_kpa", -300.0),
        ("to_kpa", math.nan),
    ],
)
def test_impossible_gradients_are_refused(key, value):
    values = {"from_kpa": 300.0, "to_kpa": 900.0, "distance_m": 1.0}
    with pytest.raises(ValidationError, match=key):
        Gradient(**(values | {key: value}))
