"""Retuning: same budget for all, the best of all trials, lost and refused runs, tables."""

import math
import tomllib
from typing import Any

import pytest
from proving_ground.experiments.studies import batch, retuned
from proving_ground.experiments.studies.retuned import KNOBS, LOST_CM, Knob, objective, search
from proving_ground.experiments.sweep.engine import engine

from ttempc.guidance.controllers import controller_options

STRAIGHT = 'path={kind="straight",length_m=10.0}'


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    monkeypatch.setattr(batch, "engine", lambda workers: engine(0))


def options_of(run: batch.StudyRun) -> tuple[str, dict[str, Any]]:
    tables = [tomllib.loads(line)["controller"] for line in run.overrides]
    values: dict[str, Any] = {}
    for table in tables:
        values |= table.get("options", {})
    return tables[0]["name"], values


def test_a_knob_turned_there_and_back_is_where_it_was():
    options = {"step_weight": [1.0, 1.0, 0.02]}
    knob = Knob("step_weight", 4.0, (0, 1))
    there = knob.turned(options, 1.0)
    assert there == {"step_weight": [4.0, 4.0, 0.02]}
    assert knob.turned(there, -1.0) == options


def test_every_knob_is_an_option_that_its_controller_accepts():
    for name, knobs in KNOBS.items():
        values = controller_options(name, {})
        for knob in knobs:
            controller_options(name, {knob.option: knob.turned(values, -1.0)[knob.option]})


def test_the_search_finds_the_best_of_its_trials_with_one_budget(monkeypatch):
    evaluated = []

    def synthetic(runs):
        """Errors with their least value at four times each shipped weight, half the lag ratio."""
        evaluated.extend(set(map(options_of_key, runs)))
        return {run: error(*options_of(run)) for run in runs}

    def options_of_key(run):
        name, values = options_of(run)
        return name, str(values)

    def error(name, values):
        shipped: dict[str, Any] = controller_options(name, {})
        if name == "pid":
            return 1.0 + math.log(2.0 * values["lag_ratio"] / shipped["lag_ratio"]) ** 2
        return 1.0 + sum(
            math.log(x / (4.0 * y)) ** 2
            for x, y in zip(values["step_weight"], shipped["step_weight"], strict=True)
        )

    monkeypatch.setattr(retuned, "errors_cm", synthetic)
    first, *_, last = search(("lqr", "pid"), ("grass", "patchy"))
    assert last["lqr"].value == pytest.approx(1.0, abs=1e-3)  # three digits of a weight
    assert last["pid"].value < first["pid"].value
    names = [name for name, _ in evaluated]
    assert names.count("lqr") == names.count("pid") == 1 + 2 * retuned.ROUNDS


def test_a_lost_run_counts_and_a_refused_one_does_not():
    assert objective([4.0, math.inf, math.nan]) == pytest.approx(math.sqrt(4.0 * LOST_CM))


def test_the_tables(capsys):
    retuned.main((1,), ("ttempc", "pid"), ("grass",), ("grass",), (STRAIGHT,))
    chosen, errors, sentence = capsys.readouterr().out.strip().split("\n\n")
    assert [line.split("|")[1].strip() for line in chosen.splitlines()[2:]] == ["`ttempc`", "`pid`"]
    for line in chosen.splitlines()[2:]:
        before, after = map(float, line.split("|")[-2].split(","))
        assert after <= before
    assert errors.splitlines()[2].startswith("| `grass` | ")
    assert "1 fields" in sentence
