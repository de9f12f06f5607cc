"""The registry of wheel models: a new model needs its own class and one entry."""

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.truth import WHEELS
from proving_ground.testbed.wheels.wheel_models import WHEEL_MODELS, SoilWheels, wheel_model

from tests.testbed.plants import ROLL, plant_on, rough_run, state_hash


class Ice(SoilWheels):
    """Soil wheels whose law has no traction, no motion resistance and no side force."""

    def __init__(self, model, data, tyres, ground, law):
        super().__init__(model, data, tyres, ground, law)
        self.calls = []
        table = self.step.args[0]
        table[[3, 6, 7, 8, 9, 10]] = 1e-9

    def prepare(self):
        self.calls.append("prepare")

    def report(self):
        self.calls.append("report")


def test_a_registered_model_drives_a_plant_and_a_scenario(monkeypatch):
    monkeypatch.setitem(WHEEL_MODELS, "ice", Ice)
    _, scenario = load("grass", ['plant.wheels="ice"'])
    assert scenario.plant.wheels == "ice"
    plant = plant_on(wheels="ice")
    plant.reset(0.0, 0.0, 0.0, 1.0)
    plant.wheels.calls.clear()
    truth = plant.advance(ROLL, 100)
    assert plant.wheels.calls == ["prepare", "report"]
    assert np.abs(truth.wheels.force_long).max() < 1e-3
    assert truth.wheels.load.sum() > 0.0


def test_an_unknown_model_is_refused_with_the_names_that_exist():
    with pytest.raises(InvalidPlant, match=r"plant\.wheels: got 'rail', must be 'soil' or 'cont"):
        wheel_model("rail")
    with pytest.raises(InvalidScenario, match=r"plant\.wheels: got 'rail', must be 'soil' or"):
        load("grass", ['plant.wheels="rail"'])


@pytest.mark.parametrize("name", WHEEL_MODELS)
def test_every_model_reports_all_wheels_and_restores_its_state(name):
    plant = plant_on(wheels=name)
    plant.reset(0.0, 0.0, 0.0, 1.0)
    snapshot = plant.snapshot()
    first = plant.advance(ROLL, 50)
    assert first.wheels.load.shape == (len(WHEELS),)
    assert (first.wheels.load > 0.0).all()
    after = state_hash(plant)
    plant.restore(snapshot)
    plant.advance(ROLL, 50)
    assert state_hash(plant) == after


def test_the_wheel_state_is_a_copy_in_a_snapshot():
    plant = rough_run(seed=4, steps=100)
    snapshot = plant.snapshot()
    before = snapshot.wheel_state.copy()
    plant.advance(ROLL, 100)
    np.testing.assert_array_equal(snapshot.wheel_state, before)
    assert (plant.wheels.state != before).any()
