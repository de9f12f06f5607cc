"""Where a controller fails: bracketed, bisected, and told where there is nothing to find."""

import json
from dataclasses import replace

import pytest

from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidStudy, SweepStopped
from proving_ground.experiments.sweep import envelope as envelope_module
from proving_ground.experiments.sweep.engine import Engine, InProcess
from proving_ground.experiments.sweep.envelope import Question, envelope
from proving_ground.experiments.sweep.failure import ERROR
from proving_ground.experiments.sweep.row import no_figures

ASKED = Question(
    scenario="grass",
    controller="paper",
    quantity="slope",
    low=0.0,
    high=0.4,
    tolerance=0.01,
    limit_m=0.5,
    seeds=(1, 2, 3),
)


def answered(question, monkeypatch, error):
    """Ask with runs whose error is a function of the slope and the seed, None where lost."""

    def rows_of(engine, jobs):
        for job in jobs:
            found = error(next(iter(job.axes.values())), job.seed)
            status = "completed" if found is not None else "lost"
            yield job.row(status, None, {**no_figures(), ERROR: found}, 0.1)

    monkeypatch.setattr(envelope_module, "imap_rows", rows_of)
    return envelope(question, Engine(InProcess(), lambda: 1))


@pytest.mark.parametrize("threshold", [0.013, 0.1, 0.237, 0.399])
def test_the_threshold_lies_between_what_holds_and_what_fails(threshold, monkeypatch):
    found = answered(ASKED, monkeypatch, lambda slope, seed: 0.1 if slope < threshold else 0.9)
    assert (found.outcome, found.monotone) == ("found", True)
    assert found.holds_at < threshold <= found.fails_at
    assert found.fails_at - found.holds_at <= ASKED.tolerance


def test_a_quantity_that_is_hard_when_small_is_bisected_on_its_logarithm(monkeypatch):
    asked = replace(ASKED, quantity="cone-index", low=100.0, high=2000.0, tolerance=5.0)
    found = answered(asked, monkeypatch, lambda kpa, seed: None if kpa < 333.0 else 0.1)
    assert found.fails_at < 333.0 <= found.holds_at
    assert found.holds_at - found.fails_at <= 5.0


def test_delays_are_whole_steps_on_the_way_to_the_answer(monkeypatch):
    asked = replace(ASKED, quantity="delay", low=0.0, high=1.0, tolerance=0.03)
    found = answered(asked, monkeypatch, lambda delay, seed: 0.1 if delay < 0.33 else None)
    assert found.holds_at < 0.33 <= found.fails_at <= found.holds_at + 0.03 + 1e-9
    for probe in found.probes:
        assert probe.value == round(probe.value, 2)
    found = answered(
        replace(asked, tolerance=0.01), monkeypatch, lambda delay, seed: 0.1 if delay < 0.33 else 9
    )
    assert (found.holds_at, found.fails_at) == (0.32, 0.33)


def test_a_run_that_raised_an_error_says_nothing_of_the_controller(monkeypatch):
    def rows_of(engine, jobs):
        for job in jobs:
            yield job.row("failed", "no such thing", no_figures(), 0.1)

    monkeypatch.setattr(envelope_module, "imap_rows", rows_of)
    with pytest.raises(SweepStopped, match=r"slope at 0, paper, seed 1: no such thing"):
        envelope(ASKED, Engine(InProcess(), lambda: 1))


def test_a_named_quantity_is_looked_through(monkeypatch):
    asked = replace(ASKED, quantity="roughness")
    found = answered(asked, monkeypatch, lambda name, seed: 0.9 if name >= "E" else 0.1)
    assert (found.holds_at, found.fails_at) == ("D", "E")


@pytest.mark.parametrize(("error", "outcome"), [(0.1, "holds"), (0.9, "fails"), (None, "fails")])
def test_a_range_without_a_change_is_said_to_have_none(error, outcome, monkeypatch):
    found = answered(ASKED, monkeypatch, lambda slope, seed: error)
    assert found.outcome == outcome
    assert found.holds_at is found.fails_at is None
    assert outcome in str(found)


def test_failure_that_comes_and_goes_is_said_to(monkeypatch):
    found = answered(ASKED, monkeypatch, lambda slope, seed: 0.9 if 0.05 < slope < 0.25 else 0.1)
    assert not found.monotone
    assert "comes and goes" in str(found)
    assert found.holds_at <= 0.05 < found.fails_at


def test_a_value_fails_where_at_least_half_of_its_seeds_do(monkeypatch):
    found = answered(ASKED, monkeypatch, lambda slope, seed: 0.9 if slope > 0.1 * seed else 0.1)
    assert found.holds_at <= 0.2 < found.fails_at
    assert all(probe.runs == 3 for probe in found.probes)


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
def test_what_cannot_be_asked_is_refused(change):
    with pytest.raises(InvalidStudy):
        replace(ASKED, **change).check()


@pytest.mark.parametrize("option", ["--low", "--high", "--tolerance", "--limit"])
def test_a_number_that_is_none_is_refused_before_any_run(option, tmp_path, monkeypatch, capsys):
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
    (found,) = json.loads((tmp_path / "e.json").read_text())["envelopes"]
    assert found["outcome"] == "holds"
    assert [probe["value"] for probe in found["probes"]] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert main(arguments) == 2
    assert "exists already" in capsys.readouterr().err
