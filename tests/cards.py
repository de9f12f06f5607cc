"""A scenario's plant on the bench."""

from proving_ground.experiments.pictures.report.validation_report import bench
from proving_ground.experiments.scenario.scenario import load


def bench_of(name, *overrides):
    return bench(load(name, overrides)[1])
