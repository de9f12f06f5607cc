"""Vehicle parameters of plant and model: one file, deliberate differences, and their report."""

import math
from dataclasses import replace

import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.scenario.scenario import dump, load, shipped
from proving_ground.testbed.vehicle.vehicle import VEHICLES, read_vehicle

from ttempc.errors import InvalidPath, TtempcError
from ttempc.vehicle import Vehicle


def differences(*overrides, name="grass"):
    scenario = load(name, overrides)[1]
    return {item.key: (item.plant, item.model) for item in scenario.vehicles().mismatch}


def test_one_shipped_scenario_has_a_parameter_mismatch():
    declared = {"kayacan2016": {"speed_gain_mps": (1.225, 1.4)}}
    for name in shipped():
        assert differences(name=name) == declared.get(name, {}), name
    assert differences("plant.vehicle.drawbar_m=1.1", "controller.vehicle.drawbar_m=1.1") == {}
    assert load("grass")[1].vehicles().model == Vehicle()  # the paper's, default of the library


def test_plant_and_model_come_from_one_file():
    vehicles = load("grass", ["plant.vehicle.file='farm4500'"])[1].vehicles()
    plant, model = vehicles.plant, vehicles.model
    assert plant == read_vehicle("farm4500")
    assert model.wheelbase == plant.tractor.wheelbase_m
    assert model.trailer_length == plant.trailer.length_m
    assert model.steering_rate_i == math.radians(plant.trailer_steering.rate_degps)
    assert model.speed_gain == plant.hydrostat.speed_gain_mps


def test_a_vehicle_file_lies_beside_its_scenario_and_is_found_from_a_copy_elsewhere(tmp_path):
    text = VEHICLES.find("kayacan2016").read_text()
    (tmp_path / "mine.toml").write_text(text.replace("length_m = 1.3 ", "length_m = 1.7 "))
    file = tmp_path / "field.toml"
    file.write_text('[plant.vehicle]\nfile = "mine.toml"\n')
    scenario = load(str(file))[1]
    assert scenario.controller.vehicle.trailer_m == 1.7
    elsewhere = tmp_path / "runs" / "copy.toml"
    elsewhere.parent.mkdir()
    elsewhere.write_text(dump(scenario))
    assert load(str(elsewhere))[1] == scenario


def test_any_number_of_the_vehicle_file_can_be_changed_in_the_plant():
    scenario = load("grass", ["plant.vehicle.parts.trailer.mass_kg=600.0"])[1]
    shipped_trailer = read_vehicle().trailer
    assert scenario.vehicles().plant.trailer == replace(shipped_trailer, mass_kg=600.0)
    assert scenario.vehicles().model == load("grass")[1].vehicles().model
    assert differences("plant.vehicle.parts.front_steering.lag_s=0.3") == {
        "front_lag_s": (0.3, read_vehicle().front_steering.lag_s)
    }


def test_impossible_vehicles_are_refused_in_one_line():
    for override, message in (
        ("plant.vehicle.file='tank'", "farm4500, kayacan2016, tipper4500"),
        ("plant.vehicle.file='none.toml'", "none.toml'"),
        ("plant.vehicle.hitch_offset_m=0.1", "plant.vehicle over kayacan2016: hitch.yaw_limit_deg"),
        ("plant.vehicle.parts.wagon.mass_kg=1.0", "kayacan2016: wagon: unknown key"),
        ("plant.vehicle.parts.tractor.mass=1.0", "kayacan2016: tractor.mass: unknown key"),
        ("plant.vehicle.parts.tractor.mass_kg=-1.0", "tractor.mass_kg: "),
        ("plant.vehicle.parts.hitch.offset_m=0.2", "give it as plant.vehicle.hitch_offset_m"),
    ):
        with pytest.raises(InvalidScenario) as caught:
            load("grass", [override])
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_path_that_the_large_vehicle_cannot_steer_is_refused_with_its_place():
    assemble(load("farm")[1], 1)
    tight = load("farm", ["path.radius_m=3.0"])[1]
    with pytest.raises(InvalidPath, match=r"path too tight at s = .* steering would need"):
        assemble(tight, 1)
    fast = load("farm", ["path.speed_mps=3.2"])[1]
    with pytest.raises(TtempcError, match=r"3\.1 m/s"):
        assemble(fast, 1)
