"""Linear policy as a residual on `pid`, trained in the Gymnasium environment by CMA-ES.

    ttempc run grass --controller learnt_policy:learnt         in this folder: the trained one
    python learnt_policy.py -o policy.toml

trains on one core, without a network: each generation drives all candidates on the same scenarios
with the same seed, the next one with the next seed. The written policy is the mean of the search
distribution. CMA-ES: Hansen (2016), "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomli_w
from proving_ground.experiments.interfaces.gym_env.policy import (
    ESTIMATE_NAMES,
    EstimateObserver,
    add_residual,
)
from proving_ground.experiments.seeds import TUNING

from proving_ground.gym import ENVIRONMENT_ID
from ttempc.guidance.controllers import make_controller
from ttempc.reference.reference import Reference
from ttempc.types import Controller, Estimate, FloatArray
from ttempc.vehicle import Vehicle

TRAINED: Final = Path(__file__).with_suffix(".toml")
SCENARIOS: Final = ("wet-slope", "patchy")  # of the training
PERIODS: Final = 250  # of an episode: 50 s, a circle of the figure eight and a straight
SHARE: Final = 0.25  # of half the range of a command that an action of 1 adds
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
SIZES: Final = _ENTRIES["delta_t"] | _ENTRIES["hp"]
"""Entries that a policy may depend on, each with its size."""

DIMENSION: Final = sum(len(sizes) for sizes in _ENTRIES.values())

Gains = dict[str, dict[str, float]]
"""Gain of an input's action in [-1, 1] on each named entry of the observation; of others 0."""


def matrix(gains: Gains) -> FloatArray:
    """Return gains as a matrix, (3, n) in the order of `Input` and `ESTIMATE_NAMES`."""
    result = np.zeros((len(_ENTRIES), len(ESTIMATE_NAMES)))
    for row, name in enumerate(_ENTRIES):
        for entry, gain in gains.get(name, {}).items():
            result[row, ESTIMATE_NAMES.index(entry)] = gain
    return result


def learnt(
    vehicle: Vehicle, reference: Reference, period_s: float, policy: str = str(TRAINED)
) -> Controller:
    """Return the controller of a policy file; a factory for `module:factory` in a scenario."""
    content = tomllib.loads(Path(policy).read_text(encoding="utf-8"))
    gains, observer = matrix(content["gains"]), EstimateObserver(reference, period_s)

    def residual(estimate: Estimate, k: int, sent: FloatArray) -> FloatArray:
        return gains @ observer.observe(estimate, k, sent)

    inner = make_controller(content["controller"], vehicle, reference, period_s)
    return add_residual(inner, residual, content["share"], reference, period_s)


def gains_of(parameters: FloatArray) -> Gains:
    """Return gains from parameters (DIMENSION,): actions at the sizes of the entries."""
    values = iter(parameters.tolist())
    return {
        name: {entry: float(f"{next(values) / size:.4g}") for entry, size in sizes.items()}
        for name, sizes in _ENTRIES.items()
    }


def _episode(environment: Any, gains: FloatArray, seed: int, periods: int) -> float:
    """Return the mean reward of a period under `gains` (3, n); after an early end it is 0."""
    observation, _ = environment.reset(seed=seed)
    total = 0.0
    ended = False
    while not ended:
        action = np.clip(gains @ observation, -1.0, 1.0)
        observation, reward, terminated, truncated, _ = environment.step(action)
        total += float(reward)
        ended = terminated or truncated
    return total / periods


def train(
    scenarios: Sequence[str], periods: int, generations: int, population: int, seed: int
) -> Iterator[Gains]:
    """Yield the gains after every generation; rewards are printed.

    Args:
        scenarios: to drive.
        periods: of an episode.
        generations: of the search.
        population: candidates of a generation.
        seed: of the search.
    """
    import gymnasium  # a run of the trained policy does without both
    from cmaes import CMA

    trials = [
        gymnasium.make(
            ENVIRONMENT_ID,
            max_episode_steps=periods,
            scenario=scenario,
            overrides=["controller.name=pid", "controller.learn=false"],
            action="residual",
            normalised=False,
            residual_share=SHARE,
        )
        for scenario in scenarios
    ]
    search = CMA(mean=np.zeros(DIMENSION), sigma=_SPREAD, population_size=population, seed=seed)
    for generation in range(generations):
        run_seed = TUNING[generation % len(TUNING)]
        candidates = [search.ask() for _ in range(population)]
        rewards = []
        for candidate in (*candidates, np.zeros(DIMENSION)):
            gains = matrix(gains_of(candidate))
            found = [_episode(trial, gains, run_seed, periods) for trial in trials]
            rewards.append(float(np.mean(found)))
        *rewards, alone = rewards
        search.tell([(x, -value) for x, value in zip(candidates, rewards, strict=True)])
        print(f"{generation:3d} best {max(rewards):8.4f}, pid alone {alone:8.4f}", flush=True)
        yield gains_of(search.mean)


def main(arguments: Sequence[str] | None = None) -> None:
    """Train and write a policy file after every generation."""
    parser = argparse.ArgumentParser(prog="papers.policy", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FILE.toml")
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS, metavar="NAME")
    parser.add_argument("--periods", type=int, default=PERIODS, metavar="N")
    parser.add_argument("--generations", type=int, default=15, metavar="N")
    parser.add_argument("--population", type=int, default=12, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    given = parser.parse_args(arguments)
    search = (given.scenarios, given.periods, given.generations, given.population, given.seed)
    for number, gains in enumerate(train(*search), 1):
        about = (
            f"CMA-ES, {number} generations of {given.population}, seed {given.seed}, on "
            f"{', '.join(given.scenarios)}, {given.periods} periods"
        )
        head = {"format": 1, "about": about, "controller": "pid", "share": SHARE}
        given.out.write_text(tomli_w.dumps({**head, "gains": gains}), encoding="utf-8")


if __name__ == "__main__":
    main()
