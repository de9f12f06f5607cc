"""Every benchmark runs its smallest job; speeds are not judged, a loaded machine would fail."""

import math
import sys

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


def test_the_tail_of_a_step_is_longer_than_its_median():
    named = values(benchmarks.ticks(STRAIGHT))
    for kind in benchmarks.PAUSES:
        quantiles = [named[f"step, {kind}, {name}"] for name in ("median", "p99", "max")]
        assert quantiles == sorted(quantiles)


def test_a_loop_costs_more_than_its_physics():
    named = values(benchmarks.loop_ratio((2.0, 8.0), repeats=1, blocks=2))
    loop, logged = (named[f"loop {log} log / bare step"] for log in ("without", "with"))
    assert logged > loop > named["physics on soil / bare step"]


def test_a_process_that_nobody_waits_for_is_counted():
    """The command ends at once; what it started burns half a second of processor time after it."""
    burn = "import time\nwhile time.process_time() < 0.5: pass"
    words = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {burn!r}])"
    assert benchmarks.process_s(sys.executable, "-c", words) > 0.5


@pytest.mark.parametrize("part", ["start-up", "sweep", "threads"])
def test_other_parts(part):
    values(benchmarks.PARTS[part]())


def test_a_lap_with_its_log_costs_more_than_one_without():
    named = values(benchmarks.eight_ratio(repeats=1))
    assert named["lap with log / own bare step"] > named["lap without log / own bare step"] > 1.0
