"""Limit of a quantity: brackets, bisection, and ranges without a change."""

import json
from dataclasses import replace

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import ExperimentError, SweepStopped
from proving_ground.experiments.studies.search.limit import Question, find_limit
from proving_ground.experiments.studies.search.quantities import QUANTITIES
from proving_ground.experiments.studies.sweep import sweep
from proving_ground.experiments.studies.sweep.engine import Engine, InProcess
from proving_ground.experiments.studies.sweep.row import no_figures

from tests.experiments.sweep_rows import ERROR


def question(quantity="slope", tolerance=0.01, **bounds):
    parameter = replace(QUANTITIES[quantity], **bounds)
    return Question("grass", "paper", quantity, parameter, tolerance, 0.5, (1, 2, 3))


@pytest.fixture
def search(monkeypatch):
    """Search with runs whose error is a function of the value and the seed, None where lost."""

    def find(asked, error):
        def rows_of(engine, jobs):
            for job in jobs:
                value = error(next(iter(job.axes.values())), job.seed)
                if value == "raised":
                    yield job.row("failed", "no such thing", no_figures(), 0.1)
                    continue
                status = "completed" if value is not None else "lost"
                yield job.row(status, None, {**no_figures(), ERROR: value}, 0.1)

        monkeypatch.setattr(sweep, "imap_rows", rows_of)
        return find_limit(asked, Engine(InProcess(), lambda: 1))

    return find


def test_the_threshold_lies_between_what_holds_and_what_fails(search):
    for threshold in (0.013, 0.1, 0.237, 0.399):
        result = search(question(), lambda slope, seed: 0.1 if slope < threshold else 0.9)  # noqa: B023
        assert (result.outcome, result.monotone) == ("found", True)
        assert result.holds_at < threshold <= result.fails_at
        assert result.fails_at - result.holds_at <= 0.01


def test_a_quantity_that_is_hard_when_small_is_bisected_on_its_logarithm(search):
    asked = question("cone-index", 5.0)
    result = search(asked, lambda kpa, seed: None if kpa < 333.0 else 0.1)
    assert result.fails_at < 333.0 <= result.holds_at <= result.fails_at + 5.0
    middle = pytest.approx((100.0 * 2000.0) ** 0.5, rel=1e-4)
    assert middle in [probe.value for probe in result.probes]


def test_delays_are_multiples_of_the_step(search):
    result = search(question("delay", 0.03), lambda delay, seed: 0.1 if delay < 0.33 else None)
    assert result.holds_at < 0.33 <= result.fails_at <= result.holds_at + 0.03 + 1e-9
    assert all(probe.value == round(probe.value, 2) for probe in result.probes)


def test_a_named_quantity_is_scanned(search):
    result = search(question("roughness"), lambda name, seed: 0.9 if name >= "E" else 0.1)
    assert (result.holds_at, result.fails_at) == ("D", "E")


def test_a_range_without_a_change_and_one_with_several_are_told(search):
    for error, outcome in ((0.1, "holds"), (0.9, "fails"), (None, "fails")):
        result = search(question(), lambda slope, seed: error)  # noqa: B023
        assert (result.outcome, result.holds_at, result.fails_at) == (outcome, None, None)
        assert outcome in str(result)
    result = search(question(), lambda slope, seed: 0.9 if 0.05 < slope < 0.25 else 0.1)
    assert not result.monotone
    assert result.holds_at <= 0.05 < result.fails_at


def test_a_run_that_raised_an_error_is_no_failure_of_the_controller(search):
    with pytest.raises(SweepStopped, match=r"slope at 0, paper, seed 1: no such thing"):
        search(question(), lambda slope, seed: "raised")


def test_invalid_settings_are_refused_before_any_run():
    for asked in (
        question(high=0.9),
        question("delay", 0.001),
        replace(question(), controller="me"),
    ):
        with pytest.raises(ExperimentError):
            asked.plan(asked.scan_numbers()).extent()


def test_the_command_writes_what_it_prints(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    line = ["search", "limit", "pavement", "actuators.front.dead_time_s=0:1", "--seeds", "1"]
    line += ["--set", "path={kind='straight', length_m=2.0}", "--workers", "0", "-o", "e.json"]
    assert main(line) == 0
    assert "ttempc on pavement, actuators.front.dead_time_s: holds" in capsys.readouterr().out
    (result,) = json.loads((tmp_path / "e.json").read_text())["limits"]
    assert result["question"]["seeds"] == [201]
    assert [probe["value"] for probe in result["probes"]] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert main(line) == 2
    assert "exists already" in capsys.readouterr().err
