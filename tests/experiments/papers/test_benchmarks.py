"""Every benchmark runs its smallest job; speeds are not judged, a loaded machine would fail."""

import math

import pytest
from proving_ground.experiments.papers import benchmarks

pytestmark = pytest.mark.slow  # of the papers, not of the product

STRAIGHT = ("path={kind='straight', length_m=3}",)


def values(figures):
    """Return the values of a benchmark by name; each is finite and above 0."""
    named = {figure.name: figure.value for figure in figures}
    assert len(named) == len(figures)
    assert all(math.isfinite(value) and value > 0.0 for value in named.values()), named
    return named


def test_a_step_costs_more_with_the_solver_and_its_tail_more_than_its_median():
    named = values(benchmarks.control_step(ticks=60, repeats=2))
    assert named["`ttempc` step, QP without active bounds"] < named["`ttempc` step with PIQP"]
    named = values(benchmarks.latency(ticks=60, repeats=1, pause_s=0.001))
    for kind in benchmarks.KINDS:
        quantiles = [named[f"{kind}, {name}"] for name in ("median", "p99", "p99.9", "max")]
        assert quantiles == sorted(quantiles)


def test_a_loop_costs_more_than_its_physics():
    values(benchmarks.closed_loop(STRAIGHT))
    named = values(benchmarks.loop_ratio((2.0, 8.0), repeats=1, blocks=2))
    loop, logged = (named[f"loop {log} log / bare step"] for log in ("without", "with"))
    assert logged > loop > named["physics on soil / bare step"]


@pytest.mark.slow
@pytest.mark.parametrize("part", ["start-up", "sweep"])
def test_other_parts(part):
    values(benchmarks.PARTS[part]())
