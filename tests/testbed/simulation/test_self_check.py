"""Self-check of compiled steps at the first plant of a process, and the switch to plain ones."""

import logging

import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.simulation import compiled_steps as module
from proving_ground.testbed.simulation import plant as plant_module
from proving_ground.testbed.simulation.compiled_steps import CompiledSteps
from proving_ground.testbed.simulation.fast_mujoco import library, self_check
from proving_ground.testbed.simulation.fast_mujoco.self_check import SelfCheck, difference
from proving_ground.testbed.simulation.plain_steps import PlainSteps
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.truth import TruthBlock

from tests.testbed.plants import SMALL
from ttempc.types import Command

FIELD = terrain.flat((30.0, 20.0))
SOIL = SoilMap(300.0)


@pytest.fixture
def check(monkeypatch):
    """Return the self-check of a process without any plant so far."""
    fresh = SelfCheck()
    monkeypatch.setattr(plant_module, "SELF_CHECK", fresh)
    self_check.warn_of_plain_steps.cache_clear()
    return fresh


def rolling_plant():
    plant = Plant(SMALL, FIELD, SOIL)
    plant.reset(0.0, 0.0, 0.0, 1.0)
    return plant


def warnings_in(caplog):
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_the_first_plant_is_checked_and_left_as_it_was(check, caplog):
    first = rolling_plant()
    assert check.passed
    assert isinstance(first._steps, CompiledSteps)
    assert not warnings_in(caplog)
    second = rolling_plant()  # which is not checked
    for one, other in zip(first.present(), second.present(), strict=True):
        np.testing.assert_array_equal(one, other)
    one = first.drive(Command(0.2, -0.1, 0.6), 3, 20)
    other = second.drive(Command(0.2, -0.1, 0.6), 3, 20)
    np.testing.assert_array_equal(one.rows, other.rows)


@pytest.mark.parametrize("part", ["damping", "parents", "dof_bodies"])
def test_a_falsified_step_is_noticed_and_plain_steps_are_taken(check, caplog, monkeypatch, part):
    """Stands for a release of MuJoCo in which a sum of a step is another one."""
    right = module.Dynamics.of

    def wrong(model, data):
        dynamics = right(model, data)
        false = {
            "damping": 1.01 * dynamics.damping,  # joints brake by 1 % more
            "parents": np.maximum(dynamics.parents - 1, 0),  # forces go to another body
            "dof_bodies": np.roll(dynamics.dof_bodies, 1),
        }
        return dynamics._replace(**{part: false[part]})

    monkeypatch.setattr(module.Dynamics, "of", wrong)
    plant = rolling_plant()
    assert check.passed is False
    assert isinstance(plant._steps, PlainSteps)
    (line,) = warnings_in(caplog)
    assert "plain steps" in line
    assert "1e-09" in line

    assert isinstance(rolling_plant()._steps, PlainSteps)  # the verdict holds for the process
    assert len(warnings_in(caplog)) == 1


def test_a_difference_is_relative_and_none_counts_as_infinite():
    def block(row):
        return TruthBlock(np.array([row]), np.zeros((1, 2, 7)), np.zeros((1, 0)))

    assert difference(block([1000.0, 0.5]), block([1000.1, 0.5])) == pytest.approx(1e-4, rel=1e-3)
    assert difference(block([1000.0, 0.5]), block([1000.0, 0.4])) == pytest.approx(0.1)
    assert difference(block([np.nan, 0.5]), block([1000.0, 0.5])) == np.inf


@pytest.mark.parametrize(("text", "kind"), [("1", PlainSteps), ("0", CompiledSteps)])
def test_the_environment_switches_compiled_steps_off(check, caplog, monkeypatch, text, kind):
    monkeypatch.setenv(library.PLAIN, text)
    assert isinstance(rolling_plant()._steps, kind)
    assert check.passed is (None if kind is PlainSteps else True)
    assert not warnings_in(caplog)


def test_a_release_without_a_function_or_with_other_options_takes_plain_steps(
    check, caplog, monkeypatch
):
    monkeypatch.setattr(module, "missing_symbols", lambda: ["mj_factorM"])
    assert isinstance(rolling_plant()._steps, PlainSteps)
    monkeypatch.setattr(module, "missing_symbols", list)
    monkeypatch.setattr(library, "_OPTIONS", ("disableflags", *library._OPTIONS[:-1]))
    assert isinstance(rolling_plant()._steps, PlainSteps)
    missing, order = warnings_in(caplog)
    assert "mj_factorM" in missing
    assert "order" in order
    assert check.passed is None
