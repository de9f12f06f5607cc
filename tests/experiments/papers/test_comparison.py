"""Tables of comparisons from rows of known errors: ratios, verdicts, leads, lost runs."""

import math

import numpy as np
import pandas as pd
import pytest
from proving_ground.experiments.papers.leads import MARGIN_CM, leads, leads_sentence
from proving_ground.experiments.papers.studies import comparison as module
from proving_ground.experiments.results.summary import ACTUATOR_USE
from proving_ground.experiments.sweep.results import frame
from proving_ground.experiments.sweep.row import no_figures
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
    text = module.by_field(rows)
    assert line(text, "`old-valves`")[4] == "`pid`"
    assert "Ahead of `ttempc`: `pid` on `old-valves` (" in text
    assert "on 1 of 4 fields (`old-valves`), significantly on `old-valves`." in text
    assert line(module.headline(rows), "`old-valves`")[-1] == "5 of 5 lost"
    block = module.controllers(rows)
    assert block.files["compare.png"].startswith(b"\x89PNG")
    cells = line(block.text, "`pid`")
    assert cells[5:7] == ["1 / 3", "0 of 20"]
    assert len(cells) == 7 + len(ACTUATOR_USE)
    assert line(block.text, "`old-valves`")[2].endswith("<")
    assert line(block.text, "`old-valves`")[3] == "5 of 5 lost"
    published = line(module.errors(rows), "published (field)")
    assert published[1:5] == ["23.49", "21.21", "39.82", "36.21"]


def test_sweeps_stand_side_by_side_with_the_paired_difference(rows):
    text = module.side_by_side(pd.concat([rows.assign(study=name) for name in module.SWEEPS]))
    for name in module.SWEEPS:
        cells = line(text, f"`{name}`")
        assert cells[1] == str(len(rows))
        assert cells[5].endswith("5 of 20 lost")
        assert cells[6].endswith("of 20")


def runs(place, controller, errors):
    columns = {"place": place, "pair": range(len(errors)), "controller": controller}
    return pd.DataFrame({**columns, "error_cm": errors})


def found(*frames, default="own"):
    return list(leads(pd.concat(frames), default))


def test_a_lead_is_a_mean_over_pairs_beyond_the_margin():
    own = runs("a", "own", [2.0, 3.0])
    near = runs("a", "near", [2.0 - MARGIN_CM, 3.0 - 0.9 * MARGIN_CM])
    ((place, controller, error_cm, fewer),) = found(own, near, runs("a", "far", [2.4, 2.4]))
    assert (place, controller, fewer) == ("a", "far", 0)
    assert error_cm == pytest.approx(0.1)


def test_a_pair_with_a_lost_run_counts_as_a_lost_run_alone():
    own = runs("a", "own", [2.0, math.nan, math.nan])
    other = runs("a", "other", [2.0, 1.0, math.nan])
    assert found(own, other) == [("a", "other", 0.0, 1)]
    assert found(own, other, default="other") == []


def test_runs_that_the_default_one_did_not_drive_are_no_lead():
    assert found(runs("a", "own", [2.0]), runs("b", "other", [1.0])) == []


def test_the_sentence_names_every_lead_and_counts_the_other_places():
    ahead = [runs("a", "own", [2.0]), runs("a", "other", [1.0])]
    level = [runs("b", "own", [2.0]), runs("b", "other", [2.0])]
    text = leads_sentence(pd.concat([*ahead, *level]), "fields", "own")
    assert text.startswith("Ahead of `own`: `other` on `a` (1.00 cm). On 1 of 2 fields none of")
