"""JSON schema of a scenario."""

import tomllib

import pytest
from proving_ground.experiments.scenario.scenario import (
    dump,
    load,
    merge_tables,
    parse_overrides,
    read_scenario,
    shipped,
)
from proving_ground.experiments.scenario.schema import json_schema, unit_of

jsonschema = pytest.importorskip("jsonschema")


@pytest.fixture(scope="module")
def validator():
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenarios_are_valid_as_written_and_as_resolved(name, validator):
    validator.validate(read_scenario(name).content)
    validator.validate(tomllib.loads(dump(load(name)[1])))


@pytest.mark.parametrize(
    "override",
    [
        "soil.softness=3",
        "tyres.width_m=1",
        "path.length_m=3",
        "soil.cone_index_kpa=-3",
        "path.laps=1.5",
        "path.radius_m='wide'",
        "path={kind='ring'}",
        "path={length_m=30.0}",
        "terrain.iso_class='G'",
        "terrain.features=[{period_m=0.8, depth_m=0.1}]",
        "terrain.features=[{kind='furrows', period_m=0.8}]",
        "soil.tramlines=[{kind='path', strength_factor=30.0}]",
        "sensors.gnss_latency_s=2.5",
        "sensors.imu.on=1",
        "plant.vehicle.load_kg=true",
        "controller.vehicle.front_limit_deg=95.0",
    ],
)
def test_wrong_keys_and_values_are_invalid(override, validator):
    content = read_scenario("kayacan2016").content
    assert validator.is_valid(content)
    merge_tables(content, parse_overrides([override]))
    assert not validator.is_valid(content)


@pytest.mark.parametrize(
    "path", ["{radius_m=12.0}", "{kind='straight', length_m=30.0}", "{kind='file', file='a.csv'}"]
)
def test_alternatives_are_chosen_by_their_kind(path, validator):
    validator.validate(parse_overrides([f"path={path}"]))


def test_every_key_has_a_description_and_a_type():
    schema = json_schema()
    for table in (schema, *schema["$defs"].values()):
        for key, value in table["properties"].items():
            assert value.get("description"), f"{table['title']}.{key}"
            assert {"type", "anyOf", "oneOf", "enum", "const", "$ref"} & set(value)


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("radius_m", "m"),
        ("cone_index_kpa", "kPa"),
        ("speed_mps", "m/s"),
        ("hp_rate_per_s", "1/s"),
        ("front_rate_degps", "deg/s"),
        ("acceleration_mps2", "m/s^2"),
        ("laps", None),
        ("name", None),
    ],
)
def test_a_unit_is_the_last_word_of_a_key(key, unit):
    assert unit_of(key) == unit
