"""Python calls of a control period: exact counts, which no load changes."""

from proving_ground.experiments.papers.benchmarks import calls_of_a_period

GUIDANCE, LOOP = 270, 64  # the goals are 60 and 90, in sum 150


def test_a_period_in_memory_makes_few_python_calls():
    counts = calls_of_a_period(("path={kind='straight',length_m=20}",))
    guidance = counts["update"] + counts["step"]
    assert guidance <= GUIDANCE

    assert sum(counts.values()) - guidance <= LOOP, counts
