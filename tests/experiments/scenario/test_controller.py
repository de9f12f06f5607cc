"""`[controller]`: options of shipped controllers as scenario keys and sweep axes."""

from dataclasses import fields

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import dump, load
from proving_ground.testbed.recording.channels import CONTROL

from tests.experiments.study_files import SHORT, plan_of
from ttempc.guidance.controllers import CONTROLLERS


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_a_resolved_scenario_has_every_option_and_loads_again(name, tmp_path):
    scenario = load("grass", [f'controller.name="{name}"'])[1]
    options = CONTROLLERS[name].options
    names = set() if options is None else {item.name for item in fields(options)}
    assert set(scenario.controller.options) == names
    file = tmp_path / "again.toml"
    file.write_text(dump(scenario))
    assert load(str(file))[1] == scenario


def test_an_option_replaces_its_default_alone():
    plain = load("grass")[1].controller.options
    changed = load("grass", ["controller.options.horizon=12"])[1].controller.options
    assert changed == {**plain, "horizon": 12}


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "controller.options.horizn=12",
            r"controller.options.horizn: unknown, allowed .*moves.*\(did you mean horizon\?\)",
        ),
        (
            "controller.options.horizon=2.5",
            r"controller.options.horizon: got 2.5, must be an integer",
        ),
        ("controller.options.horizon=0", r"controller.options.horizon: got 0"),
        ("controller.options.step_weight=[1.0]", r"controller.options.step_weight"),
        ("controller.options.robust='no'", r"controller.options.robust: got 'no', must be true"),
        (
            "controller.estimator='ukf'",
            r"controller.estimator: got 'ukf', allowed are ekf, nmhe",
        ),
    ],
)
def test_impossible_options_are_refused_with_their_key(override, words):
    with pytest.raises(InvalidScenario, match=words):
        load("grass", [override])


def test_options_of_a_file_belong_to_the_controller_that_it_names(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[controller]\nname = 'ttempc'\noptions = { horizon = 12 }\n")
    assert load(str(file))[1].controller.options["horizon"] == 12
    other = load(str(file), ['controller.name="pid"'])[1].controller
    assert "horizon" not in other.options
    assert load(str(file), ['controller.name="ttempc"'])[1].controller.options["horizon"] == 12


def test_an_option_reaches_the_controller():
    """A horizon of its default gives the same commands, another one does not."""

    def commands(*overrides):
        name, scenario = load("grass", [*overrides, "path={kind='straight', length_m=4}"])
        return simulate(name, scenario, seed=1)[1][CONTROL].values

    default = commands()
    np.testing.assert_array_equal(commands("controller.options.horizon=20"), default)
    assert not np.array_equal(commands("controller.options.horizon=12"), default)


def test_a_vehicle_without_a_tube_is_noted_in_one_line():
    def notes(name, *overrides):
        scenario = load(name, overrides)[1]
        return scenario.controller.notes(scenario.vehicles().model, scenario.control.period_s)

    assert notes("grass") == ()
    assert notes("farm", 'controller.options.tightening="none"') == ()
    assert notes("farm", 'controller.name="pid"') == ()
    (note,) = notes("farm")
    assert "not tightened" in note
    assert "\n" not in note


def test_an_option_is_an_axis_of_a_study(tmp_path):
    axis = '[[axis]]\nkey = "controller.options.horizon"\nkind = "list"\nvalues = [10, 20]\n'
    plan = plan_of(tmp_path, 'scenario = "grass"\nseeds = 1', SHORT, axis)
    runs = [plan[run] for run in range(plan.size)]
    assert [run.setting.scenario.controller.options["horizon"] for run in runs] == [10, 20]
