"""Many runs in memory, for a study's table, on the engine of the sweeps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from tqdm import tqdm

from ..results.published import compare
from ..results.summary import Summary
from ..run.simulate import simulate
from ..scenario.scenario import load
from ..sweep.engine import engine, flow


@dataclass(frozen=True, slots=True)
class Job:
    """One run to be made."""

    scenario: str
    seed: int
    overrides: tuple[str, ...] = ()


def as_they_end(jobs: Sequence[Job], workers: int | None = None) -> Iterator[tuple[Job, Summary]]:
    """Yield job and numbers of every run as it ends; `workers` are those of `engine`."""
    with engine(workers) as cores, tqdm(total=len(jobs)) as bar:
        for job, future in flow(cores, _run, jobs):
            yield job, future.result()
            bar.update()


def summaries(jobs: Sequence[Job]) -> Iterator[tuple[Job, Summary]]:
    """Return job and numbers of every run, in the order of the jobs, on all cores."""
    finished = dict(as_they_end(jobs))
    yield from ((job, finished[job]) for job in jobs)


def mean_errors_cm(summary: Summary) -> list[float]:
    """Return the four mean Euclidean errors of the paper's table [cm], NaN where there is none."""
    measured = (item.measured_m for item in compare(summary))
    return [float("nan") if error is None else 100.0 * error for error in measured]


def _run(job: Job) -> Summary:
    return simulate(*load(job.scenario, job.overrides), job.seed)[0]
