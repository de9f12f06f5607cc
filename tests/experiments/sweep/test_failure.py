"""One rule of failure in the sweep report and in the envelope."""

from dataclasses import replace

import pytest
from proving_ground.experiments.search.limit import Question, find_limit
from proving_ground.experiments.search.quantities import QUANTITIES
from proving_ground.experiments.sweep import points
from proving_ground.experiments.sweep.engine import Engine, InProcess
from proving_ground.experiments.sweep.failure import (
    ERROR,
    has_failed,
    is_unmeasured,
    mostly_fails,
    unmeasured_text,
)
from proving_ground.experiments.sweep.row import no_figures
from proving_ground.experiments.sweep_report.aggregate import controller_groups
from proving_ground.experiments.sweep_report.report import make_report
from proving_ground.experiments.sweep_report.runs import read_sweep
from proving_ground.experiments.sweep_report.summary import render_summary

from tests.experiments.study_files import SHORT
from tests.experiments.sweep_rows import swept

QUESTION = Question(
    scenario="grass",
    controller="paper",
    quantity="slope",
    parameter=QUANTITIES["slope"],
    tolerance=0.01,
    limit_m=None,
    seeds=(1, 2, 3),
)


def row_maker(status, error):
    return lambda job: job.row(status, None, {**no_figures(), ERROR: error}, 0.1)


@pytest.mark.parametrize(
    ("status", "error", "limit_m", "fails"),
    [
        ("completed", 0.1, None, False),
        ("completed", 0.1, 0.5, False),
        ("completed", 0.9, 0.5, True),
        ("completed", 0.9, None, False),
        ("completed", None, 0.5, False),  # too short for an error figure
        ("completed", None, None, False),
        ("lost", None, None, True),
        ("lost", 0.1, 0.5, True),
        ("invalid", None, 0.5, True),
    ],
)
def test_report_and_envelope_judge_a_run_alike(
    status, error, limit_m, fails, tmp_path, monkeypatch
):
    make_row = row_maker(status, error)
    folder = swept(tmp_path, "seeds = 3", SHORT, work=make_row)
    (group,) = controller_groups(read_sweep(folder, limit_m))
    assert (group.fails, len(group.failed)) == (fails, 3 if fails else 0)

    monkeypatch.setattr(points, "imap_rows", lambda engine, jobs: map(make_row, jobs))
    result = find_limit(replace(QUESTION, limit_m=limit_m), Engine(InProcess(), lambda: 1))
    assert result.outcome == ("fails" if fails else "holds")
    assert {probe.failed for probe in result.probes} == {len(group.failed)}


def test_completed_runs_without_an_error_figure_are_counted_in_words(tmp_path, monkeypatch):
    make_row = row_maker("completed", None)
    folder = swept(tmp_path, "seeds = 3", SHORT, work=make_row)
    words = "3 completed runs have no error figure (shorter than 8 s), and the limit does not apply"
    assert words in render_summary(make_report(read_sweep(folder, 0.5)))
    assert "the limit" not in render_summary(make_report(read_sweep(folder)))

    monkeypatch.setattr(points, "imap_rows", lambda engine, jobs: map(make_row, jobs))
    result = find_limit(replace(QUESTION, limit_m=0.5), Engine(InProcess(), lambda: 1))
    assert "15 completed runs have no error figure" in str(result)
    assert {probe.unmeasured for probe in result.probes} == {3}


def test_a_run_is_unmeasured_only_if_it_completed():
    rows = [{"status": s, ERROR: e} for s in ("completed", "lost") for e in (None, 0.2)]
    assert [is_unmeasured(row) for row in rows] == [True, False, False, False]
    assert unmeasured_text(0, 0.5) == ""
    assert has_failed({"status": "completed", ERROR: 1}, 0.5)


@pytest.mark.parametrize(("failed", "runs", "fails"), [(0, 1, False), (1, 2, True), (1, 3, False)])
def test_half_of_the_runs_suffice_to_fail(failed, runs, fails):
    assert mostly_fails(failed, runs) == fails
