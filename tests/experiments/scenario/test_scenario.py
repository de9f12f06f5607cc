import json

import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.scenario.path import FigureEight, Straight
from proving_ground.experiments.scenario.scenario import (
    FILE_KEYS,
    Scenario,
    dump,
    load,
    shipped,
)
from proving_ground.experiments.scenario.schema import json_schema


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenarios_survive_being_written_out_and_read_back(name, tmp_path):
    scenario = load(name)[1]
    file = tmp_path / "copy.toml"
    file.write_text(dump(scenario))
    assert load(str(file)) == ("copy", scenario)


def test_the_paper_s_sensors_and_path_are_the_default():
    scenario = Scenario()
    assert scenario.path == FigureEight(
        radius_m=10.0, centre_distance_m=30.0, blend_m=2.0, laps=2, speed_mps=1.0
    )
    assert (scenario.sensors.gnss_sd_m, scenario.sensors.angle_sd_deg) == (0.03, 1.0)


def test_overrides_lie_over_the_file_and_leave_the_rest():
    plain = load("wet-slope")[1]
    changed = load("wet-slope", ["soil.cone_index_kpa=250", "path.laps=1"])[1]
    assert changed.soil.cone_index_kpa == 250.0
    assert changed.path.laps == 1
    assert changed.terrain == plain.terrain


def test_a_path_of_another_kind_replaces_the_figure_eight():
    assert load("grass", ["path={kind='straight', length_m=30}"])[1].path == Straight(length_m=30.0)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "soil.cone_index_kpa=-3",
            "soil.cone_index_kpa: Input should be greater than or equal to 1",
        ),
        ("soil.cone_index_kpa=nan", "soil.cone_index_kpa: Input should be a finite number"),
        ("path.radius_m=inf", "path.radius_m: Input should be a finite number"),
        ("path.radius_m='wide'", "path.radius_m: Input should be a valid number, got 'wide'"),
        ("path.laps=1.5", "path.laps: Input should be a valid integer, got 1.5"),
        ("path.kind='ring'", "path: Input tag 'ring' found using 'kind'"),
        (
            "soil.softness=3",
            "soil.softness: unknown key; allowed here: name, cone_index_kpa",
        ),
        ("path.length_m=3", "path.length_m: unknown key; allowed here: kind, radius_m"),
        ("tyres.width_m=1", "tyres: unknown key; allowed here: description, path, corridor"),
        ("soil.patches=[{x_m=1.0, y_m=2.0}]", "soil.patches.0.radius_m: Field required"),
        ("plant.vehicle.load_kg=true", "plant.vehicle.load_kg: Input should be a valid number"),
        ("terrain.iso_class='G'", "terrain.iso_class: Input should be 'A', 'B', 'C'"),
        (
            "terrain.features=[{x_m=1.0}]",
            "terrain.features.0: kind is missing, must be one of rise,",
        ),
        ("terrain.features=[{kind='hole'}]", "terrain.features.0: Input tag 'hole' found using"),
        (
            "terrain.features=[{kind='furrows', period_m=0.8, depth_m=0.1}, {kind='step', x_m=1}]",
            "terrain.features.1.y_m: Field required",
        ),
        (
            "terrain.features=[{kind='furrows', period_m=0.8, deep_m=0.1, depth_m=0.1}]",
            "terrain.features.0.deep_m: unknown key; allowed here: kind, period_m, depth_m, along",
        ),
        (
            "terrain.features=[{kind='bump', x_m=1, y_m=1, height_m=0.1, width_m=-1}]",
            "terrain.features.0.width_m: Input should be greater than or equal to 0.001, got -1",
        ),
        (
            "terrain.features=[{kind='rise', x_m=nan, y_m=0, slope_rad=0.1, length_m=9}]",
            "terrain.features.0.x_m: Input should be a finite number",
        ),
        ("soil.tramlines=[{kind='path', wide_m=1}]", "soil.tramlines.0.wide_m: unknown key; allo"),
        ("soil.tramlines=[{kind='line'}]", "soil.tramlines.0.points_m: Field required"),
        ("soil.gradient={from_kpa=300}", "soil.gradient.to_kpa: Field required"),
        ("soil.gradient={from=300}", "soil.gradient.from: unknown key; allowed here: from_kpa, to"),
        ("soil.random={correlation_m=-2}", "soil.random.correlation_m: Input should be greater"),
        ("soil.map={file='a.npy'}", "soil.map.spacing_m: Field required"),
        ("soil.name='moist'", "soil: got name 'moist' and cone_index_kpa 600, give one of the two"),
        ("soil.map=3", "soil.map: Input should be"),
        ("actuators.front.dead_time_s=-0.1", "actuators.front.dead_time_s: Input should be gr"),
        ("actuators.trailer.dead_time_s=3", "actuators.trailer.dead_time_s: Input should be less"),
        ("actuators.front.play_deg=1", "actuators.front.play_deg: unknown key; allowed here: dead"),
        ("actuators.hydrostat.dead_band_deg=1", "unknown key; allowed here: dead_time_s"),
        ("sensors.gnss_latency_s=2.5", "sensors.gnss_latency_s: Input should be less than or equ"),
        ("sensors.gnss_resolution_m=-1", "sensors.gnss_resolution_m: Input should be greater"),
        ("sensors.gnss_correlation_time_s=0", "sensors.gnss_correlation_time_s: Input should be g"),
        ("sensors.gnss_error='pink'", "sensors.gnss_error: Input should be 'white', 'correlated'"),
        ("sensors.preset='lab'", "sensors.preset: Input should be 'paper' or 'field', got 'lab'"),
        ("sensors.preset=[1]", "sensors.preset: Input should be 'paper' or 'field', got [1]"),
        ("controller.noise.gnss_sd_m=0", "controller.noise.gnss_sd_m: Input should be greater"),
        ("controller.noise.assumed='true'", "controller.noise.assumed: Input should be 'sensors'"),
        ("controller.noise.hitch=1", "controller.noise.hitch: unknown key; allowed here: assumed"),
        ("sensors.imu.on=1", "sensors.imu.on: Input should be a valid boolean, got 1"),
        (
            "sensors.gnss_antenna='corrected'",
            "sensors: gnss_antenna 'corrected' needs the attitude",
        ),
        (
            "terrain.features=[{kind='step', x_m=1, y_m=1, height_m=0.3, ramp_m=0.2}]",
            "terrain.features.0: got height_m 0.3 over a flank of 0.2 m, must be at most",
        ),
        (
            "soil.tramlines=[{kind='path', track_m=0.2}]",
            "soil.tramlines.0: got tracks 0.3 m wide and 0.2 m apart, the width must be",
        ),
        ("terrain", "--set terrain: must be key.key=value"),
    ],
)
def test_a_refusal_names_key_value_and_allowed_values_in_one_line(override, message):
    with pytest.raises(InvalidScenario) as caught:
        load("grass", [override])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["gras", "nowhere.toml"])
def test_a_missing_scenario_is_refused_with_the_shipped_names(name):
    with pytest.raises(InvalidScenario, match="shipped are cultivate, farm, furrows, grass"):
        load(name)


def test_a_torn_file_is_refused(tmp_path):
    file = tmp_path / "torn.toml"
    file.write_text("[soil\ncone_index_kpa = 3")
    with pytest.raises(InvalidScenario, match=r"torn\.toml: cannot be read as TOML"):
        load(str(file))


def test_a_name_in_a_change_needs_no_quotation_marks():
    quoted = load("grass", ['controller.name="paper"', 'terrain.iso_class="B"'])
    assert load("grass", ["controller.name=paper", "terrain.iso_class=B"]) == quoted


def test_a_path_in_a_change_starts_where_the_user_stands(tmp_path, monkeypatch):
    (tmp_path / "field.csv").write_text("x,y\n-20,0\n0,0\n20,0\n")
    monkeypatch.chdir(tmp_path)
    for line in ("path={kind='file', file='field.csv'}", "path={kind='file', file='./field.csv'}"):
        assert load("grass", [line])[1].path.file == str(tmp_path / "field.csv")
    assert load("grass", ["terrain.height_map=h.npy"])[1].terrain.height_map == str(
        tmp_path / "h.npy"
    )


def test_the_keys_of_files_are_those_whose_paths_the_schema_marks():
    def marked(table):
        for key, value in table.get("properties", {}).items():
            if '"format": "path"' in json.dumps(value):
                yield key

    schema = json_schema()
    found = {key for table in schema["$defs"].values() for key in marked(table)}
    assert found == set(FILE_KEYS)


def test_a_refused_change_names_the_change_and_not_the_file():
    with pytest.raises(InvalidScenario, match=r"^--set: path\.laps"):
        load("grass", ["path.laps=0"])


def test_another_kind_of_path_drops_the_keys_of_the_kind_in_the_file(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[path]\nradius_m = 9.0\nspeed_mps = 0.8\n")
    assert load(str(file), ["path.kind=straight"])[1].path == Straight()


def test_a_fault_of_the_file_is_told_before_the_change(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[path]\nlaps = 0\n")
    with pytest.raises(InvalidScenario, match=r"mine\.toml: path.laps"):
        load(str(file), ["soil.cone_index_kpa=300"])


@pytest.mark.parametrize(
    ("name", "overrides", "meant"),
    [
        ("gras", [], "grass"),
        ("grass", ["soil.patchs=[]"], "patches"),
        ("grass", ["laps=1"], "path.laps"),
        ("grass", ["path.cone_index_kpa=250"], "soil.cone_index_kpa"),
        ("grass", ["gnss_sd_m=0.1"], "sensors.gnss_sd_m"),
    ],
)
def test_a_misspelt_name_gets_a_suggestion(name, overrides, meant):
    with pytest.raises(InvalidScenario, match=rf"\(did you mean {meant}\?\)$"):
        load(name, overrides)
