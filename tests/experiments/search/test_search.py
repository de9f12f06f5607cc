"""Search on a plant: rows, resuming, files that replay."""

import functools
import json

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.scenario.scenario import load, parse_overrides, read_scenario
from proving_ground.experiments.search.quantities import read_subject
from proving_ground.experiments.search.robustness import Specification
from proving_ground.experiments.search.search import Search
from proving_ground.experiments.sweep import plan, points
from proving_ground.experiments.sweep.engine import engine
from proving_ground.experiments.sweep.failure import ERROR
from proving_ground.experiments.sweep.results import rows
from proving_ground.experiments.sweep.row import FIGURES, no_figures
from scipy.stats import norm

SHORT = ["path={kind='straight', length_m=10.0}", "controller.name=pid"]
WORDS = ["gust", "faults.gust.at_m=2:5:free"]


def search(folder=None, workers=0, budget=10):
    subject = read_subject(read_scenario("grass"), "grass", parse_overrides(SHORT), WORDS)
    with engine(workers) as runs:
        found = Search(subject, runs, seed=3, folder=folder)
        found.falsify(budget)
        return found.report()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("search") / "falsify"
    search(folder)
    return folder


def dig(summary, name):
    return functools.reduce(lambda table, key: table and table[key], name.split("."), summary)


def results(folder):
    files = sorted(folder.glob("generations/*/results.jsonl"))
    return [row for file in files for row in sorted(rows(file), key=lambda row: row["run"])]


def test_the_file_of_a_worst_case_replays_its_failure(folder, tmp_path, capsys):
    """Every figure but those of wall-clock time is the same, and so is the identity of the run."""
    report = json.loads((folder / "falsification.json").read_text())
    case = report["cases"][0]
    assert case["failure"]
    assert report["runs"] == len(results(folder)) == 10
    command = ["run", str(folder / case["file"]), "--seed", str(report["seed"]), "--json"]
    assert main([*command, "--out", str(tmp_path / "run")]) == 3
    summary = json.loads(capsys.readouterr().out)
    assert f"{summary['status']}: {summary['failure']}" == case["failure"]
    (row,) = (row for row in results(folder) if row["run_id"] == summary["run_id"])
    for name in FIGURES:
        if not name.startswith("timing."):
            assert row[name] == dig(summary, name), name
    assert (tmp_path / "run" / "log.mcap").exists()  # for the film


def test_an_interrupted_search_goes_on_to_the_same_cases(folder, tmp_path):
    """Of an interrupted generation the rows that exist are kept, as in an interrupted sweep."""
    again = tmp_path / "again"
    for source in folder.glob("generations/00[01]"):
        (again / "generations" / source.name).mkdir(parents=True)
        for name in ("study.toml", "versions.json", "results.jsonl"):
            text = (source / name).read_text()
            keep = 3 if (source.name, name) == ("001", "results.jsonl") else None
            lines = text.splitlines(keepends=True)[:keep]
            (again / "generations" / source.name / name).write_text("".join(lines))
    kept = results(again)
    search(again)
    assert (again / "falsification.json").read_text() == (folder / "falsification.json").read_text()
    assert [row for row in results(again) if row in kept] == kept  # wall-clock times among them


@pytest.mark.slow
def test_two_workers_find_the_same_bits(folder, tmp_path):
    search(tmp_path / "two", workers=2)
    assert (tmp_path / "two" / "falsification.json").read_text() == (
        folder / "falsification.json"
    ).read_text()


def test_the_probability_is_that_of_the_stated_distribution(monkeypatch):
    """A vehicle that is lost above 4492.5 N: 2.25 sd of a normal truncated at 3 sd on one side."""

    def rows_of(engine, jobs, work=None):
        for job in jobs:
            force = job.axes["faults.gust.force_n"]
            figures = {**no_figures(), "extremes.tilt_rad": force / 4492.5}
            yield job.row("lost" if force > 4492.5 else "completed", None, figures, 0.1)

    monkeypatch.setattr(points, "imap_rows", rows_of)
    monkeypatch.setattr(plan, "check", lambda scenario: 1)
    subject = read_subject(read_scenario("grass"), "grass", parse_overrides(SHORT), WORDS)
    exact = (norm.cdf(3.0) - norm.cdf(3.0 * 4482.5 / 5990.0)) / (norm.cdf(3.0) - 0.5)
    covered = 0
    with engine(0) as here:
        for seed in range(5):
            found = Search(subject, here, seed).probability(50)
            covered += found.low <= exact <= found.high
    assert covered >= 4


def row(**changes):
    values = {"status": "completed", "failure": "", **no_figures()}
    return values | {name.replace("__", "."): value for name, value in changes.items()}


def test_robustness_falls_from_1_at_the_nominal_run_to_0_at_a_limit():
    specification = Specification({"extremes.tilt_rad": 1.0, "extremes.fold_rad": 2.0})
    nominal = specification.shares(row(extremes__tilt_rad=0.1, extremes__fold_rad=1.0))

    def robustness(tilt, fold):
        figures = row(extremes__tilt_rad=tilt, extremes__fold_rad=fold)
        return specification.judge(figures, nominal).robustness

    assert robustness(0.1, 1.0) == pytest.approx(1.0)
    assert robustness(0.1, 1.5) == pytest.approx(0.5)  # half way from 1 to 2
    assert robustness(0.55, 1.5) == pytest.approx(0.5)
    assert robustness(0.91, 1.5) == pytest.approx(0.1)
    assert 0.0 < robustness(1.0, 1.0) < 1e-6


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"status": "lost", "failure": "roll-over"}, "lost: roll-over"),
        ({"status": "stopped", "failure": "blind"}, "stopped: blind"),
        ({"corridor__tool__max_m": 0.11}, "out of the corridor: tool 0.110 m"),
        ({"corridor__hitch_outside_fraction": 0.01}, "hitch angle"),
        ({ERROR.replace(".", "__"): 0.3}, "95 % cross-track error of the trailer 0.300 m"),
    ],
)
def test_what_counts_as_a_failure(changes, reason):
    _, scenario = load("rows")
    specification = Specification.of(scenario, limit_m=0.2)
    nominal = specification.shares(row())
    assert not specification.judge(row(corridor__tool__max_m=0.09), nominal).failed
    outcome = specification.judge(row(**changes), nominal)
    assert outcome.failed
    assert outcome.robustness == 0.0
    assert reason in outcome.reason


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["falsify", "gusts", "grass"], "did you mean gust?"),
        (["falsify", "gust", "gras"], "did you mean grass?"),
        (["falsify", "gust", "grass", "--controller", "nobody"], "nobody"),
        (["falsify", "gust", "grass", "--probability", "55"], "multiple of 10"),
        (["falsify", "soil.cone_index_kpa=1:2", "grass"], "from 1 to 2"),
        (["falsify", "gust"], "SCENARIO"),
    ],
)
def test_bad_input_is_one_line_before_any_run(words, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    try:
        code = main([*words, "--workers", "0"])
    except SystemExit as left:
        code = left.code
    assert code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]
    assert not list(tmp_path.iterdir())
