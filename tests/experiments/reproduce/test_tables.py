"""Tables from rows of known errors: ratios, verdicts, lost runs, the figure's file."""

import math
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.reproduce import comparison_tables, study_tables
from proving_ground.experiments.reproduce.comparison import Comparison, read_comparison
from proving_ground.experiments.reproduce.driver import Driver
from proving_ground.experiments.results.summary import ACTUATOR_USE
from proving_ground.experiments.sweep.engine import engine
from proving_ground.experiments.sweep.folder import lock_folder
from proving_ground.experiments.sweep.plan import SweepPlan
from proving_ground.experiments.sweep.row import FIGURES
from proving_ground.experiments.sweep.study import GridAxis, ListAxis, load_study
from proving_ground.experiments.sweep.sweep import sweep
from proving_ground.testbed.randomness import generator

FIELDS = ("grass", "old-valves", "split", "wet-slope")
FACTORS = {"ttempc": 1.0, "pid": 1.25, "paper": 10.0, "lqr": 1.0, "nmpc-rti": 1.1}


def synthetic_row(job):
    """Return a row whose errors are 2 cm times a factor of the controller and one of the seed.

    `pid` is twice as good on old valves, `lqr` now better and now worse than `ttempc`, and
    `paper` is lost on old valves.
    """
    name, controller = job.name, job.scenario.controller.name
    if (name, controller) == ("old-valves", "paper"):
        return job.row("lost", "diverged", dict.fromkeys(FIGURES), 1.0)
    factor = FACTORS[controller] * generator(job.seed, name).normal(1.0, 0.1)
    if (name, controller) == ("old-valves", "pid"):
        factor *= 0.5 / 1.25
    if controller == "lqr":
        factor *= 1.0 + 0.05 * (-1) ** job.seed
    if controller == "pid":
        factor *= generator(job.seed, f"{name} pid").normal(1.0, 0.005)
    return job.row("completed", None, dict.fromkeys(FIGURES, 0.02 * factor), 1.0)


def smaller(study):
    """Return a study with two values on every axis but that of the controllers."""
    axes = []
    for axis in study.axis:
        if isinstance(axis, GridAxis):
            axis = replace(axis, count=2)
        elif isinstance(axis, ListAxis) and "controller" not in axis.names:
            axis = replace(axis, values=axis.values[:2])
        axes.append(axis)
    return replace(study, axis=tuple(axes), samples=study.samples and 4)


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    """A driver to whom all sweeps are there, with synthetic rows."""
    folder = tmp_path_factory.mktemp("rows")
    made = Driver(folder, workers=0)
    for name in (comparison_tables.STUDY, *study_tables.SWEEPS):
        _, study = load_study(name)
        if name == comparison_tables.STUDY:
            scenarios, laps, controllers = study.axis
            assert isinstance(scenarios, ListAxis)
            assert isinstance(controllers, ListAxis)
            axes = (
                replace(scenarios, values=FIELDS),
                laps,
                replace(controllers, values=tuple(FACTORS)),
            )
            study = replace(study, axis=axes)
        else:
            study = smaller(study)
        plan, path = SweepPlan(name, study), folder / f"sweep-{name}"
        with engine(workers=0) as here, lock_folder(path, plan) as locked:
            sweep(plan, locked, here, work=synthetic_row)
        made._swept[name] = path
    return made


@pytest.fixture(scope="module")
def comparison(driver) -> Comparison:
    return read_comparison(driver.rows(comparison_tables.STUDY))


def lines(text, first):
    """Return the cells of the row of a Markdown table that starts with `first`."""
    (line,) = (line for line in text.splitlines() if line.startswith(f"| {first}"))
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_ratios_are_those_of_the_factors(comparison):
    assert comparison.ratios["split", "paper"].estimate.value == pytest.approx(10.0)
    assert comparison.ratios["split", "pid"].estimate.value == pytest.approx(1.25, rel=0.02)
    assert comparison.ratios["old-valves", "pid"].verdict == "better"
    assert comparison.ratios["grass", "pid"].verdict == "worse"
    assert {comparison.ratios[field, "lqr"].verdict for field in FIELDS} == {""}
    assert ("old-valves", "paper") not in comparison.ratios


def test_fields_count_the_same_whatever_the_size_of_their_errors(comparison):
    over, count = comparison.over_fields("pid")
    logs = [math.log(comparison.ratios[field, "pid"].estimate.value) for field in FIELDS]
    assert count == len(FIELDS)
    assert over.value == pytest.approx(math.exp(np.mean(logs)))
    assert over.low < over.value < over.high
    assert comparison.over_fields("paper")[1] == len(FIELDS) - 1


def test_the_table_by_field_says_where_the_rival_is_better(driver):
    text = comparison_tables.by_field(driver).block
    assert lines(text, "`old-valves`")[4] == "`pid`"
    assert lines(text, "`grass`")[1] == "filter, tube"
    assert "Ahead of `ttempc`: `pid` on `old-valves` (" in text
    rivals = "`pid`, `paper`, `lqr`, `nmpc-rti`"
    assert f"fields none of {rivals} is ahead of `ttempc` by more than 0.05 cm" in text
    assert "on 1 of 4 fields (`old-valves`), significantly on `old-valves`." in text
    assert "fields (`grass`, `split`, `wet-slope`), significantly on `grass`, `split`" in text


def test_the_headline_shows_no_mean_of_a_field_with_lost_runs(driver):
    text = comparison_tables.headline(driver).block
    assert lines(text, "`old-valves`")[-1] == "5 of 5 lost"
    assert lines(text, "`grass`")[1].count("/") == 1


def test_the_table_of_controllers_marks_fields_and_brings_its_figure(driver):
    product = comparison_tables.controllers(driver)
    assert set(product.files) == {"compare.png"}
    assert "](compare.png)" in product.block
    costs = lines(product.block, "`pid`")
    assert costs[5:7] == ["1 / 3", "0 of 20"]
    assert len(costs) == 7 + len(ACTUATOR_USE)
    travel, share = (float(cell) for cell in costs[-2:])  # made-up rows: one number for all
    assert travel == share > 0.0
    field = lines(product.block, "`old-valves`")
    assert field[2].endswith("<")
    assert field[3] == "5 of 5 lost"


def test_the_published_errors_stand_below_those_of_the_paper(driver):
    text = comparison_tables.errors(driver).block
    assert lines(text, "published (field)")[1:5] == ["23.49", "21.21", "39.82", "36.21"]
    assert text.count("published (field)") == 1
    assert "`grass`, `old-valves`, `wet-slope`." in text


def test_the_studies_stand_side_by_side(driver):
    text = study_tables.studies(driver).block
    for name in study_tables.SWEEPS:
        assert lines(text, f"[{name}]")[1] == str(driver.sweep(name).planned)
    assert "On 5 of 5 studies none of" in text


def test_the_page_of_a_study_brings_its_pictures(driver):
    product = study_tables.sweep_page("delay")(driver)
    assert product.block.startswith("# delay\n")
    assert product.files
    assert all(f"]({name})" in product.block for name in product.files)
