"""Evidence: verdicts, wrong constants, and the experiments' own arithmetic."""

from __future__ import annotations

import math

import numpy as np
import pytest
from proving_ground.experiments.papers.evidence import wheels
from proving_ground.experiments.papers.machine import (
    RIGHT,
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


def test_only_counted_rows_count_and_those_that_can_fail_are_told_apart():
    items = [
        item(1.5, "one", turned_out_by=("`side` +",)),
        item(3.0, "two", at_work=True),
        item(1.2, "without power"),
        item(1.5, "three", kind="one-sided"),
        item(1.5, "four", kind="unknown conditions"),
    ]
    text = page(items)
    assert text.startswith("2 of 3 figures from 1 sources")
    assert "1 of 2 of those that can fail are inside" in text
    assert "| a1 | three |" in text
    assert "| c1 | four |" in text
    low, high = (Constant("law.side", factor) for factor in WRONG)
    table = turned_out({low: [1, 4], high: []}, [high])
    assert "| `law.side` | 2: 1, 4 | refused |" in table


def test_a_constant_turns_out_the_rows_whose_figure_leaves_the_band():
    right, low, high = evidence.tasks("receiver_memory")
    found = {right: [0.9, 0.8, 0.5], low: [0.9, 0.5, 0.5], high: [0.9, 0.8, 0.2]}
    turned_out = [row.turned_out_by for row in evidence.with_power("receiver_memory", found)]
    assert turned_out == [(), ("`length` -",), ("`length` +",)]


@pytest.mark.parametrize("name", ["tyre_stiffness", "combined_slip", "receiver_memory"])
def test_each_constant_of_a_table_changes_a_figure(name):
    right, *wrong = evidence.tasks(name)
    figures = np.array(evidence.measure(right))
    assert len(figures) == len(evidence._content()[name]["figures"])
    for constant in evidence._content()[name]["constants"]:
        both = [evidence.measure(task) for task in wrong if task[1].name == constant]
        assert np.max(np.abs(np.array(both) / figures - 1.0)) > 0.02, constant


def test_tyre_stiffness_is_the_regression_of_lines_and_murphy():
    # K = 172 - 1.77 D + 0.34 b D p, kN/m, 24 in rim, 19.49 in wide
    expected = [172.0 - 1.77 * 24.0 + 0.34 * 19.49 * 24.0 * bar for bar in (1.0, 3.0)]
    assert wheels.tyre_stiffness(RIGHT) == pytest.approx(expected, rel=0.003)


def test_a_second_pass_saves_work_of_sinkage_alone():
    """The gains are one saving of resistance, over three quantities; softer soil saves more."""
    bench = machine().bench
    soft, firm = (wheels._gains_in_rut(bench, bn) for bn in (20.0, 55.0))
    law = SoilLaw(tyre="radial")
    for bn, (rolling, traction, efficiency) in ((20.0, soft), (55.0, firm)):
        numbers = np.array([bn])
        saved = 0.01 * rolling * law.motion_resistance_ratio(numbers, np.zeros(1))[0]
        net = law.net_traction_ratio(numbers, np.array([0.2]))[0]
        assert traction == pytest.approx(100.0 * saved / net, rel=1e-3)
        assert 0.0 < traction < efficiency < rolling
    assert soft[0] > firm[0]


def test_drawbar_power_of_a_tractor_without_front_weight_is_the_tyre_efficiency():
    bench = machine().bench
    alone = wheels._efficiency(bench, 40.0, pulled_share=0.0)
    law = SoilLaw(tyre="radial")
    slip = np.array([0.1])
    numbers = np.array([40.0])
    ratio = law.net_traction_ratio(numbers, slip) / law.gross_traction_ratio(numbers, slip)
    assert np.interp(0.1, wheels._SLIPS, alone) == pytest.approx(0.9 * ratio[0], rel=1e-4)
    assert (wheels._efficiency(bench, 40.0, pulled_share=1.0) < alone).all()


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
    equal, double = (side_ratio(bench, angle, rim_speed, 20.0) for rim_speed in (1.0, 2.0))
    assert equal < double < 0.0
    assert side_ratio(bench, -angle, 2.0, 20.0) == pytest.approx(-double, rel=1e-6)
    assert side_ratio(bench, 0.0, 1.25, 20.0) == pytest.approx(0.0, abs=1e-9)
    # a wheel that turns with the speed along its plane does not slip: the pure law
    pure = side_ratio(bench, angle, math.cos(angle), 20.0)
    assert pure == min(side_ratio(bench, angle, each, 20.0) for each in (0.9, 1.0, math.cos(angle)))


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
