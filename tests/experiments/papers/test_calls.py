"""Python calls of a control period: exact counts, which no load changes."""

from proving_ground.experiments.papers.benchmarks import calls_of_a_period

GUIDANCE, PERIOD = 60, 150


def test_a_period_in_memory_makes_few_python_calls():
    counts = calls_of_a_period(("path={kind='straight',length_m=20}",))
    assert counts["update"] + counts["step"] <= GUIDANCE, counts
    assert sum(counts.values()) <= PERIOD, counts
