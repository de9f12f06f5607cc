"""Scenario files: round trips, changes over a file, refusals, schema and reference of the keys."""

import math
import re
import tomllib

import jsonschema
import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.scenario.scenario import (
    dump,
    load,
    merge_tables,
    parse_overrides,
    read_scenario,
    shipped,
)
from proving_ground.experiments.scenario.schema import json_schema, scenario_reference

from ttempc.guidance.controllers import CONTROLLERS, controller_options

VALUES = """
soil.cone_index_kpa=-3  soil.cone_index_kpa=nan  path.radius_m=inf  path.radius_m='wide'
path.laps=1.5  plant.vehicle.load_kg=true  terrain.iso_class='G'  soil.map=3
actuators.front.dead_time_s=-0.1  actuators.trailer.dead_time_s=3  sensors.gnss_latency_s=2.5
sensors.gnss_resolution_m=-1  sensors.gnss_correlation_time_s=0  sensors.gnss_error='pink'
sensors.preset='lab'  sensors.preset=[1]  controller.noise.gnss_sd_m=0  sensors.imu.on=1
controller.noise.assumed='true'  control.rate_hz=4.0  control.rate_hz=101.0  control.rate_hz=nan
controller.options.horizon=2.5  controller.options.horizon=0  controller.options.robust='no'
controller.options.step_weight=[1.0]  controller.estimator='ukf'  path.speed_mps=0
controller.vehicle.hydrostat_dead_time_s=2.5  controller.vehicle.front_limit_deg=95.0
plant.vehicle.drawbar_m=-1.0  implement.kind='wing'
"""
WRONG_VALUES = VALUES.split()
UNKNOWN_KEYS = {
    "soil.softness=3": "name, cone_index_kpa",
    "path.length_m=3": "kind, radius_m",
    "tyres.width_m=1": "description, path, start",
    "actuators.front.play_deg=1": "dead_time_s",
    "actuators.hydrostat.dead_band_deg=1": "dead_time_s",
    "controller.noise.hitch=1": "assumed",
    "controller.vehicle.file='farm4500'": "wheelbase_m",
    "plant.vehicle.width_m=1.0": "file",
    "controller.options.horizn=12": "moves",
}
WRONG_TABLES = {
    "path.kind='ring'": "path: Input tag 'ring'",
    "soil.patches=[{x_m=1.0, y_m=2.0}]": "soil.patches.0.radius_m: Field required",
    "terrain.features=[{x_m=1.0}]": "terrain.features.0: kind is missing, must be one of rise,",
    "terrain.features=[{kind='hole'}]": "terrain.features.0: Input tag 'hole'",
    "terrain.features=[{kind='furrows', period_m=0.8, depth_m=0.1}, {kind='step', x_m=1}]": (
        "terrain.features.1.y_m: Field required"
    ),
    "terrain.features=[{kind='furrows', period_m=0.8, deep_m=0.1, depth_m=0.1}]": (
        "terrain.features.0.deep_m: unknown key; allowed here: kind, period_m, depth_m, along"
    ),
    "terrain.features=[{kind='step', x_m=1, y_m=1, height_m=0.3, ramp_m=0.2}]": (
        "terrain.features.0: got height_m 0.3 over a flank of 0.2 m"
    ),
    "soil.tramlines=[{kind='path', track_m=0.2}]": "soil.tramlines.0: got tracks 0.3 m wide",
    "soil.name='moist'": "soil: got name 'moist' and cone_index_kpa 600",
    "sensors={preset='paper', gnss_antenna='corrected'}": "sensors: gnss_antenna 'corrected'",
    " ": "must be key.key=value",
    "terrain": "--set terrain: must be key.key=value",
}


@pytest.fixture(scope="module")
def validator():
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenarios_survive_being_written_out_and_fit_the_schema(name, tmp_path, validator):
    scenario = load(name)[1]
    file = tmp_path / "copy.toml"
    file.write_text(dump(scenario))
    assert load(str(file)) == ("copy", scenario)
    validator.validate(read_scenario(name).content)
    validator.validate(tomllib.loads(dump(scenario)))


def refusal(override, name="grass"):
    with pytest.raises(InvalidScenario) as caught:
        load(name, [override] if override else [])
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_refusal_names_key_value_and_allowed_values_in_one_line():
    for override in WRONG_VALUES:
        key = override.partition("=")[0]
        assert re.match(rf"--set: {key}(\.0)?: ", refusal(override)), override
    for override, allowed in UNKNOWN_KEYS.items():
        said = refusal(override)
        assert override.split("=")[0].removesuffix(".width_m") in said
        assert "unknown" in said
        assert allowed in said.partition("allowed")[2], override
    for override, words in WRONG_TABLES.items():
        assert words in refusal(override), override


def test_the_schema_refuses_what_a_scenario_refuses_but_relations_of_keys(validator):
    related = ("got tracks", "got height_m", "got name", "gnss_antenna", "must be key.key")
    tables = [text for text, words in WRONG_TABLES.items() if not any(r in words for r in related)]
    unknown = [text for text in UNKNOWN_KEYS if "options" not in text]
    own_rules = ("nan", "inf", "options", "estimator")
    values = [text for text in WRONG_VALUES if not any(rule in text for rule in own_rules)]
    tables = [text for text in tables if "nan" not in text]
    for override in (*values, *unknown, *tables, "path={length_m=30.0}"):
        content = read_scenario("kayacan2016").content
        merge_tables(content, parse_overrides([override]))
        assert not validator.is_valid(content), override
    for path in ("{radius_m=12.0}", "{kind='straight', length_m=3.0}", "{kind='file', file='a'}"):
        validator.validate(parse_overrides([f"path={path}"]))


def test_a_misspelt_name_gets_a_suggestion_and_a_missing_one_the_shipped_names():
    for name, override, meant in (
        ("gras", "", "grass"),
        ("grass", "soil.patchs=[]", "patches"),
        ("grass", "controller.options.horizn=12", "horizon"),
    ):
        assert refusal(override, name).endswith(f"(did you mean {meant}?)")
    assert "cultivate, farm" in refusal("", "nowhere.toml")


def test_a_torn_file_is_refused_and_a_fault_of_the_file_is_told_before_the_change(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[soil\ncone_index_kpa = 3")
    assert "mine.toml: cannot be read as TOML" in refusal("", str(file))
    file.write_text("[path]\nlaps = 0\n")
    assert "mine.toml: path.laps" in refusal("soil.cone_index_kpa=300", str(file))


def test_a_path_in_a_change_starts_where_the_user_stands(tmp_path, monkeypatch):
    (tmp_path / "field.csv").write_text("x,y\n-20,0\n0,0\n20,0\n")
    monkeypatch.chdir(tmp_path)
    for line in ("path={kind='file', file='field.csv'}", "path={kind='file', file='./field.csv'}"):
        assert load("grass", [line])[1].path.file == str(tmp_path / "field.csv")
    height_map = load("grass", ["terrain.height_map=h.npy"])[1].terrain.height_map
    assert height_map == str(tmp_path / "h.npy")


def test_the_reference_has_keys_with_their_ranges_and_the_options_of_every_controller():
    page = scenario_reference()
    for name in CONTROLLERS:
        assert all(f"| `{name}`: `{key}` |" in page for key in controller_options(name, {}))
    assert "| `laps` | whole number 1 to 100 |  | `2` | Number of laps. |" in page
    assert re.search(r"\| `slope_rad` \| number 0 to 0\.6 \| rad \| `0\.0` \|", page)
    assert '`"A"`, `"B"`, `"C"`, `"D"`, `"E"`, `"F"`, `"flat"`' in page


def test_a_start_lies_to_the_left_of_the_path_and_turned_by_its_heading():
    _, scenario = load("line-entry", ["start.heading_deg=30", "start.rolling=false"])
    x, y, yaw = scenario.start.pose(2.0, 3.0, math.pi / 2)  # left of a path to the north is west
    assert (x, y) == pytest.approx((2.0 - scenario.start.offset_m, 3.0))
    assert yaw == pytest.approx(math.radians(120.0))
    truth = assemble(scenario, 7).plant.truth()
    assert truth.tractor.y == pytest.approx(scenario.start.offset_m, abs=0.01)
    assert truth.tractor.yaw == pytest.approx(math.radians(30.0), abs=0.02)
    assert abs(truth.speed) < 0.01
