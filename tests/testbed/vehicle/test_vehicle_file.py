"""Vehicle files: shipped vehicles are valid, impossible ones are refused in one line."""

import dataclasses
import re

import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.vehicle.servos import drive_servo
from proving_ground.testbed.vehicle.vehicle import (
    GRAVITY,
    VEHICLES,
    AxleLoads,
    knuckle_angle,
    read_vehicle,
)
from proving_ground.testbed.vehicle.vehicle_model import build_spec, linkage_polynomial
from proving_ground.testbed.wheels.soil_law import SoilLaw

NAMES = VEHICLES.names()


def edited(tmp_path, table, key, value, name="kayacan2016"):
    """Return a copy of a shipped file in which one key of a table says something else."""
    text = VEHICLES.find(name).read_text()
    pattern = rf"(?ms)(^\[{table}\].*?^{key} = )[^#\n]*"
    text, count = re.subn(pattern, lambda match: match[1] + value + " ", text, count=1)
    assert count == 1
    file = tmp_path / "mine.toml"
    file.write_text(text)
    return str(file)


def test_the_paper_s_vehicle_has_the_paper_s_lengths_and_drive():
    vehicle = read_vehicle("kayacan2016")
    assert vehicle.tractor.wheelbase_m == 1.4
    assert vehicle.hitch.offset_m + vehicle.drawbar.length_m == pytest.approx(1.1)
    assert vehicle.trailer.length_m == 1.3
    assert (vehicle.hydrostat.speed_gain_mps, vehicle.hydrostat.time_constant_s) == (1.4, 2.05)


def test_impossible_vehicles_are_refused_with_file_key_and_reason(tmp_path):
    for table, key, value, message in (
        ("tractor", "wheelbase_m", "-1.4", "tractor.wheelbase_m: "),
        ("tractor", "mass_kg", "'heavy'", "tractor.mass_kg: "),
        ("tractor", "mass_kg", "150.0", "tractor.mass_kg = 150.0: masses do not add up"),
        ("tractor", "wheelbase_m", "0.65", "tractor.wheelbase_m = 0.65: front and rear wheels"),
        ("tractor", "rear_track_m", "0.2", "tractor.rear_track_m = 0.2: narrower than a tyre"),
        ("front_axle", "kingpin_track_m", "0.95", "front_axle.kingpin_track_m = 0.95: "),
        ("front_wheel", "section_height_m", "0.3", "front_wheel.section_height_m = 0.3: "),
        ("tractor", "centre_forward_m", "-0.1", "the front axle carries"),
        ("trailer", "centre_forward_m", "-0.4", "load.forward_m = (-0.4, 0.0): the trailer tips"),
        ("trailer", "centre_forward_m", "3.0", "load.forward_m = (3.0, 0.0): the trailer's wheels"),
        ("front_steering", "limit_deg", "45.0", "front_steering.limit_deg = 45.0: "),
        ("hitch", "yaw_limit_deg", "80.0", "hitch.yaw_limit_deg = 80.0: "),
        ("drawbar", "length_m", "0.05", "drawbar.length_m = 0.05: "),
        ("box", "forward_m", "2.0", "box.forward_m = 2.0: "),
        ("box", "floor_m", "0.5", "box.floor_m = 0.5: "),
        ("load", "mass_kg", "100.0\nforwards_m = 2.0", "load.forwards_m: unknown key; allowed"),
    ):
        file = edited(tmp_path, table, key, value)
        with pytest.raises(InvalidPlant) as caught:
            read_vehicle(file)
        assert str(caught.value).startswith(f"{file}: ")
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)
    text = VEHICLES.find("kayacan2016").read_text()
    file = tmp_path / "mine.toml"
    file.write_text(text[: text.index("[hydrostat]")])
    with pytest.raises(InvalidPlant, match=r"mine\.toml: hydrostat: "):
        read_vehicle(str(file))
    for name in ("tank", "nowhere.toml"):
        with pytest.raises(InvalidPlant, match="farm4500, kayacan2016, tipper4500"):
            read_vehicle(name)


@pytest.mark.parametrize("name", NAMES)
def test_axle_loads_balance_forces_and_moments(name):
    vehicle = read_vehicle(name)
    loads, load = AxleLoads.of(vehicle), vehicle.load
    masses = [vehicle.tractor.mass_kg, vehicle.drawbar.mass_kg, vehicle.trailer.mass_kg]
    weight = GRAVITY * (sum(masses) + load.mass_kg)
    assert loads.front + loads.rear + loads.trailer == pytest.approx(weight)
    # moments of everything about the ground below the front axle
    rj1 = vehicle.tractor.wheelbase_m + vehicle.hitch.offset_m
    axle = rj1 + vehicle.drawbar.length_m + vehicle.trailer.length_m
    places = [
        vehicle.tractor.wheelbase_m - vehicle.tractor.centre_forward_m,
        rj1 + 0.5 * vehicle.drawbar.length_m,
        axle - vehicle.trailer.centre_forward_m,
    ]
    moment = GRAVITY * (np.dot(masses, places) + load.mass_kg * (axle - load.forward_m))
    carried = loads.rear * vehicle.tractor.wheelbase_m + loads.trailer * axle
    assert carried == pytest.approx(moment)


@pytest.mark.parametrize("name", NAMES)
def test_linkage_follows_ackermann_over_its_whole_range(name):
    vehicle = read_vehicle(name)
    limit = np.radians(vehicle.front_steering.limit_deg)
    delta = np.linspace(-limit, limit, 57)
    for y in (-0.5, 0.5):
        kingpin = y * vehicle.front_axle.kingpin_track_m
        exact = knuckle_angle(delta, vehicle.tractor.wheelbase_m, kingpin)
        polynomial = linkage_polynomial(limit, vehicle.tractor.wheelbase_m, kingpin)
        np.testing.assert_allclose(np.polyval(polynomial[::-1], delta), exact, atol=2e-3)


@pytest.mark.parametrize("name", NAMES)
def test_servos_are_as_strong_as_the_vehicle_is_heavy(name):
    vehicle = read_vehicle(name)
    tractor, trailer = vehicle.tractor, vehicle.trailer
    heavy = dataclasses.replace(
        vehicle,
        tractor=dataclasses.replace(tractor, mass_kg=1.2 * tractor.mass_kg),
        drawbar=dataclasses.replace(vehicle.drawbar, mass_kg=1.2 * vehicle.drawbar.mass_kg),
        trailer=dataclasses.replace(trailer, mass_kg=1.2 * trailer.mass_kg),
    )
    before, after = (
        build_spec(each, flat((4.0, 4.0)), SoilLaw(), 0.002).compile() for each in (vehicle, heavy)
    )
    np.testing.assert_allclose(after.actuator_forcerange, 1.2 * before.actuator_forcerange)
    for model in (before, after):
        _, stiffness, damping = -model.actuator_biasprm[:2, :3].T
        lags = vehicle.front_steering.lag_s, vehicle.trailer_steering.lag_s
        np.testing.assert_allclose(damping / stiffness, lags)
    (_, speed, *_), (_, heavy_speed, *_) = (drive_servo(of, SoilLaw()) for of in (vehicle, heavy))
    assert heavy_speed > speed  # it slips more


def test_a_drive_quicker_than_its_own_tyres_is_refused():
    vehicle = read_vehicle("farm4500")
    hydrostat = dataclasses.replace(vehicle.hydrostat, time_constant_s=0.05)
    with pytest.raises(InvalidPlant, match="wheels and tyres alone take"):
        drive_servo(dataclasses.replace(vehicle, hydrostat=hydrostat), SoilLaw())


def with_pressure(wheel, pressure_bar, age_years=0.0):
    return dataclasses.replace(wheel, pressure_bar=pressure_bar, age_years=age_years)


def test_pressure_and_age_give_the_stiffness_of_lines_and_murphy():
    """16.9R34 at 1.2 bar: 172 - 1.77 x 34 + 0.34 x 16.9 x 34 x 1.2 = 346 kN/m; 5 years: + 28.

    The deflection at 16 kN is 1.5 x 16 / 346 = 69.4 mm of 358 mm.
    """
    rear = read_vehicle("farm4500").rear_wheel
    assert with_pressure(rear, 1.2).relative_deflection == pytest.approx(0.1937, rel=2e-3)
    ratio = with_pressure(rear, 1.2, 5.0).relative_deflection
    assert ratio == pytest.approx(1.5 * 16.0 / 374.2 / 0.358, rel=2e-3)
    assert with_pressure(rear, 2.4).relative_deflection < 0.7 * rear.relative_deflection
    with pytest.raises(ValueError, match=r"pressure_bar 0\.01"):
        with_pressure(dataclasses.replace(rear, rated_load_n=60000.0), 0.01)
    with pytest.raises(ValueError, match="pressure_bar"):
        dataclasses.replace(rear, relative_deflection=None)


def test_pressure_stiffens_a_tyre_as_measured_elsewhere():
    """495/70R24 under 15.7 kN (Keen, EAEC01): 328 kN/m at 1 bar, 645 at 3; within 15 %."""
    wheel = dataclasses.replace(
        read_vehicle("farm4500").rear_wheel,
        radius_m=0.3048 + 0.3465,
        width_m=0.495,
        section_height_m=0.3465,
        rated_load_n=15700.0,
    )
    for pressure_bar, published in ((1.0, 328e3), (3.0, 645e3)):
        deflection = 0.3465 * with_pressure(wheel, pressure_bar).relative_deflection
        assert 1.5 * 15700.0 / deflection == pytest.approx(published, rel=0.15)
