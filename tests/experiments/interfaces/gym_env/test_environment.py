"""The environment is the run of `simulate`, bit for bit, behind the interface of Gymnasium."""

from __future__ import annotations

import copy
import math
import pickle
from ctypes.util import find_library

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from proving_ground.experiments.errors import BadOptions, InvalidScenario
from proving_ground.experiments.interfaces.gym_env.environment import (
    FieldTrial,
    reward,
)
from proving_ground.experiments.interfaces.gym_env.policy import ESTIMATE_NAMES, bounds
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import CONTROL, STATE, TRACKING

from tests.testbed.truths import state_row

ENVIRONMENT = "proving_ground.gym:proving_ground/FieldTrial-v3"
STRAIGHT = ("path={kind='straight', length_m=6}",)
COMMANDS = ("delta_t_rad_command", "delta_i_rad_command", "hp_command")
SEED = 7
SCALE = bounds(ESTIMATE_NAMES)[1]


@pytest.fixture(scope="module")
def driven():
    """Summary and record of the run that the environments repeat."""
    return simulate(*load("grass", STRAIGHT), SEED)


def commands(record):
    return record[CONTROL].columns(*COMMANDS)


def repeat(environment, actions):
    """Return states at every tick, observations, rewards and the last answer of a run."""
    observation, _ = environment.reset(seed=SEED)
    states, observations = [state_row(environment.unwrapped.truth)], [observation]
    rewards, answer = [], None
    for action in actions:
        answer = environment.step(action)
        states.append(state_row(environment.unwrapped.truth))
        observations.append(answer[0])
        rewards.append(answer[1])
    return np.array(states), np.array(observations), rewards, answer


def at_ticks(record):
    """Return the true states of a record at its control ticks."""
    times = np.append(record[CONTROL].time_s, record[STATE].time_s[-1])
    rows = np.searchsorted(record[STATE].time_s, times - 1e-9)
    return record[STATE].values[rows]


def test_gymnasium_accepts_it():
    """Its warnings are errors here."""
    for options in ({}, {"action": "residual", "scenario": "raw-gnss"}):
        environment = gymnasium.make(ENVIRONMENT, overrides=STRAIGHT, **options)
        check_env(environment.unwrapped, skip_render_check=True)


def test_commands_of_a_run_give_its_states_bit_for_bit(driven):
    summary, record = driven
    environment = gymnasium.make(ENVIRONMENT, overrides=STRAIGHT, normalised=False)
    states, observations, _, (_, _, terminated, truncated, info) = repeat(
        environment, commands(record)
    )
    np.testing.assert_array_equal(states, at_ticks(record))
    assert (terminated, truncated, info["status"]) == (False, True, summary.status)
    errors = observations[:-1, : len(TRACKING.fields[:7])]  # of the estimate, as logged
    np.testing.assert_array_equal(errors, record[TRACKING].values[:, :7].astype(np.float32))
    scaled = gymnasium.make(ENVIRONMENT, overrides=STRAIGHT)
    _, entries, *_ = repeat(scaled, np.zeros((3, 3)))
    assert np.abs(entries).max() <= 1.0
    beta = scaled.unwrapped.observation_names.index("beta_rad")
    np.testing.assert_allclose(entries[0], np.clip(observations[0] / SCALE, -1.0, 1.0), rtol=1e-6)
    assert math.isclose(SCALE[beta], math.pi)


@pytest.mark.parametrize("steps", [0, 12, 60], ids=["at the start", "under way", "at the end"])
def test_a_copy_goes_on_as_the_environment_itself(steps):
    """The run of 6 m ends after 31 steps; a copy of an ended run has ended."""
    environment = gymnasium.make(ENVIRONMENT, overrides=STRAIGHT, action="residual")
    environment.reset(seed=SEED)
    environment.action_space.seed(SEED)
    ended = False
    for _ in range(steps):
        *_, terminated, truncated, _ = environment.step(environment.action_space.sample())
        ended = terminated or truncated
        if ended:
            break
    for copied in (copy.deepcopy(environment), pickle.loads(pickle.dumps(environment))):
        np.testing.assert_array_equal(
            state_row(copied.unwrapped.truth), state_row(environment.unwrapped.truth)
        )
        assert copied.unwrapped.spec.id == environment.unwrapped.spec.id
        if ended:
            with pytest.raises(ResetNeeded):
                copied.unwrapped.step(np.zeros(3))
    if not ended:
        action = environment.action_space.sample()
        first, second = environment.step(action), copied.step(action)
        np.testing.assert_array_equal(first[0], second[0])
        assert first[1:4] == second[1:4]
    assert environment.reset()[1] == copied.reset()[1]  # the same generator


def test_a_run_that_the_supervisor_stops_ends_as_that_of_the_command_line():
    """On a slope `feedforward` drifts off its path until it is stopped."""
    overrides = ("controller.name=feedforward",)
    summary, record = simulate(*load("wet-slope", overrides), 1)
    environment = FieldTrial("wet-slope", overrides, action="residual")
    environment.reset(seed=1)
    terminated = False
    while not terminated:
        *_, terminated, truncated, info = environment.step(np.zeros(3, np.float32))
        assert not truncated
    assert (info["status"], info["failure"]) == (summary.status, summary.failure)
    assert info["time_s"] == pytest.approx(record[STATE].time_s[-1])


@pytest.mark.skipif(
    any(find_library(name) is None for name in ("EGL", "GL")),
    reason="off-screen rendering needs libEGL and libGL (Debian: libegl1 libgl1)",
)
def test_a_picture_shows_the_vehicle_where_it_is():
    environment = gymnasium.make(ENVIRONMENT, overrides=STRAIGHT, render_mode="rgb_array")
    with pytest.raises(ResetNeeded):
        environment.unwrapped.render()
    pictures = []
    for seed in (1, 1, 2):
        environment.reset(seed=seed)
        pictures.append(environment.render())
    first, again, other = pictures
    assert (first.shape, first.dtype) == ((480, 640, 3), np.uint8)
    red = (first[..., 0] > 120) & (first[..., 1:].max(axis=2) < 70)
    assert 0.01 < red[120:400, 160:560].mean() < 0.5  # the tractor, in the middle
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)  # another field
    environment.close()
    assert FieldTrial("grass", STRAIGHT).render() is None


def test_a_residual_of_nothing_is_the_controller_bit_for_bit(driven):
    _, record = driven
    environment = gymnasium.make(ENVIRONMENT, overrides=STRAIGHT, action="residual")
    states, *_ = repeat(environment, np.zeros_like(commands(record)))
    np.testing.assert_array_equal(states, at_ticks(record))


def test_normalised_commands_span_the_limits_and_drive_the_same_way(driven):
    _, record = driven
    lower, upper = (
        record[CONTROL].columns(
            *(f"{name}_{end}" for name in ("delta_t_rad", "delta_i_rad", "hp"))
        )[0]
        for end in ("min", "max")
    )
    actions = 2.0 * (commands(record) - lower) / (upper - lower) - 1.0
    environment = gymnasium.make(ENVIRONMENT, overrides=STRAIGHT)
    states, *_ = repeat(environment, actions)
    np.testing.assert_allclose(states, at_ticks(record), atol=1e-6)


def test_a_seed_draws_the_run_and_those_that_follow_it():
    environment = gymnasium.make(ENVIRONMENT, overrides=STRAIGHT)
    first, info = environment.reset(seed=3)
    assert info["seed"] == 3
    second, following = environment.reset()
    again, _ = environment.reset(seed=3)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, second)
    assert environment.reset()[1]["seed"] == following["seed"]


def test_a_lost_vehicle_ends_the_run_and_never_pays():
    """Full lock drives in a circle: the supervisor stops it away from its reference."""
    environment = FieldTrial("grass", ("path={kind='straight', length_m=30}",))
    environment.reset(seed=1)
    total, terminated, periods = 0.0, False, 0
    while not terminated:
        _, gained, terminated, truncated, info = environment.step(np.array([1.0, 0.0, 1.0]))
        assert not truncated
        total, periods = total + gained, periods + 1
    assert info["status"] in ("stopped", "lost")
    assert info["failure"]
    assert periods < 150  # the path takes 30 s
    assert 0.0 < total < periods  # each from 0 to 1, and none for what is left
    with pytest.raises(ResetNeeded):
        environment.step(np.zeros(3))


def test_an_action_that_is_no_number_is_the_last_command():
    environment = FieldTrial("grass", STRAIGHT)
    environment.reset(seed=1)
    start = environment.step(np.array([0.0, 0.0, 0.4]))[0]
    observation, _, terminated, _, info = environment.step(np.full(3, math.nan))
    assert not terminated
    assert "not finite" in info["fallback"]
    np.testing.assert_array_equal(observation[-3:], start[-3:])  # the command that was sent
    for action, named in ((np.zeros(2), r"shape \(2,\)"), ([0, 0, 10**400], "three numbers")):
        with pytest.raises(ValueError, match=named):
            environment.step(action)


def test_options_are_refused_in_a_line_and_code_of_a_file_needs_trust(tmp_path):
    for options, message in (
        ({"action": "torque"}, "action: must be command or residual"),
        ({"residual_share": 0.0}, "residual_share: "),
        ({"render_mode": "human"}, "render_mode: "),
        ({"residual_share": "1"}, "residual_share: "),
        ({"trust": np.ones((3, 1))}, "trust: "),
        ({"overrides": 1}, "overrides: "),
    ):
        with pytest.raises(BadOptions, match=message):
            FieldTrial("grass", **options)
    file = tmp_path / "strange.toml"
    file.write_text('[controller]\nname = "os:abort"\n')
    with pytest.raises(InvalidScenario, match="os:abort"):
        FieldTrial(str(file))
    with pytest.raises(BadOptions, match="seed"):
        FieldTrial("grass", STRAIGHT).reset(seed=2**32)


def test_the_reward_falls_from_1_with_the_error_and_never_reaches_0():
    still = (0.0, 0.0, 0.0)
    assert reward((0.0, 0.0), still) == 1.0
    assert reward((0.1, 0.1), still) == pytest.approx(0.5)
    distances = (0.01, 0.1, 1.0, 10.0, 1000.0)
    found = [reward((distance, distance), still) for distance in distances]
    assert found == sorted(found, reverse=True)
    assert found[-1] > 0.0
    assert reward((0.1, 0.0), still) == reward((0.0, 0.1), still) > 0.5
    assert reward((0.1, 0.1), (1.0, -1.0, 1.0)) < 0.5


def test_an_episode_has_as_many_steps_as_told(driven):
    environment = FieldTrial("grass", STRAIGHT)
    assert environment.max_episode_steps == len(driven[1][CONTROL].time_s)


def test_a_vector_steps_each_run_as_alone():
    """The second environment of a vector that is reset with a seed drives the next seed."""
    action = np.array([0.1, -0.1, 0.3], np.float32)
    alone = []
    for seed in (SEED, SEED + 1):
        environment = FieldTrial("grass", STRAIGHT)
        environment.reset(seed=seed)
        alone.append([environment.step(action)[:2] for _ in range(3)])
    vector = gymnasium.make_vec(ENVIRONMENT, num_envs=2, overrides=STRAIGHT)
    try:
        vector.reset(seed=SEED)
        for k in range(3):
            observations, rewards, *_ = vector.step(np.stack([action, action]))
            for place in (0, 1):
                np.testing.assert_array_equal(observations[place], alone[place][k][0])
                assert rewards[place] == alone[place][k][1]
    finally:
        vector.close()
    with pytest.raises(BadOptions, match="num_envs"):
        gymnasium.make_vec(ENVIRONMENT, num_envs=0, overrides=STRAIGHT)
