"""Sweeps of synthetic rows, for tests of their reports."""

from proving_ground.experiments.studies.sweep.engine import engine
from proving_ground.experiments.studies.sweep.folder import lock_folder
from proving_ground.experiments.studies.sweep.row import no_figures
from proving_ground.experiments.studies.sweep.sweep import sweep
from proving_ground.testbed.randomness import generator

from tests.experiments.study_files import plan_of

ERROR = "tracking.all.trailer.cross_p95_m"
COST = "timing.control_step_us.median"

AXES = """
[[axis]]
kind = "list"
key = "terrain.iso_class"
values = ["A", "C", "E"]

[[axis]]
kind = "grid"
key = "soil.cone_index_kpa"
low = 150.0
high = 2000.0
count = 4
spacing = "log"

[[axis]]
kind = "list"
key = "controller"
values = ["paper", "ttempc", "feedforward"]
"""
DRAWN = """
samples = 20

[[axis]]
kind = "latin-hypercube"
key = "controller.vehicle.wheelbase_m"
relative = true
low = 0.8
high = 1.2
"""


def synthetic_row(job):
    """Return a row without a run; harder ground is worse, and `feedforward` fails on class E."""
    controller, iso_class = job.scenario.controller.name, job.scenario.terrain.iso_class
    noise = generator(job.seed, "made up").normal(1.0, 0.1)
    error = 0.02 * noise * {"paper": 10.0, "feedforward": 20.0}.get(controller, 1.0)
    error *= {"C": 2.0, "E": 3.0}.get(iso_class, 1.0)
    if controller == "feedforward" and iso_class == "E":
        return job.row("lost", "roll-over <at> the & fence", no_figures(), 0.1)
    numbers = {**no_figures(), ERROR: error, COST: 100.0 * error}
    return job.row("completed", None, numbers, 0.1)


def swept(folder, *parts, most=None, name="made-up", work=synthetic_row):
    """Return the folder of a sweep, of its first runs alone if `most` is given."""
    path, plan = folder / f"sweep-{name}", plan_of(folder, *parts, name=name)

    def stop(progress):
        if progress.done == most:
            raise KeyboardInterrupt

    with engine(workers=0) as inside, lock_folder(path, plan) as locked:
        try:
            sweep(plan, locked, inside, stop, work)
        except KeyboardInterrupt:
            assert most is not None
    return path
