"""Tables of comparisons from rows of known errors; both tables of the benchmark."""

import math

import numpy as np
import pandas as pd
import pytest
from proving_ground.experiments.papers.pages import ROOT, blocks
from proving_ground.experiments.papers.studies import comparison as module
from proving_ground.experiments.results.summary import ACTUATOR_USE
from proving_ground.experiments.studies.sweep.results import frame
from proving_ground.experiments.studies.sweep.row import no_figures
from proving_ground.experiments.studies.trials.definition import is_scored, trial_files
from proving_ground.testbed.randomness import generator

FIELDS = ("grass", "old-valves", "split", "wet-slope")
FACTORS = {"ttempc": 1.0, "pid": 1.25, "paper": 10.0, "lqr": 1.0, "nmpc-rti": 1.1}


def figures(field, controller, seed):
    """Return figures of 2 cm times a factor of the controller and one of the seed.

    `pid` is twice as good on old valves, `lqr` now better and now worse than `ttempc`, and
    `paper` is lost on old valves.
    """
    if (field, controller) == ("old-valves", "paper"):
        return {"status": "lost", **no_figures()}
    factor = FACTORS[controller] * generator(seed, field).normal(1.0, 0.1)
    if (field, controller) == ("old-valves", "pid"):
        factor *= 0.5 / 1.25
    if controller == "lqr":
        factor *= 1.0 + 0.05 * (-1) ** seed
    if controller == "pid":
        factor *= generator(seed, f"{field} pid").normal(1.0, 0.005)
    return {"status": "completed", **dict.fromkeys(no_figures(), 0.02 * factor)}


@pytest.fixture(scope="module")
def rows():
    places = [(f, seed, c) for f in FIELDS for seed in range(201, 206) for c in FACTORS]
    names = ("run", "point", "scenario", "seed", "controller", "wall_s")
    return frame(
        {**dict(zip(names, (n, FIELDS.index(f), f, s, c, 1.0), strict=True)), **figures(f, c, s)}
        for n, (f, s, c) in enumerate(places)
    ).copy()


def line(text, first):
    """Return the cells of the row of a Markdown table that starts with `first`."""
    (found,) = (item for item in text.splitlines() if item.startswith(f"| {first}"))
    return [cell.strip() for cell in found.strip("|").split("|")]


def test_ratios_are_those_of_the_factors_and_every_field_counts_the_same(rows):
    comparison = module.Comparison(rows)
    ratio = {key: estimate.value for key, (estimate, _) in comparison.ratios.items()}
    assert ratio["split", "paper"] == pytest.approx(10.0)
    assert ratio["split", "pid"] == pytest.approx(1.25, rel=0.02)
    assert comparison.verdict("old-valves", "pid") == "better"
    assert comparison.verdict("grass", "pid") == "worse"
    assert {comparison.verdict(field, "lqr") for field in FIELDS} == {""}
    assert ("old-valves", "paper") not in ratio
    over, count = comparison.over_fields("pid")
    assert count == len(FIELDS)
    assert over.value == pytest.approx(
        math.exp(np.mean([math.log(ratio[f, "pid"]) for f in FIELDS]))
    )
    assert over.low < over.value < over.high
    assert comparison.over_fields("paper")[1] == len(FIELDS) - 1


def test_tables_show_where_the_rival_is_better_and_no_mean_over_lost_runs(rows):
    text = module.controllers(rows)
    cells = line(text, "`pid`")
    assert cells[5:7] == ["1 / 3", "0 of 20"]
    assert len(cells) == 7 + len(ACTUATOR_USE)
    assert line(text, "`old-valves`")[3].endswith("<")
    assert line(text, "`old-valves`")[4] == "5 of 5 lost"


def test_sweeps_stand_side_by_side_with_the_paired_difference(rows):
    text = module.side_by_side(pd.concat([rows.assign(study=name) for name in module.SWEEPS]))
    for name in module.SWEEPS:
        cells = line(text, f"`{name}`")
        assert cells[1] == str(len(rows))
        assert any(cell.endswith("5 of 20 lost") for cell in cells)
        assert cells[-1].endswith("of 20")


def costs(table):
    """Return costs by scenario and entry of a table whose lines are scenarios.

    Of a pair, working point / tractor, it is the first; "–" is no cost.
    """
    lines = [[cell.strip(" |`") for cell in row.split("|")[1:-1]] for row in table.splitlines()]
    return {
        row[0].split("`")[0]: dict(zip(lines[0][1:], map(first_number, row[1:]), strict=True))
        for row in lines[2:]
    }


def first_number(cell):
    return math.nan if cell == "–" else float(cell.split(" / ")[0])


def test_results_name_every_trial_at_which_a_rival_has_the_smaller_error():
    """The list below the table says of each rival where it is ahead, level and behind."""
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    table, said, _ = blocks(page)["headline"].strip().split("\n\n")
    lines = {line.split("`")[1]: line for line in said.splitlines()}
    scored = {name for name in trial_files() if is_scored(name)}
    rows = {name: row for name, row in costs(table).items() if name in scored}
    assert rows.keys() == scored
    for rival, line in lines.items():
        not_behind = line.partition("; behind in")[0]
        for name, row in rows.items():
            if row[rival] < row["ttempc"]:
                assert f"`{name}`" in not_behind, (rival, name)
