"""Evidence: verdicts, wrong constants, and the experiments' own arithmetic."""

from __future__ import annotations

import math

import numpy as np
import pytest
from proving_ground.experiments.papers.machine import (
    WRONG,
    Constant,
    machine,
    scaled_law,
    turned_out,
)
from proving_ground.experiments.papers.studies import closed_forms, evidence
from proving_ground.experiments.papers.studies.evidence import Evidence, page
from proving_ground.testbed.validation.single_manoeuvres import side_ratio, yaw_response
from proving_ground.testbed.vehicle.servos import tyres_of
from proving_ground.testbed.vehicle.vehicle import read_vehicle
from proving_ground.testbed.wheels.soil_law import SoilLaw


def item(figure, name="a figure", **about):
    texts = {"unit": "m", "published": "1 to 2 m", "method": "a drive", "rule": "a rule"}
    texts |= {"name": name, "source": "a source.", "band": (1.0, 2.0)}
    return Evidence(figure=figure, **{**texts, **about})


def test_verdict_follows_from_figure_and_band():
    verdicts = {1.0: "in band", 2.0: "in band", 0.99: "below", 2.01: "above", math.nan: "no figure"}
    for figure, verdict in verdicts.items():
        assert item(figure).verdict == verdict
        assert ("- Outside, 1: unknown." in page([item(figure)])) == (verdict != "in band")


def test_only_two_sided_rows_count_and_say_what_turns_them_out():
    items = [item(1.5, "one"), item(3.0, "two", at_work=True), item(1.5, "three", kind="one-sided")]
    text = page(items)
    assert text.startswith("1 of 2 two-sided figures from 1 sources")
    assert "0 of 1 of machines at work" in text
    assert "| a1 | three |" in text
    low, high = (Constant("law.side", factor) for factor in WRONG)
    table = turned_out({low: [1, 4], high: []}, [high])
    assert "| `law.side` | 2: 1, 4 | refused |" in table


def test_every_constant_is_one_of_the_plant_and_changes_it():
    content = evidence._content()["constants"]
    assert sum(map(len, content.values())) == 27
    assert set(content["law"]) <= set(SoilLaw.__dataclass_fields__)
    own = read_vehicle("farm4500")
    assert machine().bench.vehicle == own
    changed = machine(Constant("vehicle.load.mass_kg", 1.3)).bench.vehicle
    assert changed.load.mass_kg == pytest.approx(1.3 * own.load.mass_kg)
    wheels = machine(Constant("vehicle.*_wheel.damping_spm", 0.7)).bench.vehicle.wheels
    assert all(wheels[axle].damping_spm == 0.7 * own.wheels[axle].damping_spm for axle in wheels)
    wide = machine(Constant("implement.width_m", 1.3)).implement
    assert wide.width_m == pytest.approx(1.3 * machine().implement.width_m)
    assert machine(Constant("soil.cone_index_kpa", 0.7)).strength == 0.7


def test_a_scaled_law_is_scaled_once_for_either_kind_of_tyre():
    vehicle = read_vehicle("farm4500")
    radial = tyres_of(vehicle).radial
    own = SoilLaw().of(radial)
    law = scaled_law(vehicle, ["side"], 1.3)
    assert law.side == pytest.approx(1.3 * own.side)
    assert law.of(radial).side == pytest.approx(law.side)
    assert law.table(len(radial)).shape == own.table(len(radial)).shape
    assert SoilLaw().of(radial).side == pytest.approx(own.side)


def test_side_force_of_a_wheel_opposes_its_slip_angle_and_falls_with_slip():
    bench = machine().bench
    angle = math.radians(15.0)
    free, half = (side_ratio(bench, angle, slip, 20.0) for slip in (0.0, 0.5))
    assert free < half < 0.0
    assert side_ratio(bench, -angle, 0.5, 20.0) == pytest.approx(-half, rel=1e-6)
    assert side_ratio(bench, 0.0, 0.2, 20.0) == pytest.approx(0.0, abs=1e-9)


def test_slow_yaw_response_is_ackermann():
    bench = machine().bench
    tractor, _ = yaw_response(bench, 0.5, 0.2, periods=1)
    assert abs(tractor) == pytest.approx(0.5 / bench.nominal.wheelbase, rel=0.03)


def test_closed_forms_hold_and_a_wrong_mass_or_lag_leaves_them():
    forms = {name: np.array(row) for name, row in closed_forms.closed_forms().items()}
    for name, constant in (
        ("standing", "tractor.mass_kg"),
        ("steering_step", "front_steering.lag_s"),
    ):
        drive = closed_forms.MANOEUVRES[name]
        assert drive(machine()) == pytest.approx(forms[name], rel=0.05)
        wrong = np.array(drive(machine(Constant(f"vehicle.{constant}", 1.3))))
        assert (abs(wrong / forms[name] - 1.0) > 0.05).sum() >= 2
