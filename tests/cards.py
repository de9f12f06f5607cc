"""A scenario's plant on the bench."""

from experiments.card import bench
from experiments.scenario import load


def bench_of(name, *overrides):
    return bench(load(name, overrides)[1])
