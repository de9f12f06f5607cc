import math

import numpy as np
import pytest

from proving_ground.testbed.errors import InvalidField
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import NAMED_SOILS, SoilMap
from proving_ground.testbed.ground.soil_layers import Patch


def test_uniform_soil_is_the_same_everywhere():
    x = np.linspace(-9.0, 9.0, 7)
    np.testing.assert_array_equal(SoilMap(450.0).cone_index(x, x[:, None]), np.full((7, 7), 450.0))


def test_named_soils_are_finite_and_unknown_names_are_told_with_what_is_allowed():
    for name, strength in NAMED_SOILS.items():
        assert SoilMap.named(name).cone_index(0.0, 0.0) == strength
    with pytest.raises(InvalidField, match="hard"):
        SoilMap.named("concrete")


def test_later_patch_holds_where_patches_overlap():
    soil = SoilMap(600.0, (Patch.circle(0.0, 0.0, 2.0, 300.0), Patch.circle(1.5, 0.0, 1.0, 150.0)))
    values = soil.cone_index(np.array([-1.0, 1.0, 2.4, 9.0]), np.zeros(4))
    np.testing.assert_array_equal(values, [300.0, 150.0, 150.0, 600.0])


def test_ellipse_turns_counter_clockwise_with_its_angle():
    patch = Patch(1.0, 2.0, 3.0, 0.5, 200.0, angle=0.25 * math.pi)
    soil = SoilMap(600.0, (patch,))
    reach = 2.5 / math.sqrt(2.0)
    assert soil.cone_index(1.0 + reach, 2.0 + reach) == 200.0
    assert soil.cone_index(1.0 + reach, 2.0 - reach) == 600.0


def test_raster_is_the_map_at_the_terrain_grid():
    ground = terrain.flat((12.0, 8.0), 0.2, (3.0, 1.0))
    soil = SoilMap(500.0, (Patch(2.0, 1.0, 2.0, 1.0, 120.0, 0.3),))
    raster = soil.rasterised(ground)
    assert raster.shape == ground.heights.shape
    rng = np.random.default_rng(0)
    for _ in range(50):
        row, column = rng.integers(raster.shape[0]), rng.integers(raster.shape[1])
        x = ground.origin[0] + 0.2 * column
        y = ground.origin[1] + 0.2 * row
        assert raster[row, column] == soil.cone_index(x, y)


@pytest.mark.parametrize("value", [0.0, -5.0, math.nan, math.inf])
def test_impossible_strength_is_refused(value):
    with pytest.raises(InvalidField, match="cone index"):
        SoilMap(value)
    with pytest.raises(InvalidField, match="cone index"):
        Patch.circle(0.0, 0.0, 1.0, value)


@pytest.mark.parametrize(
    "values", [(math.nan, 0, 1, 1), (0, math.inf, 1, 1), (0, 0, 0, 1), (0, 0, 1, -1)]
)
def test_impossible_patch_is_refused(values):
    with pytest.raises(InvalidField):
        Patch(*values, cone_index=100.0)
