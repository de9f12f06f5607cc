"""A scenario's plant on the bench."""

from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.validation.validation_report import bench


def bench_of(name, *overrides):
    return bench(load(name, overrides)[1])
