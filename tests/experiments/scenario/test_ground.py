"""Ground of a scenario: files, soil layers and terrain features."""

import math

import numpy as np
import pytest
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.scenario.scenario import dump, load

EVERYTHING = """
[terrain]
iso_class = "flat"
height_map = "heights.csv"
spacing_m = 1.0
features = [
    { kind = "rise", x_m = 10, y_m = 0, slope_rad = -0.1, length_m = 10 },
    { kind = "furrows", period_m = 8.0, depth_m = 0.2, along_deg = 30 },
    { kind = "bump", x_m = 10, y_m = 5, height_m = 0.1, width_m = 4.0, profile = "cylinder" },
    { kind = "ditch", x_m = -10, y_m = 5, depth_m = 0.1, width_m = 4.0, length_m = 9.0 },
    { kind = "step", x_m = 20, y_m = 5, height_m = 0.3, ramp_m = 2.0, uphill_deg = -45 },
]

[soil]
name = "wet"
patches = [{ x_m = -20.0, y_m = 10.0, radius_m = 3.0, cone_index_kpa = 150.0 }]
gradient = { from_kpa = 300.0, to_kpa = 900.0, distance_m = 20.0 }
map = { file = "maps/strength.npy", spacing_m = 1.0 }
random = {}
tramlines = [
    { kind = "path", width_m = 1, track_m = 1.5 },
    { kind = "line", points_m = [[-30, -20], [0, -15], [30, -20]], width_m = 1, track_m = 1.5 },
]
"""


@pytest.fixture
def folder(tmp_path):
    """A scenario with every kind of layer and feature, and its files beside it."""
    (tmp_path / "field.toml").write_text(EVERYTHING)
    (tmp_path / "maps").mkdir()
    rng = np.random.default_rng(0)
    np.save(tmp_path / "maps" / "strength.npy", rng.uniform(400.0, 500.0, (37, 67)))
    np.savetxt(tmp_path / "heights.csv", rng.normal(0.0, 0.01, (51, 81)), delimiter=",")
    return tmp_path


def test_files_are_found_beside_the_scenario_and_again_from_its_resolved_copy(
    folder, tmp_path_factory, monkeypatch
):
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    scenario = load(str(folder / "field.toml"))[1]
    copy = tmp_path_factory.mktemp("run") / "scenario.toml"
    copy.write_text(dump(scenario))
    assert load(str(copy))[1] == scenario
    ground, again = (assemble(load(str(file))[1], 4) for file in (folder / "field.toml", copy))
    assert np.array_equal(ground.terrain.heights, again.terrain.heights)
    soils = [each.plant.soil.rasterised(each.terrain) for each in (ground, again)]
    assert np.array_equal(*soils)


def test_layers_lie_in_the_stated_order(folder):
    assembly = assemble(load(str(folder / "field.toml"))[1], 4)
    names = [type(layer).__name__ for layer in assembly.plant.soil.layers]
    assert names == ["Gradient", "StrengthMap", "RandomField", "Patch", *["Tramlines"] * 2]


def test_a_map_covers_the_gradient_and_tramlines_multiply_a_patch(folder):
    settings = ["soil.random={coefficient_of_variation=0.0}"]
    assembly = assemble(load(str(folder / "field.toml"), settings)[1], 0)
    soil, path = assembly.plant.soil, assembly.reference.path
    x, y, yaw = path.pose(0.0)
    left = x - 0.75 * math.sin(yaw), y + 0.75 * math.cos(yaw)
    assert 600.0 <= soil.cone_index(*left) <= 750.0
    assert 400.0 <= soil.cone_index(x, y) <= 500.0
    assert soil.cone_index(39.0, 24.0) == 900.0
    assert soil.cone_index(-20.0, 12.0) == 150.0


def test_random_soil_follows_the_seed_and_leaves_the_terrain_alone():
    varied = ["soil.random={correlation_m=3.0}"]
    plain, one, other = (
        assemble(load("grass", settings)[1], seed)
        for settings, seed in (([], 1), (varied, 1), (varied, 2))
    )
    assert np.array_equal(plain.terrain.heights, one.terrain.heights)
    strength, others = (a.plant.soil.rasterised(a.terrain) for a in (one, other))
    assert not np.array_equal(strength, others)
    assert strength.std() > 50.0
