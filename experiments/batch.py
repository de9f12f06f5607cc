"""Many runs in memory, side by side in processes; each has its own seed and shares nothing."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

from tqdm import tqdm

from experiments.published import compare
from experiments.run import simulate
from experiments.scenario import load
from experiments.summary import Summary


@dataclass(frozen=True, slots=True)
class Job:
    """One run to be made."""

    scenario: str
    seed: int
    overrides: tuple[str, ...] = ()


def summaries(jobs: Sequence[Job]) -> Iterator[tuple[Job, Summary]]:
    """Return job and numbers of every run, in the order of the jobs, on all cores."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        yield from zip(jobs, tqdm(pool.map(_run, jobs), total=len(jobs)), strict=True)


def mean_errors_cm(summary: Summary) -> list[float]:
    """Return the four mean Euclidean errors of the paper's table [cm], NaN where there is none."""
    measured = (item.measured_m for item in compare(summary))
    return [float("nan") if error is None else 100.0 * error for error in measured]


def _run(job: Job) -> Summary:
    return simulate(*load(job.scenario, job.overrides), job.seed)[0]
