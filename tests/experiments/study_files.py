"""Studies for tests: a few metres of straight path, a fraction of a second per run."""

from proving_ground.experiments.studies.sweep.plan import SweepPlan
from proving_ground.experiments.studies.sweep.study import load_study

SHORT = """
[set.path]
kind = "straight"
length_m = 2.0
"""
CONTROLLERS = """
[[axis]]
kind = "list"
key = "controller"
values = ["paper", "feedforward"]
"""
STRENGTHS = """
[[axis]]
kind = "grid"
key = "soil.cone_index_kpa"
low = 200.0
high = 800.0
count = 3
"""


def plan_of(folder, *parts, name="tiny"):
    file = folder / f"{name}.toml"
    file.write_text("\n".join(parts))
    return SweepPlan(*load_study(str(file)))
