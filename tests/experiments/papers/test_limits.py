"""Tables of the oracle, of regret and of working speed, from made-up runs."""

import json

import numpy as np
import pandas as pd
import pytest
from proving_ground.experiments.papers.studies import limits, working_speed
from proving_ground.experiments.studies.trials import definition

from tests.experiments.score_cards import card_of, scored


def cells(text, head):
    """Return the cells of the line that begins with a word."""
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {head} |")]
    return [cell.strip() for cell in line.split("|")[1:-1]]


def test_regret_is_our_error_over_the_oracles_and_the_best_rival_is_chosen_by_trial(monkeypatch):
    monkeypatch.setattr(definition, "oracle_errors", lambda: {n: {"1": 0.01} for n in scored()})
    ours = card_of(np.full((12, 2), 0.03))
    good = np.full((12, 2), 0.05)
    good[0] = 0.02
    rivals = [card_of(np.full((12, 2), 0.04), "one"), card_of(good, "two")]
    text = limits.regret_table(ours, rivals, card_of(np.full((12, 2), 0.02)))
    first, second = (cells(text, name) for name in scored()[:2])
    assert first[2].endswith("`two`")
    assert second[2].endswith("`one`")
    assert first[-2:] == second[-2:] == ["1.00", "3.0"]
    assert cells(text, "geometric mean, times the oracle")[1] == "3.00"


def test_the_frozen_file_has_the_oracle_of_every_trial_and_seed(monkeypatch):
    monkeypatch.setattr(limits, "plant_check", lambda name: (1.0, 2.0))
    runs = pd.DataFrame(
        [
            {"scenario": name, "seed": seed, "oracle_m": 0.01 * seed, "tractor_m": 0.02}
            | {"first_m": 0.05, "best_drive": 4}
            for name in ("reverse", "wet-slope")
            for seed in (2, 1)
        ]
    )
    block = limits.oracle_table(runs)
    frozen = {name.rsplit("/", 1)[1]: json.loads(text) for name, text in block.files.items()}
    assert frozen["oracle.json"]["reverse"] == {"1": 0.01, "2": 0.02}
    assert frozen["plant.json"].keys() == definition.trial_files().keys()
    assert cells(block.text, "wet-slope")[1] == "1.50"


def test_the_working_point_is_the_tool_where_there_is_one_and_losses_are_told():
    rows = []
    for study in working_speed.POINTS:
        for controller in ("ttempc", *working_speed.RIVALS):
            lost = controller == "pid"
            row = dict.fromkeys(
                [f"passes.{p}.{s}cross_sd_m" for p in ("tool", "trailer") for s in ("", "seen_")],
                0.02,
            )
            row["passes.tool.cross_sd_m"] = np.nan if study.startswith("eight") else 0.01
            row |= {"study": study, "controller": controller, "working.cross_p95_m": 0.03}
            rows.append({**row, "status": "lost" if lost else "completed"})
    text = working_speed.table(pd.DataFrame(rows))
    spreads, errors = text.split("\n\n")
    assert cells(spreads, "passes, 10 km/h")[3] == "1.00"
    assert cells(spreads, "eight, 10 km/h")[3] == "2.00"
    assert cells(errors, "eight, 15 km/h")[1:] == ["3.00"] * 5 + ["1/1"]


@pytest.mark.slow
def test_an_oracle_drive_learns():
    found = limits.oracle(definition.trial("rough-grass"), 7, "all", drives=4)
    assert found.score_m < 0.5 * found.scores_m[0]
