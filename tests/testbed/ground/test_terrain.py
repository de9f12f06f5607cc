import math

import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidField
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.terrain import Terrain


def section_spectrum(heights, spacing):
    """Mean one-sided spectrum of the rows: frequency [cycle/m], density [m^3]."""
    n = heights.shape[1]
    window = np.hanning(n)
    rows = (heights - heights.mean(axis=1, keepdims=True)) * window
    power = np.abs(np.fft.rfft(rows, axis=1)) ** 2 * 2.0 * spacing / (window**2).sum()
    return np.fft.rfftfreq(n, spacing), power.mean(axis=0)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("iso_class", "ADF")
def test_sections_are_of_their_iso_class(iso_class, axis):
    spacing = 0.1
    fields = [
        terrain.rough(iso_class, np.random.default_rng(seed), (80.0, 80.0), spacing).heights
        for seed in range(4)
    ]
    heights = np.concatenate([field if axis == 0 else field.T for field in fields])
    frequency, density = section_spectrum(heights, spacing)
    third = 2.0 ** (1.0 / 6.0)  # third-octave bands
    for centre in 0.1 * 2.0 ** np.arange(0.0, 3.34, 1.0 / 3.0):
        band = (frequency >= centre / third) & (frequency < centre * third)
        n = frequency[band]
        expected = terrain.ISO_8608[iso_class] * (n / 0.1) ** -2
        assert density[band].mean() == pytest.approx(expected.mean(), rel=0.25), centre


@pytest.mark.parametrize("shortest", [0.2, 0.5, 1.0])
def test_a_spectrum_reaches_to_its_shortest_wave_and_no_further(shortest):
    spacing = 0.05
    field = terrain.rough(
        "D", np.random.default_rng(1), (80.0, 40.0), spacing, shortest_wave_m=shortest
    )
    frequency, density = section_spectrum(field.heights, spacing)
    expected = terrain.ISO_8608["D"] * (np.maximum(frequency, 0.1) / 0.1) ** -2
    last_octave = (frequency > 0.5 / shortest) & (frequency < 0.9 / shortest)
    beyond = frequency > 1.1 / shortest
    assert density[last_octave].mean() == pytest.approx(expected[last_octave].mean(), rel=0.15)
    assert density[beyond].max() < 1e-3 * expected[beyond].min()


def test_height_is_exact_on_grid_points_and_linear_between():
    field = terrain.rough("E", np.random.default_rng(0), (8.0, 6.0), centre=(3.0, -2.0))
    ny, nx = field.heights.shape
    x = field.origin[0] + field.spacing_m * np.arange(nx)
    y = field.origin[1] + field.spacing_m * np.arange(ny)
    np.testing.assert_allclose(field.height(x, y[:, None]), field.heights, atol=1e-12)
    middle = field.height(0.5 * (x[4] + x[5]), y[7])
    assert middle == pytest.approx(field.heights[7, 4:6].mean())
    assert field.height(x[0] - 5.0, y[3]) == pytest.approx(field.heights[3, 0])


def test_field_lies_around_its_centre_and_knows_its_bounds():
    field = terrain.flat((20.0, 10.0), centre=(5.0, 1.0))
    assert field.centre == pytest.approx((5.0, 1.0))
    assert field.size_m == pytest.approx((20.0, 10.0))
    assert field.contains(14.9, 5.9)
    assert not field.contains(15.1, 1.0)
    assert not field.contains(14.5, 1.0, margin=1.0)
    assert not field.contains(np.array([5.0, 99.0]), np.array([1.0, 1.0]))
    assert not field.contains(math.nan, 0.0)


@pytest.mark.parametrize("uphill", [0.0, 0.5 * math.pi, -2.0])
def test_slope_rises_uphill_by_its_angle(uphill):
    field = terrain.flat((20.0, 10.0)).tilted(0.2, uphill)
    x, y = 2.0 * math.cos(uphill), 2.0 * math.sin(uphill)
    assert field.height(x, y) - field.height(0.0, 0.0) == pytest.approx(2.0 * math.tan(0.2))
    assert field.height(-y, x) == pytest.approx(field.height(0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("name", ["map.npy", "map.csv", "map.txt"])
def test_file_gives_back_what_was_written(tmp_path, name):
    heights = np.round(np.random.default_rng(0).normal(size=(30, 40)), 6)
    path = tmp_path / name
    if name.endswith(".npy"):
        np.save(path, heights)
    else:
        np.savetxt(path, heights, fmt="%.6f", delimiter="," if name.endswith("csv") else " ")
    field = Terrain.from_file(path, 0.5, (1.0, 2.0))
    np.testing.assert_allclose(field.heights, heights)
    assert field.centre == pytest.approx((1.0, 2.0))


@pytest.mark.parametrize(
    "text", ["", "1 2\n3 nan\n", "1 2 3\n", "1 2\n3\n", "1 two\n3 4\n", "1 2\n3 inf\n"]
)
def test_unusable_file_is_refused_in_one_line_that_names_it(tmp_path, text):
    path = tmp_path / "field.csv"
    path.write_text(text)
    with pytest.raises(InvalidField) as caught:
        Terrain.from_file(path, 0.1)
    assert "field.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_three_dimensions_and_objects_are_refused(tmp_path):
    with pytest.raises(InvalidField, match=r"none\.npy"):
        Terrain.from_file(tmp_path / "none.npy", 0.1)
    np.save(tmp_path / "cube.npy", np.zeros((3, 3, 3)))
    with pytest.raises(InvalidField, match="2-D"):
        Terrain.from_file(tmp_path / "cube.npy", 0.1)
    np.save(tmp_path / "object.npy", np.array([[object()]]), allow_pickle=True)
    with pytest.raises(InvalidField):
        Terrain.from_file(tmp_path / "object.npy", 0.1)


@pytest.mark.parametrize(
    "make",
    [
        lambda: terrain.rough("G", np.random.default_rng(0)),
        lambda: terrain.flat((0.0, 50.0)),
        lambda: terrain.flat((math.nan, 50.0)),
        lambda: terrain.flat(spacing_m=0.0),
        lambda: terrain.rough("A", np.random.default_rng(0), spacing_m=0.5),
        lambda: terrain.rough("A", np.random.default_rng(0), shortest_wave_m=0.19),
        lambda: terrain.rough("A", np.random.default_rng(0), shortest_wave_m=20.0),
        lambda: terrain.rough("A", np.random.default_rng(0), shortest_wave_m=math.nan),
        lambda: terrain.flat().tilted(-0.1),
        lambda: terrain.flat().tilted(math.nan),
        lambda: terrain.flat().tilted(0.1, math.inf),
        lambda: Terrain(np.zeros((3, 3)), -1.0, (0.0, 0.0)),
        lambda: Terrain(np.zeros((3, 3)), 1.0, (math.nan, 0.0)),
        lambda: Terrain(np.zeros((1, 3)), 1.0, (0.0, 0.0)),
    ],
)
def test_impossible_fields_are_refused(make):
    with pytest.raises(InvalidField):
        make()
