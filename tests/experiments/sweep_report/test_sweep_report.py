"""Report of a sweep: rows, groups, the way back to the runs; a page in every state of a study."""

import html
import json
import os
import re
import shlex
import shutil
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidRows
from proving_ground.experiments.scenario.scenario import dump, load
from proving_ground.experiments.sweep.plan import SweepPlan
from proving_ground.experiments.sweep.row import (
    has_failed,
    is_unmeasured,
    mostly_fails,
    no_figures,
)
from proving_ground.experiments.sweep.study import load_study
from proving_ground.experiments.sweep_report.format import format_numbers, rerun_command
from proving_ground.experiments.sweep_report.runs import (
    differences,
    groups,
    ranking,
    read_sweep,
    tails,
)

from tests.browser import dump_dom, measured, needs_browser
from tests.experiments.sweep_rows import AXES, DRAWN, ERROR, swept, synthetic_row

VOID = {"meta", "br", "img"}
TOOL = ERROR.replace("trailer", "tool")


class Page(HTMLParser):
    """Check that tags are closed in order; collect links and ids."""

    def __init__(self, text):
        super().__init__()
        self.open, self.links, self.names = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.links += [given["href"]] if "href" in given else []
        self.names += [given["id"]] if "id" in given else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        if tag not in VOID:
            self.names += [value for name, value in attrs if name == "id"]

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag


def with_log(job):
    """Leave a log of run 2 alone, and a film beside it."""
    row = synthetic_row(job)
    if job.run != 2:
        return row
    for name in ("2.mcap", "2.mp4"):
        (job.folder / "logs" / name).touch()
    return {**row, "log": "logs/2.mcap"}


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


def numbers(text):
    """Parse the text of `format_numbers`, as the page does."""
    result = []
    for part in filter(None, text.split(", ")):
        span, _, step = part.partition("/")
        first, _, last = span.partition("-")
        result += range(int(first), int(last or first) + 1, int(step or 1))
    return result


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
    """A folder of three rows, to spoil."""
    return shutil.copytree(three_rows, tmp_path / three_rows.name)


def test_every_run_is_in_one_cell_and_every_number_leads_to_its_runs(sweep):
    cells = groups(sweep, sweep.scales)
    assert len(cells) == 3 * 4 * 3
    shown = [run for runs in cells["runs"] for run in numbers(format_numbers(runs))]
    assert sorted(shown) == list(range(180))
    for cell in cells.to_dict("records"):
        mine = sweep.rows.set_index("run").loc[cell["runs"]]
        assert set(mine["controller"]) == {cell["controller"]}
        assert set(mine["terrain.iso_class"]) == {"ACE"[cell["ISO class"]]}
        assert mine["soil.cone_index_kpa"].nunique() == 1
        errors = 100 * mine[ERROR][mine["status"] == "completed"]
        assert len(cell["failed"]) == 5 - len(errors)
        assert (cell["error"] is None) == (not len(errors))
        if len(errors):
            assert cell["error"].value == pytest.approx(errors.mean())


def test_number_ranges_can_be_parsed():
    for chance in (0.02, 0.3, 0.9, 1.0):
        chosen = np.flatnonzero(np.random.default_rng(1).random(500) < chance)
        assert numbers(format_numbers(chosen)) == chosen.tolist()
    assert format_numbers(np.arange(3, 2000, 3)) == "3-1998/3"
    assert format_numbers([]) == ""


def test_differences_are_those_of_the_same_ground(sweep):
    paired = differences(sweep, "paper").set_index("controller")
    ttempc, feedforward = paired.loc["ttempc"], paired.loc["feedforward"]
    by_key = sweep.rows.set_index(["controller", "point", "seed"])["error_cm"]
    expected = (by_key["ttempc"] - by_key["paper"]).mean()
    assert ttempc["error"].value == pytest.approx(expected)
    assert (ttempc["pairs"], len(ttempc["alone"]), len(ttempc["other"])) == (60, 0, 0)
    assert (feedforward["pairs"], len(feedforward["alone"])) == (40, 20)
    # The ground is common: the difference is far surer than the two errors.
    wide = groups(sweep).set_index("controller").loc["paper", "error"]
    assert ttempc["error"].high - ttempc["error"].low < wide.high - wide.low
    back = differences(sweep, "ttempc").set_index("controller").loc["paper"]
    assert back["error"].value == pytest.approx(-expected)
    # Every cell has as many pairs, so that the mean of their means is that of all.
    cells = differences(sweep, "paper", sweep.scales)
    own = cells[cells["controller"] == "ttempc"]["error"]
    assert len(own) == 12
    assert np.mean([error.value for error in own]) == pytest.approx(expected)


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
    assert tails(strict)["cvar95"].tolist() == tails(free)["cvar95"].tolist()


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
    assert [is_unmeasured(row) for row in rows] == [0, 0, 1, 0, 0]
    assert "1 completed run has no error figure" in report_page(folder, "--limit", "0.5")
    assert [mostly_fails(*counts) for counts in ((0, 1), (1, 2), (1, 3))] == [False, True, False]


def test_axes_have_words_units_and_the_order_of_the_study(sweep):
    roughness, strength = sweep.scales
    assert (roughness.label, roughness.texts) == ("ISO class", ("A", "C", "E"))
    assert strength.label == "cone index [kPa]"
    assert strength.logarithmic
    assert strength.texts == ("150", "356", "843", "2000")


def test_drawn_axes_are_binned_evenly_and_points_are_the_units(tmp_path):
    sweep = read_sweep(swept(tmp_path, "seeds = 2", DRAWN))
    (scale,) = sweep.scales
    assert scale.binned
    assert sorted(np.bincount(sweep.rows[scale.label])) == [6, 6, 6, 6, 8, 8]
    assert sweep.rows["unit"].nunique() == 20


def test_the_best_have_the_least_median_and_gain_nothing_by_runs_that_fail(sweep, tmp_path):
    assert ranking(sweep) == ["ttempc", "paper", "feedforward"]

    def best_or_lost(job):
        row = synthetic_row(job)
        if job.scenario.controller.name != "feedforward" or row["status"] == "lost":
            return row
        if job.scenario.terrain.iso_class == "C":
            return job.row("lost", "rolled", no_figures(), 0.1)
        return {**row, ERROR: 1e-6}  # in the third of its runs that it completes

    spoilt = read_sweep(swept(tmp_path, "seeds = 2", AXES, work=best_or_lost))
    assert ranking(spoilt)[-1] == "feedforward"


def test_the_command_of_a_row_drives_the_same_scenario():
    for study in ("terrain-slip", "mismatch", "delay", "compare"):
        plan = SweepPlan(*load_study(study))
        for run in (0, plan.size - 1):
            planned = plan[run]
            setting = planned.setting
            row = {
                "scenario": setting.name,
                "controller": setting.scenario.controller.name,
                "seed": planned.seed,
                **setting.axes,
            }
            _, _, name, *options = shlex.split(rerun_command(plan.study, row))
            pairs = [*zip(options[::2], options[1::2], strict=True)]
            given = {option[2:]: value for option, value in pairs if option != "--set"}
            overrides = [value for option, value in pairs if option == "--set"]
            overrides.append(f'controller.name="{given["controller"]}"')
            assert given["seed"] == str(planned.seed)
            assert dump(load(name, overrides)[1]) == setting.toml


def _without(lines):
    row = json.loads(lines[1])
    del row[ERROR]
    return [lines[0], json.dumps(row) + "\n"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: [], "holds no row yet"),
        (lambda lines: [lines[0][:50]], "holds no row yet"),
        (lambda lines: [lines[0], "no json\n", lines[1]], "line 2 is no row"),
        (lambda lines: [lines[0], "[1]\n"], "line 2 .* is no object"),
        (lambda lines: [lines[0], lines[0]], "line 2 .* run 0 "),
        (lambda lines: [lines[0].replace('"run":0', '"run":999')], "run 999 of 180"),
        (lambda lines: [lines[0].replace('"seed":1', '"seed":"1"')], "line 1 .* seed "),
        (_without, "line 2 .* column tracking.all.trailer.cross_p95_m"),
    ],
)
def test_foreign_rows_are_refused_in_one_line(change, message, begun, capsys):
    lines = (begun / "results.jsonl").read_text().splitlines(keepends=True)
    (begun / "results.jsonl").write_text("".join(change(lines)))
    with pytest.raises(InvalidRows, match=message):
        read_sweep(begun)
    refused(begun, "results.jsonl: ", capsys)


def test_other_folders_and_options_are_refused(begun, capsys):
    refused(begun, "the study has paper", capsys, "--against", "pid")
    refused(begun, "above 0", capsys, "--limit", "0")
    for missing in ("study.toml", "versions.json", "results.jsonl"):
        content = (begun / missing).read_bytes()
        (begun / missing).unlink()
        refused(begun, missing, capsys)
        (begun / missing).write_bytes(content)
    shutil.rmtree(begun)
    refused(begun, begun.name, capsys)


def test_the_page_is_self_contained_and_every_link_has_a_target(folder, text):
    assert not re.search(r"https?:|@import|url\((?!#)", text)
    page = Page(text)
    assert len(set(page.names)) == len(page.names)
    for link in page.links:
        if link.startswith("#runs="):
            continue
        if link.startswith("#"):
            assert link[1:] in page.names
        else:
            assert (folder / "report" / link).exists(), link
    assert {"../logs/2.mcap", "../logs/2.mp4", "../results.jsonl"} <= set(page.links)


def test_every_run_has_a_row_that_identifies_it_and_text_is_escaped(folder, text):
    every = re.search(r'id="every".*?</table>', text, re.DOTALL)[0]
    lines = re.findall(r"<tr>.*?</tr>", every.partition("<tbody>")[2], re.DOTALL)
    for row, line in zip(read_sweep(folder).rows.to_dict("records"), lines, strict=True):
        for word in (row["run_id"], row["controller"], row["status"], html.escape(row["failure"])):
            assert word in line
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
        (("seeds = 2", DRAWN), None, "over wheelbase [m]", "Points:"),
        (("seeds = 2", AXES), 1, "71 missing", "minus"),  # in progress
        (("seeds = 2", AXES.replace('"paper", "ttempc", ', "")), None, "hatched", "Differences to"),
        (("seeds = 2", AXES.replace(', "feedforward"', "")), None, "paper minus ttempc", "failed"),
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
    Page(text)
    shown = re.sub(r"\(lost, invalid, failed, crashed\)", "", text)
    assert present in shown
    assert absent not in shown


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


def test_the_others_are_compared_with_the_best_or_with_that_of_the_reader(folder, tmp_path):
    copied = shutil.copytree(folder, tmp_path / folder.name)
    page = report_page(copied)
    assert "Differences to ttempc" in page
    assert "paper minus ttempc" in page
    page = report_page(copied, "--against", "paper")
    assert "Differences to paper" in page
    assert "ttempc minus paper" in page


def test_no_more_runs_are_listed_than_are_worst(text):
    worst = re.search(r'id="worst".*?</table>', text, re.DOTALL)[0]
    listed = re.findall(r"<td>(paper|ttempc|feedforward)</td>", worst)
    # 24 runs each: two are the worst 5 %; of feedforward, eight are lost.
    assert [listed.count(name) for name in ("paper", "ttempc", "feedforward")] == [2, 2, 4]


@needs_browser
def test_the_page_fits_a_phone_and_a_screen(folder, text, tmp_path):
    pages = measured(folder / "report" / "report.html", (390, 1280), tmp_path)
    for width, page in pages.items():
        assert page["width"] <= width
        assert page["outside"] == []


@needs_browser
def test_a_browser_sorts_tables_and_picks_runs(folder, text, tmp_path):
    # Two clicks on the error of the controllers, one on the runs of the last.
    clicks = """<script>
      const heads = document.querySelectorAll("#controllers th button");
      heads[4].click(); heads[4].click();
      location.hash = document.querySelector("#controllers tbody tr:last-child a[data-runs]").hash;
    </script>"""
    file = tmp_path / "clicked.html"
    file.write_text(text.replace("</body>", f"{clicks}</body>"))
    page = dump_dom(file, tmp_path)
    table = re.search(r'id="controllers".*?</table>', page, re.DOTALL)[0]
    order = re.findall(r"<tr>\s*<td>([\w-]+)</td>", table)
    assert order == ["feedforward", "paper", "ttempc"]
    assert 'aria-sort="descending"' in table
    every = re.search(r'id="every".*?</table>', page, re.DOTALL)[0]
    shown = re.findall(r"<tr>\s*<td[^>]*>(\d+)</td>", every)
    assert [int(run) for run in shown] == list(range(1, 72, 3))
    assert "24 picked." in page
    assert re.search(r'<details id="runs"[^>]* open', page)
