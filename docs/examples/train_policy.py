"""Policy trained with PPO of stable-baselines3, as a residual on `feedforward`.

    python train_policy.py -o ppo.toml         in this folder, with the extra `rl`
    ttempc run grass --controller learnt_policy:learnt --set controller.options.policy=ppo.toml

trains on one core. The actor is linear in the entries of `learnt_policy.py`, so that its weights
are gains: that file drives the policy, without torch. The critic is a network of two layers. PPO:
Schulman et al. (2017), "Proximal policy optimization algorithms", arXiv:1707.06347.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import gymnasium
import numpy as np
import tomli_w
import torch
from gymnasium.spaces import Box
from learnt_policy import SIZES, Gains
from proving_ground.experiments.interfaces.gym_env.policy import ESTIMATE_NAMES
from stable_baselines3 import PPO
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from proving_ground.gym import ENVIRONMENT_ID
from ttempc.types import Input

CONTROLLER: Final = "feedforward"
SCENARIOS: Final = ("grass", "wet-slope")  # of the training
PERIODS: Final = 250  # of an episode: 50 s
SHARE: Final = 0.5  # of half the range of a command that an action of 1 adds
_PLACES: Final = [ESTIMATE_NAMES.index(name) for name in SIZES]
_SIZES: Final = np.array([*SIZES.values()], np.float32)


def environment(scenario: str, periods: int) -> gymnasium.Env:
    """Return the environment whose observations are the entries of `SIZES`, divided by them."""
    made = gymnasium.make(
        ENVIRONMENT_ID,
        max_episode_steps=periods,
        scenario=scenario,
        overrides=[f"controller.name={CONTROLLER}", "controller.learn=false"],
        action="residual",
        normalised=False,
        residual_share=SHARE,
    )
    space = Box(-10.0, 10.0, (len(SIZES),), np.float32)

    def entries(observation: np.ndarray) -> np.ndarray:
        return np.clip(observation[_PLACES] / _SIZES, -10.0, 10.0)

    return gymnasium.wrappers.TransformObservation(Monitor(made), entries, space)


def train(scenarios: Sequence[str], periods: int, steps: int, seed: int) -> Gains:
    """Return the gains after as many control periods."""
    torch.set_num_threads(1)  # networks of this size lose by more
    drives = DummyVecEnv([lambda name=name: environment(name, periods) for name in scenarios])
    model = PPO(
        "MlpPolicy",
        VecNormalize(drives, norm_obs=False, gamma=0.97),
        learning_rate=lambda left: 1e-3 + 3e-3 * left,
        n_steps=500,
        batch_size=250,
        gamma=0.97,  # 7 s
        policy_kwargs={"net_arch": {"pi": [], "vf": [64, 64]}, "log_std_init": -2.0},
        seed=seed,
        device="cpu",
        verbose=1,
    )
    torch.nn.init.zeros_(model.policy.action_net.weight)
    model.policy.action_net.bias.requires_grad_(False)  # no vehicle is steered to one side
    model.learn(steps)
    rows = (model.policy.action_net.weight.detach().numpy() / _SIZES).tolist()
    rounded = ([float(f"{gain:.4g}") for gain in row] for row in rows)
    return {
        u.name.lower(): dict(zip(SIZES, row, strict=True))
        for u, row in zip(Input, rounded, strict=True)
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Train, and write a policy file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FILE.toml")
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS, metavar="NAME")
    parser.add_argument("--periods", type=int, default=PERIODS, metavar="N")
    parser.add_argument("--steps", type=int, default=150_000, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    given = parser.parse_args(arguments)
    gains = train(given.scenarios, given.periods, given.steps, given.seed)
    about = f"PPO, {given.steps} periods, seed {given.seed}, on {', '.join(given.scenarios)}"
    head = {"format": 1, "about": about, "controller": CONTROLLER, "share": SHARE}
    given.out.write_text(tomli_w.dumps({**head, "gains": gains}), encoding="utf-8")


if __name__ == "__main__":
    main()
