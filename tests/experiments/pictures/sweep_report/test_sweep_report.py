"""Report of a sweep: rows, groups, the way back to the runs; a page in every state of a study."""

import os
import re
import shutil
import subprocess
import sys

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidRows
from proving_ground.experiments.pictures.sweep_report.format import format_numbers
from proving_ground.experiments.pictures.sweep_report.runs import (
    best,
    differences,
    groups,
    read_sweep,
)
from proving_ground.experiments.studies.sweep.results import rows
from proving_ground.experiments.studies.sweep.row import (
    has_failed,
    no_figures,
)

from tests.experiments.sweep_rows import AXES, DRAWN, ERROR, swept, synthetic_row

TOOL = ERROR.replace("trailer", "tool")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


def with_log(job):
    row = synthetic_row(job)
    return {**row, "log": f"logs/{row['run']}.mcap"} if row["status"] == "lost" else row


def report_page(folder, *options):
    assert main(["report", str(folder), *options]) == 0
    return (folder / "report" / "report.html").read_text()


def refused(folder, words, capsys, *options):
    """`ttempc report` refuses the folder or the options in one line and writes nothing."""
    with pytest.raises(SystemExit, match=r"^2$"):  # as the program itself leaves
        sys.exit(main(["report", str(folder), *options]))
    printed = capsys.readouterr().err
    assert words in printed
    assert printed.count("\n") == 1
    assert not (folder / "report").exists()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return swept(tmp_path_factory.mktemp("study"), "seeds = 2", AXES, work=with_log)


@pytest.fixture(scope="module")
def text(folder):
    return report_page(folder)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    return read_sweep(swept(tmp_path_factory.mktemp("five"), "seeds = 5", AXES))


@pytest.fixture(scope="module")
def three_rows(tmp_path_factory):
    return swept(tmp_path_factory.mktemp("begun"), "seeds = 5", AXES, most=3)


@pytest.fixture
def begun(three_rows, tmp_path):
    return shutil.copytree(three_rows, tmp_path / three_rows.name)


def test_every_run_is_in_one_group_with_its_mean_error(sweep):
    cells = groups(sweep, sweep.scales)
    assert len(cells) == 3 * 4 * 3
    by = [*(scale.column for scale in sweep.scales), "controller"]
    runs = sweep.rows.groupby(by, observed=True)
    for cell in cells.to_dict("records"):
        mine = runs.get_group(tuple(cell[name] for name in by))
        assert set(mine["terrain.iso_class"]) == {"ACE"[cell[by[0]]]}
        errors = 100 * mine[ERROR][mine["status"] == "completed"]
        assert (cell["runs"], cell["failed"]) == (5, 5 - len(errors))
        assert (cell["error_cm"] is None) == (not len(errors))
        if len(errors):
            assert cell["error_cm"].value == pytest.approx(errors.mean())


def test_numbers_are_shown_as_ranges():
    assert format_numbers([1, 2, 3, 7, 9, 10]) == "1-3, 7, 9, 10"


def test_differences_are_those_of_the_same_ground(sweep):
    paired = differences(sweep, "paper").set_index("controller")
    ttempc, feedforward = paired.loc["ttempc"], paired.loc["feedforward"]
    by_key = sweep.rows.set_index(["controller", "point", "seed"])["error_cm"]
    expected = (by_key["ttempc"] - by_key["paper"]).mean()
    assert ttempc["difference"].value == pytest.approx(expected)
    assert (ttempc["pairs"], ttempc["alone"], ttempc["other"]) == (60, 0, 0)
    assert (feedforward["pairs"], feedforward["alone"]) == (40, 20)
    # The ground is common: the difference is far surer than the two errors.
    wide = groups(sweep).set_index("controller").loc["paper", "error_cm"]
    assert ttempc["difference"].high - ttempc["difference"].low < wide.high - wide.low
    back = differences(sweep, "ttempc").set_index("controller").loc["paper"]
    assert back["difference"].value == pytest.approx(-expected)


def test_the_error_is_that_of_the_working_point_and_a_limit_applies_to_it(tmp_path):
    def with_tool(job):
        row = synthetic_row(job)
        return {**row, TOOL: 0.5} if job.scenario.controller.name == "paper" else row

    driven = swept(tmp_path, "seeds = 1", AXES, work=with_tool)
    free, strict = read_sweep(driven), read_sweep(driven, 0.45)
    assert free.point == "working point"
    by_name = free.rows.groupby("controller", observed=True)
    assert by_name["error_cm"].first()["paper"] == 50.0
    assert (free.rows["failed"] == (free.rows["status"] != "completed")).all()
    assert (strict.rows["failed"] == free.rows["failed"] | (free.rows["error_cm"] > 45)).all()
    assert groups(strict).set_index("controller").loc["paper", "rate"].value == 1.0


def test_report_and_search_judge_a_run_alike(tmp_path):
    """A run fails that does not complete, or whose error exceeds a limit, if it has one."""
    outcomes = [("completed", 0.1), ("completed", 0.9), ("completed", None), ("lost", 0.1)]
    outcomes.append(("invalid", None))

    def work(job):
        status, error = outcomes[job.run]
        return job.row(status, None, {**no_figures(), ERROR: error}, 0.1)

    folder = swept(tmp_path, "seeds = 5", work=work)
    rows = [{"status": status, ERROR: error} for status, error in outcomes]
    for limit_m, expected in ((None, [0, 0, 0, 1, 1]), (0.5, [0, 1, 0, 1, 1])):
        assert [has_failed(row, limit_m) for row in rows] == expected
        assert read_sweep(folder, limit_m).rows["failed"].tolist() == expected
    assert "shorter than 8 s: 1 runs" in report_page(folder, "--limit", "0.5")


def test_the_best_have_the_least_median_and_gain_nothing_by_runs_that_fail(sweep, tmp_path):
    assert best(sweep) == "ttempc"

    def best_or_lost(job):
        row = synthetic_row(job)
        if job.scenario.controller.name != "feedforward" or row["status"] == "lost":
            return row
        if job.scenario.terrain.iso_class == "C":
            return job.row("lost", "rolled", no_figures(), 0.1)
        return {**row, ERROR: 1e-6}  # in the third of its runs that it completes

    spoilt = read_sweep(swept(tmp_path, "seeds = 2", AXES, work=best_or_lost))
    assert best(spoilt) == "ttempc"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: [], "holds no row yet"),
        (lambda lines: [lines[0][:50]], "holds no row yet"),
        (lambda lines: [lines[0], "no json\n", lines[1]], "line 2 is no row"),
        (lambda lines: [lines[0], "[1]\n"], "line 2 is no row"),
        (lambda lines: [lines[0], lines[0]], "line 2 .* run 0 "),
        (lambda lines: [lines[0].replace('"run":0', '"run":999')], "run 999 of 180"),
        (lambda lines: [lines[0].replace('"seed":1', '"seed":"1"')], "line 1 .* seed "),
        (lambda lines: [lines[0].replace(ERROR, "other")], f"line 1 .* '{ERROR}'"),
    ],
)
def test_foreign_rows_are_refused_in_one_line(change, message, begun, capsys):
    lines = (begun / "results.jsonl").read_text().splitlines(keepends=True)
    (begun / "results.jsonl").write_text("".join(change(lines)))
    with pytest.raises(InvalidRows, match=message):
        read_sweep(begun)
    refused(begun, "results.jsonl: ", capsys)


def test_other_folders_and_options_are_refused(begun, capsys):
    refused(begun, "from 1e-6", capsys, "--limit", "0")
    for missing in ("study.toml", "versions.json", "results.jsonl"):
        content = (begun / missing).read_bytes()
        (begun / missing).unlink()
        refused(begun, missing, capsys)
        (begun / missing).write_bytes(content)
    shutil.rmtree(begun)
    refused(begun, begun.name, capsys)


def test_the_page_is_self_contained_leads_to_logs_and_escapes_text(text):
    assert not re.search(r"https?:|@import|url\((?!#)", text)
    links = [*re.findall(r'href="([^"]*)"', text)]
    assert links.count("../results.jsonl") == 1
    assert sum(link.startswith("../logs/") for link in links) == 4
    assert "<at>" not in text
    assert "roll-over &lt;at&gt; the &amp; fence" in text


def test_a_report_follows_from_the_rows_alone_whatever_their_order(folder, text, tmp_path):
    other = shutil.copytree(folder, tmp_path / "other name")
    file = other / "results.jsonl"
    file.write_text("".join(reversed(file.read_text().splitlines(keepends=True))))
    assert report_page(other) == text


@pytest.mark.parametrize(
    ("parts", "most", "present", "absent"),
    [
        (("seeds = 3",), None, "Tails", "Differences to"),  # one controller, no axis
        (("seeds = 2", DRAWN), None, "over wheelbase [m]", "Points"),
        (("seeds = 2", AXES), 1, "71 missing", "over gust"),  # in progress
        (
            ("seeds = 2", AXES.replace('"paper", "ttempc", ', "")),
            None,
            "One axis",
            "Differences to",
        ),
        (
            ("seeds = 2", AXES.replace(', "feedforward"', "")),
            None,
            "Differences to ttempc",
            "failed [%]",
        ),
        (  # no such class: runs of refused combinations are not missing
            ("seeds = 1\nskip_refused = true", AXES.replace('["A"', '["Z", "A"')),
            None,
            "12 refused",
            "missing",
        ),
    ],
)
def test_any_study_can_be_reported(parts, most, present, absent, tmp_path):
    folder = swept(tmp_path, *parts, most=most)
    text = report_page(folder)
    assert present in text
    assert absent not in text


def test_an_old_report_is_replaced_and_what_is_not_its_own_is_left(begun, capsys, monkeypatch):
    (begun / "report").mkdir()
    names = {"report.html", "notes.txt"}
    for name in names:
        (begun / "report" / name).write_text("old")
    text = report_page(begun)
    assert len(text) > 1000
    assert (begun / "report" / "notes.txt").read_text() == "old"

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert main(["report", str(begun), "--limit", "0.1"]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert (begun / "report" / "report.html").read_text() == text
    assert {file.name for file in (begun / "report").iterdir()} == names


def test_the_worst_runs_of_each_controller_are_listed_those_not_completed_first(text):
    worst = re.search(r'id="worst".*?</table>', text, re.DOTALL)[0]
    for name, status in (("paper", "completed"), ("feedforward", "lost")):
        assert len(re.findall(f">{name}</td>.*>{status}</td>", worst)) == 4


SCENARIOS = """
[[axis]]
kind = "list"
key = "scenario"
values = ["grass", "wet-slope", "rows"]
"""


def test_the_worst_runs_have_the_scenario_of_their_row(tmp_path):
    """The page's cells are compared with the rows, run by run."""
    folder = swept(tmp_path, "seeds = 2", SCENARIOS)
    text = report_page(folder)
    worst = re.search(r'id="worst".*?</table>', text, re.DOTALL)[0]
    head = re.findall(r"<th[^>]*>(.*?)</th>", worst)
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in worst.split("<tr")[2:]]
    named = {row["run"]: row["scenario"] for row in rows(folder / "results.jsonl")}
    column = [re.sub("<[^>]*>", "", name).strip() for name in head].index("scenario")
    assert cells
    for row in cells:
        assert row[column] == named[int(row[0])]


@pytest.mark.skipif(CHROMIUM is None, reason="needs a browser: Debian's package chromium")
def test_a_browser_sorts_tables(text, tmp_path):
    clicks = """<script>
      const heads = document.querySelectorAll("#controllers th button");
      heads[4].click(); heads[4].click();
    </script>"""
    file = tmp_path / "clicked.html"
    file.write_text(text.replace("</body>", f"{clicks}</body>"))
    headless = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    options = [f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=3000"]
    page = subprocess.check_output([*headless, *options, file.as_uri()], text=True, timeout=120)
    table = re.search(r'id="controllers".*?</table>', page, re.DOTALL)[0]
    order = re.findall(r"<tr>\s*<td[^>]*>([\w-]+)</td>", table)
    assert order == ["feedforward", "paper", "ttempc"]
    assert 'aria-sort="descending"' in table
