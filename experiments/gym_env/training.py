"""Training of a linear policy in the environment by CMA-ES, on one core, without a network.

    python -m experiments.gym_env.training -o policy.toml

Every generation drives each candidate on the same scenarios with the same seed, a new one from
generation to generation. The written policy is the mean of the search distribution. CMA-ES:
Hansen (2016), "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import gymnasium
import numpy as np
from cmaes import CMA

from ttempc.types import FloatArray

from ..output import refuse_existing, write_file
from ..policy.linear_policy import LinearPolicy
from ..seeds import TUNING
from . import ENVIRONMENT_ID

CONTROLLER: Final = "pid"
SCENARIOS: Final = ("wet-slope", "patchy")
PERIODS: Final = 250  # of an episode: 50 s, a circle of the figure eight and a straight
SHARE: Final = 0.25
_SPREAD: Final = 0.3  # of the first generation, in actions at the size below

# Entries that an input may depend on, each with its size in a run of `pid` [SI]; assumed. Lateral
# entries act on the steering and longitudinal ones on the drive, so that a field and its mirror
# image give mirrored actions.
_LATERAL: Final = {
    "y_t_e_m": 0.05,
    "psi_t_e_rad": 0.03,
    "y_i_e_m": 0.05,
    "psi_i_e_rad": 0.03,
    "slip_t_rad": 0.05,
    "slip_i_rad": 0.05,
    "steering_rad": 0.03,
}
_ENTRIES: Final = {
    "delta_t": _LATERAL,
    "delta_i": _LATERAL,
    "hp": {"x_t_e_m": 0.1, "v_e_mps": 0.1, "drive_mps2": 0.1, "wheel_slip": 0.1},
}
DIMENSION: Final = sum(len(sizes) for sizes in _ENTRIES.values())


def policy(parameters: FloatArray, about: str = "") -> LinearPolicy:
    """Return the policy of parameters (DIMENSION,): gains times the sizes of their entries."""
    values = iter(parameters.tolist())
    gains = {
        name: {entry: float(f"{next(values) / size:.4g}") for entry, size in sizes.items()}
        for name, sizes in _ENTRIES.items()
    }
    return LinearPolicy(1, about, CONTROLLER, SHARE, gains)  # pyright: ignore[reportArgumentType]


def episode(environment: gymnasium.Env, gains: FloatArray, seed: int) -> float:
    """Return the mean reward of a period in a run of a policy with `gains` (3, n)."""
    observation, _ = environment.reset(seed=seed)
    total, count, ended = 0.0, 0, False
    while not ended:
        action = np.clip(gains @ observation, -1.0, 1.0)
        observation, reward, terminated, truncated, _ = environment.step(action)
        total, count, ended = total + float(reward), count + 1, terminated or truncated
    return total / count


def environments(scenarios: Sequence[str], periods: int) -> list[gymnasium.Env]:
    """Return an environment of each scenario that ends after `periods`."""
    overrides = [f"controller.name={CONTROLLER}", "controller.learn=false"]
    return [
        gymnasium.make(
            ENVIRONMENT_ID,
            max_episode_steps=periods,
            scenario=scenario,
            overrides=overrides,
            action="residual",
            normalised=False,
            residual_share=SHARE,
        )
        for scenario in scenarios
    ]


def train(
    scenarios: Sequence[str], periods: int, generations: int, population: int, seed: int
) -> Iterator[LinearPolicy]:
    """Yield the policy after every generation; its reward is printed beside that without it.

    Args:
        scenarios: to drive.
        periods: of an episode.
        generations: of the search.
        population: candidates of a generation.
        seed: of the search.
    """
    trials = environments(scenarios, periods)
    search = CMA(mean=np.zeros(DIMENSION), sigma=_SPREAD, population_size=population, seed=seed)

    def mean_reward(parameters: FloatArray, run_seed: int) -> float:
        gains = policy(parameters).matrix()
        return float(np.mean([episode(trial, gains, run_seed) for trial in trials]))

    begin = time.monotonic()
    for generation in range(generations):
        run_seed = TUNING[generation % len(TUNING)]
        candidates = [search.ask() for _ in range(population)]
        rewards = [mean_reward(candidate, run_seed) for candidate in candidates]
        search.tell([(x, -value) for x, value in zip(candidates, rewards, strict=True)])
        line = f"{generation:3d} seed {run_seed:3d} best {max(rewards):8.4f}"
        line += f" median {np.median(rewards):8.4f} {time.monotonic() - begin:6.0f} s"
        if generation % 5 == 0:
            line += f"  mean of the search {mean_reward(search.mean, run_seed):8.4f}"
            line += f", {CONTROLLER} alone {mean_reward(np.zeros(DIMENSION), run_seed):8.4f}"
        print(line, flush=True)
        about = (
            f"CMA-ES, {generation + 1} generations of {population}, seed {seed}, on "
            f"{', '.join(scenarios)} with seeds from {TUNING[0]} to {run_seed}, {periods} periods"
        )
        yield policy(search.mean, about)


def main(arguments: Sequence[str] | None = None) -> None:
    """Train and write a policy file."""
    parser = argparse.ArgumentParser(prog="training", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FILE.toml")
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS, metavar="NAME")
    parser.add_argument("--periods", type=int, default=PERIODS, metavar="N")
    parser.add_argument("--generations", type=int, default=15, metavar="N")
    parser.add_argument("--population", type=int, default=12, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    given = parser.parse_args(arguments)
    refuse_existing(given.out)
    search = (given.scenarios, given.periods, given.generations, given.population, given.seed)
    for trained in train(*search):
        write_file(given.out, trained.to_toml())


if __name__ == "__main__":
    main()
