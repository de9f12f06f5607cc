"""The example of a learnt policy drives as in the environment, and its training repeats itself."""

from __future__ import annotations

import importlib
import tomllib

import numpy as np
import pytest
import tomli_w
from proving_ground.experiments.interfaces.gym_env.environment import FieldTrial
from proving_ground.experiments.papers.pages import ROOT
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import CONTROL, STATE

from tests.testbed.truths import state_row
from ttempc import Vehicle

EXAMPLES = ROOT / "docs" / "examples"
STRAIGHT = ("path={kind='straight', length_m=6}",)
GAINS = {"delta_t": {"y_t_e_m": 3.0}, "hp": {"v_e_mps": 1.0, "x_t_e_m": 0.5}}


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    return importlib.import_module("learnt_policy")


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


@pytest.mark.filterwarnings("ignore")  # of torch and stable-baselines3, about their own parts
def test_a_policy_of_ppo_is_a_file_that_the_loader_drives(example, run, tmp_path):
    needed = "needs stable-baselines3 and torch: the extra `rl`"
    pytest.importorskip("stable_baselines3", reason=needed, exc_type=ImportError)
    file = tmp_path / "ppo.toml"
    training = importlib.import_module("train_policy")
    training.main(["-o", str(file), "--scenarios", "pavement", "--steps", "1", "--periods", "100"])
    gains = tomllib.loads(file.read_text())["gains"]
    assert np.count_nonzero(example.matrix(gains)) == 3 * len(example.SIZES)
    assert np.isfinite(run(gains)[STATE].values).all()


def test_the_policy_of_ppo_holds_a_line_that_feedforward_leaves(example):
    policy = f"controller.options.policy='{EXAMPLES / 'train_policy.toml'}'"
    trailer_m = []
    for named in (
        ["controller.name=learnt_policy:learnt", policy],
        ["controller.name=feedforward"],
    ):
        line = "path={kind='straight', length_m=30}"
        summary, _ = simulate(*load("wet-slope", [line, *named]), 5)
        trailer_m.append(summary.tracking.all.trailer.cross_p95_m)
    assert trailer_m[0] < 0.5 * trailer_m[1]


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
