"""The example of a learnt policy drives as in the environment, and its training repeats itself."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
import tomli_w
from proving_ground.experiments.gym_env.environment import FieldTrial
from proving_ground.experiments.papers.pages import ROOT
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import CONTROL, STATE

from tests.testbed.truths import state_row
from ttempc import Vehicle

STRAIGHT = ("path={kind='straight', length_m=6}",)
GAINS = {"delta_t": {"y_t_e_m": 3.0}, "hp": {"v_e_mps": 1.0, "x_t_e_m": 0.5}}


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "examples")
    import learnt_policy

    return learnt_policy


@pytest.fixture
def run(example, tmp_path):
    """Drive a few metres of `grass` with a policy of these gains."""

    def run_with(gains, share=0.2):
        file = tmp_path / "policy.toml"
        file.write_text(tomli_w.dumps({"controller": "pid", "share": share, "gains": gains}))
        named = ["controller.name=learnt_policy:learnt", f"controller.options.policy='{file}'"]
        return simulate(*load("grass", [*STRAIGHT, *named]), 5)[1]

    return run_with


def test_without_gains_it_is_its_controller_bit_for_bit(run):
    _, alone = simulate(*load("grass", [*STRAIGHT, "controller.name=pid"]), 5)
    np.testing.assert_array_equal(run({})[STATE].values, alone[STATE].values)


def test_as_a_controller_it_drives_as_in_the_environment(example, run):
    overrides = [*STRAIGHT, "controller.name=pid"]
    environment = FieldTrial(
        "grass", overrides, action="residual", residual_share=0.2, normalised=False
    )
    observation, _ = environment.reset(seed=5)
    states, ended = [state_row(environment.truth)], False
    while not ended:
        observation, _, _, ended, _ = environment.step(example.matrix(GAINS) @ observation)
        states.append(state_row(environment.truth))
    np.testing.assert_array_equal(np.array(states), run(GAINS)[STATE].values[::5])


def test_a_residual_keeps_to_the_limits(run):
    """A gain that asks for the largest residual, now left, now right, is cut before the guard."""
    record = run({"delta_t": {"y_t_e_m": 1e5}}, share=1.0)
    steps = np.abs(np.diff(record[CONTROL]["delta_t_rad_command"]))
    assert steps.max() == pytest.approx(Vehicle().steering_rate_t * 0.2)
    assert not any("the controller's" in event.text for event in record.events)


def test_a_search_repeats_itself_and_gains_are_actions_at_sizes(example, tmp_path, capsys):
    arguments = ["--scenarios", "pavement", "--periods", "5", "--generations", "2"]
    arguments += ["--population", "4", "--seed", "3"]
    files = [tmp_path / name for name in ("one.toml", "two.toml")]
    for file in files:
        example.main([*arguments, "-o", str(file)])
    assert files[0].read_text() == files[1].read_text()
    gains = tomllib.loads(files[0].read_text())["gains"]
    assert np.count_nonzero(example.matrix(gains)) == example.DIMENSION
    assert "pid alone" in capsys.readouterr().out
    gains = example.gains_of(np.arange(1.0, example.DIMENSION + 1.0))
    assert gains["delta_t"]["y_t_e_m"] * 0.05 == 1.0
    assert gains["hp"]["wheel_slip"] * 0.1 == example.DIMENSION
