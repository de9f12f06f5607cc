import math

import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidField
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import NAMED_SOILS, Patch, SoilMap
from pydantic import ValidationError


def patch(x_m, radius_m, cone_index_kpa):
    return Patch(x_m=x_m, y_m=0.0, radius_m=radius_m, cone_index_kpa=cone_index_kpa)


def test_uniform_soil_is_the_same_everywhere():
    x = np.linspace(-9.0, 9.0, 7)
    np.testing.assert_array_equal(SoilMap(450.0).cone_index(x, x[:, None]), np.full((7, 7), 450.0))


def test_named_soils_have_their_strength_and_an_unknown_name_is_refused():
    for name, strength in NAMED_SOILS.items():
        assert SoilMap.named(name).cone_index(0.0, 0.0) == strength
    with pytest.raises(InvalidField, match="hard"):
        SoilMap.named("concrete")


def test_later_patch_holds_where_patches_overlap():
    soil = SoilMap(600.0, (patch(0.0, 2.0, 300.0), patch(1.5, 1.0, 150.0)))
    values = soil.cone_index(np.array([-1.0, 1.0, 2.4, 9.0]), np.zeros(4))
    np.testing.assert_array_equal(values, [300.0, 150.0, 150.0, 600.0])


def test_raster_is_the_map_at_the_terrain_grid():
    ground = terrain.flat((12.0, 8.0), 0.2, (3.0, 1.0))
    soil = SoilMap(500.0, (Patch(x_m=2.0, y_m=1.0, radius_m=1.5, cone_index_kpa=120.0),))
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
    with pytest.raises(ValidationError, match="cone_index_kpa"):
        patch(0.0, 1.0, value)


@pytest.mark.parametrize(("x_m", "radius_m"), [(math.nan, 1.0), (math.inf, 1.0), (0.0, 0.0)])
def test_impossible_patch_is_refused(x_m, radius_m):
    with pytest.raises(ValidationError):
        patch(x_m, radius_m, 100.0)
