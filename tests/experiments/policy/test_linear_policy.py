"""A linear policy drives as in the environment; without gains it is the controller below it."""

from __future__ import annotations

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidController
from proving_ground.experiments.gym_env.environment import FieldTrial
from proving_ground.experiments.gym_env.observation import ESTIMATE_NAMES, EstimateObserver
from proving_ground.experiments.policy.linear_policy import LinearPolicy, learnt, read_policy
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import CONTROL, STATE
from proving_ground.testbed.recording.record_rows import state_row

from ttempc import Vehicle, figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Estimate

FACTORY = "proving_ground.experiments.policy.linear_policy:learnt"
STRAIGHT = ("path={kind='straight', length_m=6}",)
GAINS = {"delta_t": {"y_t_e_m": 3.0}, "hp": {"v_e_mps": 1.0, "x_t_e_m": 0.5}}


@pytest.fixture
def write(tmp_path):
    def write_policy(gains, **values):
        file = tmp_path / "policy.toml"
        values = {"format": 1, "about": "by hand", "controller": "pid", "share": 0.2, **values}
        file.write_text(LinearPolicy(**values, gains=gains).to_toml())
        return file

    return write_policy


def test_without_gains_it_is_its_controller_bit_for_bit(write):
    _, alone = simulate(*load("grass", [*STRAIGHT, "controller.name=pid"]), 5)
    options = {"policy": str(write({}))}
    _, record = simulate(*load("grass", STRAIGHT), 5, factory=learnt, options=options)
    np.testing.assert_array_equal(record[STATE].values, alone[STATE].values)


def test_as_a_controller_it_drives_as_in_the_environment(write):
    policy = read_policy(str(write(GAINS)))
    assert policy.gains == GAINS
    overrides = [*STRAIGHT, "controller.name=pid"]
    environment = FieldTrial(
        "grass", overrides, action="residual", residual_share=policy.share, normalised=False
    )
    observation, _ = environment.reset(seed=5)
    states, ended = [state_row(environment.truth)], False
    while not ended:
        observation, _, _, ended, _ = environment.step(policy.matrix() @ observation)
        states.append(state_row(environment.truth))
    named = [f"controller.name={FACTORY}", f"controller.options.policy='{write(GAINS)}'"]
    _, record = simulate(*load("grass", [*STRAIGHT, *named]), 5)
    np.testing.assert_array_equal(np.array(states), record[STATE].values[::5])
    _, other = simulate(*load("grass", overrides), 5)
    assert not np.array_equal(record[STATE].values, other[STATE].values)


def test_a_residual_keeps_to_the_limits(write):
    """A gain that asks for the largest residual, now left, now right, is cut before the guard."""
    named = [
        f"controller.name={FACTORY}",
        f"controller.options.policy='{write({'delta_t': {'y_t_e_m': 1e5}}, share=1.0)}'",
    ]
    _, record = simulate(*load("grass", [*STRAIGHT, *named]), 5)
    control = record[CONTROL]
    steps = np.abs(np.diff(control["delta_t_rad_command"]))
    assert steps.max() == pytest.approx(Vehicle().steering_rate_t * 0.2)
    assert not any("the controller's" in event.text for event in record.events)


def test_observation_has_errors_of_the_estimate_and_curvature_ahead():
    """Left of a circle's start by 0.1 m the error is -0.1 m to the left; curves come in seconds."""
    reference = Reference(figure_eight(), Vehicle(), ConstantSpeed(1.0))
    observer = EstimateObserver(reference, 0.2)
    at = reference.at(0.0)
    state = at.state.copy()
    state[:2] += 0.1 * np.array([-np.sin(state[2]), np.cos(state[2])])
    estimate = Estimate(0.0, state, np.zeros((7, 7)), at.trailer_xy, float(at.hitch_angle))
    values = dict(zip(ESTIMATE_NAMES, observer.observe(estimate, 0, np.ones(3)), strict=True))
    assert values["y_t_e_m"] == pytest.approx(-0.1)
    assert values["x_t_e_m"] == pytest.approx(0.0, abs=1e-12)
    assert values["y_i_e_m"] == pytest.approx(0.0, abs=1e-12)
    assert values["curvature_in_2_s_per_m"] == pytest.approx(float(reference.at(2.0).curvature))
    assert values["hp_command"] == 1.0
    broken = Estimate(0.0, np.full(7, np.nan), np.zeros((7, 7)), at.trailer_xy, np.inf)
    assert np.isfinite(observer.observe(broken, 10**6, np.zeros(3))).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format = 2", "format"),
        ("format = 1\nabout=''\ncontroller='pid'\nshare=2.0\n[gains]", "share"),
        (
            "format = 1\nabout=''\ncontroller='pid'\nshare=0.1\n[gains.delta_t]\ny_t_m = 1.0",
            r"gains.delta_t.y_t_m: must be one of .*y_t_e_m",
        ),
    ],
)
def test_files_are_refused_in_a_line(tmp_path, text, message):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(InvalidController, match=message) as error:
        read_policy(str(file))
    assert "\n" not in str(error.value)
