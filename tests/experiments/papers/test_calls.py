"""Python calls of a control period: exact counts, which no load changes."""

from proving_ground.experiments.papers.benchmarks import calls_of_a_period

GUIDANCE, PERIOD = 700, 770  # the goals are 60 and 150


def test_a_period_in_memory_makes_few_python_calls():
    counts = calls_of_a_period(("path={kind='straight',length_m=20}",))
    guidance = counts["update"] + counts["step"]
    assert guidance <= GUIDANCE
    assert sum(counts.values()) <= PERIOD
    assert sum(counts.values()) - guidance <= 66, counts
