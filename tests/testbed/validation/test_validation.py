"""Plant validation: the default plant passes, and a mutated plant fails the right check."""

import dataclasses
import math

import pytest
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.validation.bench import Bench
from proving_ground.testbed.validation.check import between
from proving_ground.testbed.validation.validate import EXPERIMENTS, validate

from tests.cards import bench_of

GRASS, FARM = bench_of("grass"), bench_of("farm")


def checks_of(experiment, bench=GRASS, **changes):
    return list(validate(dataclasses.replace(bench, **changes), (experiment,)))


def failed(experiment, bench=GRASS, **changes):
    checks = checks_of(experiment, bench, **changes)
    return [check.name for check in checks if check.passed is False]


@pytest.mark.parametrize("bench", [GRASS, FARM], ids=["grass", "farm"])
@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_holds_for_both_vehicles(experiment, bench):
    checks = checks_of(experiment, bench)
    assert checks
    for check in checks:
        assert check.passed, check
        assert check.source
        assert check.expectation


@pytest.mark.parametrize("experiment", ["steering", "kinematics"])
def test_a_plain_trailer_keeps_its_angle_and_has_no_checks_of_its_steering(experiment):
    checks = checks_of(experiment, bench_of("plain-trailer"))
    assert all(check.passed is not False for check in checks)
    assert [check.name for check in checks if check.passed is None] == [
        {
            "steering": "trailer steering, rate",
            "kinematics": "residual with the sign of d delta_i' cos delta_i flipped, "
            "over that without",
        }[experiment]
    ]
    stops = [check.figure for check in checks if check.name == "trailer steering, stop"]
    assert all(abs(stop_deg) < 1e-3 for stop_deg in stops)


def test_a_check_passes_inside_its_range_and_nowhere_else():
    for figure, passed in ((1.96, True), (2.04, True), (1.94, False), (math.nan, False)):
        assert between("x", figure, 1.95, 2.05, "m", "s").passed is passed
    assert not between("x", math.nan, -math.inf, math.inf, "m", "s").passed
    assert between("x", 3.0, 2.0, math.inf, "m", "s").expectation == "at least 2"


# --- a mutated plant fails the right check ---------------------------------------------------


def mutate(monkeypatch, change):
    """Apply a change to every plant that a bench builds."""
    build = Bench.plant

    def plant(self, *arguments, **options):
        plant = build(self, *arguments, **options)
        change(plant)
        return plant

    monkeypatch.setattr(Bench, "plant", plant)


def faster(plant):
    plant.model.actuator("hydrostat").gainprm[0] *= 1.1


def slow(plant):
    plant.model.actuator("steer").dynprm[1] *= 0.7


def doubled_resistance(plant):  # the law that the checks expect, not that of the wheels
    law = plant.wheel_law
    resistance = {"resistance_bn": 0.5 * law.resistance_bn, "resistance_tyre": 0.02}
    plant.wheel_law = dataclasses.replace(law, **resistance)


def shifted(plant):
    plant.model.body_ipos[plant.body_names.index("tractor"), 0] += 0.1


def heavier(plant):
    plant.model.body_mass[plant.body_names.index("trailer")] *= 1.1


def undamped(plant):
    plant.wheels.tyre_table[:, 5] = 0.0


@pytest.mark.parametrize(
    ("change", "experiment", "names"),
    [
        (faster, "hydrostat", ["hydrostat gain K"]),
        (doubled_resistance, "coast-down", ["coast-down at 600 kPa"]),
        (slow, "steering", ["front steering, rate", "front steering, stop", "front steering, lag"]),
        (shifted, "static loads", ["static load, front axle", "static load, rear axle"]),
        (heavier, "static loads", ["weight on the wheels", "static load, trailer axle"]),
        (undamped, "bump", ["energy left a second after the bump"]),
    ],
)
def test_a_changed_plant_fails_its_check_alone(change, experiment, names, monkeypatch):
    mutate(monkeypatch, change)
    found = failed(experiment)
    assert names[0] in found
    assert set(found) <= {*names, "static load, rear axle"}


def test_a_flipped_sign_fails_the_kinematics(monkeypatch):
    advance = Plant.advance

    def mirrored(self, command, steps):
        truth = advance(self, command, steps)
        object.__setattr__(truth, "delta_i", -truth.delta_i)
        return truth

    monkeypatch.setattr(Plant, "advance", mirrored)
    names = failed("kinematics")
    assert "trailer yaw rate, rms residual" in names
    assert any("delta_i'" in name for name in names)


def test_a_diverged_plant_fails_its_experiment_and_the_others_still_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes MUJOCO_LOG.TXT to the working directory

    def without_gravity(plant):
        plant.model.opt.gravity[2] = math.nan

    mutate(monkeypatch, without_gravity)
    (check,) = checks_of("creep")
    assert check.passed is False
    assert "MuJoCo" in check.note or "finite" in check.note or "time" in check.note


def test_soil_that_carries_nothing_fails_and_does_not_crash():
    swamp = dataclasses.replace(GRASS, soil=SoilMap(40.0))
    assert all(isinstance(check.passed, bool) for check in validate(swamp, ("slip", "side force")))
