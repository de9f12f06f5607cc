"""Envelope: brackets, bisection, and ranges without a change."""

import json
from dataclasses import replace

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidStudy, SweepStopped
from proving_ground.experiments.sweep import points
from proving_ground.experiments.sweep.engine import Engine, InProcess
from proving_ground.experiments.sweep.envelope import Question, envelope
from proving_ground.experiments.sweep.failure import ERROR
from proving_ground.experiments.sweep.row import no_figures

QUESTION = Question(
    scenario="grass",
    controller="paper",
    quantity="slope",
    low=0.0,
    high=0.4,
    tolerance=0.01,
    limit_m=0.5,
    seeds=(1, 2, 3),
)


def search(question, monkeypatch, error):
    """Search with runs whose error is a function of the value and the seed, None where lost."""

    def rows_of(engine, jobs):
        for job in jobs:
            value = error(next(iter(job.axes.values())), job.seed)
            status = "completed" if value is not None else "lost"
            yield job.row(status, None, {**no_figures(), ERROR: value}, 0.1)

    monkeypatch.setattr(points, "imap_rows", rows_of)
    return envelope(question, Engine(InProcess(), lambda: 1))


@pytest.mark.parametrize("threshold", [0.013, 0.1, 0.237, 0.399])
def test_the_threshold_lies_between_what_holds_and_what_fails(threshold, monkeypatch):
    result = search(QUESTION, monkeypatch, lambda slope, seed: 0.1 if slope < threshold else 0.9)
    assert (result.outcome, result.monotone) == ("found", True)
    assert result.holds_at < threshold <= result.fails_at
    assert result.fails_at - result.holds_at <= QUESTION.tolerance


def test_a_quantity_that_is_hard_when_small_is_bisected_on_its_logarithm(monkeypatch):
    question = replace(QUESTION, quantity="cone-index", low=100.0, high=2000.0, tolerance=5.0)
    result = search(question, monkeypatch, lambda kpa, seed: None if kpa < 333.0 else 0.1)
    assert result.fails_at < 333.0 <= result.holds_at
    assert result.holds_at - result.fails_at <= 5.0


def test_delays_are_multiples_of_the_step(monkeypatch):
    question = replace(QUESTION, quantity="delay", low=0.0, high=1.0, tolerance=0.03)
    result = search(question, monkeypatch, lambda delay, seed: 0.1 if delay < 0.33 else None)
    assert result.holds_at < 0.33 <= result.fails_at <= result.holds_at + 0.03 + 1e-9
    for probe in result.probes:
        assert probe.value == round(probe.value, 2)
    result = search(
        replace(question, tolerance=0.01),
        monkeypatch,
        lambda delay, seed: 0.1 if delay < 0.33 else 9,
    )
    assert (result.holds_at, result.fails_at) == (0.32, 0.33)


def test_a_run_that_raised_an_error_is_no_failure_of_the_controller(monkeypatch):
    def rows_of(engine, jobs):
        for job in jobs:
            yield job.row("failed", "no such thing", no_figures(), 0.1)

    monkeypatch.setattr(points, "imap_rows", rows_of)
    with pytest.raises(SweepStopped, match=r"slope at 0, paper, seed 1: no such thing"):
        envelope(QUESTION, Engine(InProcess(), lambda: 1))


def test_a_named_quantity_is_scanned(monkeypatch):
    question = replace(QUESTION, quantity="roughness")
    result = search(question, monkeypatch, lambda name, seed: 0.9 if name >= "E" else 0.1)
    assert (result.holds_at, result.fails_at) == ("D", "E")


@pytest.mark.parametrize(("error", "outcome"), [(0.1, "holds"), (0.9, "fails"), (None, "fails")])
def test_a_range_without_a_change_is_reported(error, outcome, monkeypatch):
    result = search(QUESTION, monkeypatch, lambda slope, seed: error)
    assert result.outcome == outcome
    assert result.holds_at is result.fails_at is None
    assert outcome in str(result)


def test_failure_that_comes_and_goes_is_reported(monkeypatch):
    result = search(QUESTION, monkeypatch, lambda slope, seed: 0.9 if 0.05 < slope < 0.25 else 0.1)
    assert not result.monotone
    assert "comes and goes" in str(result)
    assert result.holds_at <= 0.05 < result.fails_at


def test_a_value_fails_where_at_least_half_of_its_seeds_do(monkeypatch):
    result = search(QUESTION, monkeypatch, lambda slope, seed: 0.9 if slope > 0.1 * seed else 0.1)
    assert result.holds_at <= 0.2 < result.fails_at
    assert all(probe.runs == 3 for probe in result.probes)


@pytest.mark.parametrize(
    "change",
    [
        {"low": 0.5},
        {"tolerance": 0.0},
        {"high": 0.9},
        {"quantity": "cone-index", "low": 0.0, "high": 1.0},
        {"controller": "me"},
        {"quantity": "delay", "tolerance": 0.001},
        {"quantity": "delay", "high": 0.305, "tolerance": 0.05},
    ],
)
def test_invalid_settings_are_refused(change):
    with pytest.raises(InvalidStudy):
        replace(QUESTION, **change).check()


@pytest.mark.parametrize("option", ["--low", "--high", "--tolerance", "--limit"])
def test_not_a_number_is_refused_before_any_run(option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as left:
        main(["envelope", "slope", option, "nan"])
    assert left.value.code == 2
    assert "must be a finite number, got 'nan'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_command_writes_what_it_prints(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = ["envelope", "delay", "pavement", "--set", "path={kind='straight', length_m=2.0}"]
    arguments += ["--seeds", "1", "--workers", "0", "--out", "e.json"]
    assert main(arguments) == 0
    assert "ttempc on pavement, delay [s]: holds from 0 to 1" in capsys.readouterr().out
    (result,) = json.loads((tmp_path / "e.json").read_text())["envelopes"]
    assert result["outcome"] == "holds"
    assert [probe["value"] for probe in result["probes"]] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert main(arguments) == 2
    assert "exists already" in capsys.readouterr().err
