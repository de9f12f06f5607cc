"""Report of a sweep: a self-contained page, in every state of a study."""

import html
import json
import os
import re
import shutil
from dataclasses import asdict
from functools import reduce
from html.parser import HTMLParser

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.search.limit import Envelope, Probe, Question
from proving_ground.experiments.search.quantities import QUANTITIES
from proving_ground.experiments.sweep_report.files import docs_page
from proving_ground.experiments.sweep_report.report import make_report
from proving_ground.experiments.sweep_report.runs import read_sweep

from tests.browser import dump_dom, measured, needs_browser
from tests.experiments.sweep_rows import AXES, DRAWN, swept, synthetic_row

VOID = {"meta", "br", "path", "use"}


class Page(HTMLParser):
    """Check that tags are closed in order; collect links and ids."""

    def __init__(self, text):
        super().__init__()
        self.open, self.links, self.names = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.links += [given[name] for name in ("href", "src") if name in given]
        self.names += [given["id"]] if "id" in given else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        if tag not in VOID:
            attrs = [(name, value) for name, value in attrs]
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return swept(tmp_path_factory.mktemp("study"), "seeds = 2", AXES, work=with_log)


@pytest.fixture(scope="module")
def text(folder):
    return report_page(folder)


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


def test_every_run_has_a_row_that_identifies_it(folder, text):
    for row in read_sweep(folder).rows:
        (line,) = re.findall(rf'<tr data-run="{row["run"]}">.*?</tr>', text, re.DOTALL)
        for word in (row["run_id"], row["controller"], row["status"], html.escape(row["failure"])):
            assert word in line


def test_text_is_escaped(text):
    assert "<at>" not in text
    assert "roll-over &lt;at&gt; the &amp; fence" in text


def test_pictures_are_small_and_the_summary_shows_them_all(folder, text):
    pictures = sorted((folder / "report").glob("*.png"))
    assert [file.stem for file in pictures] == ["curves", "maps", "overview"]
    assert all(file.stat().st_size < 300_000 for file in pictures)
    summary = (folder / "report" / "summary.md").read_text()
    for file in pictures:
        assert f"]({file.name})" in summary
    assert "| `feedforward` | 24 | 8 | 33 (16 to 55) |" in summary


def test_a_report_follows_from_the_rows_alone_whatever_their_order(folder, text, tmp_path):
    other = shutil.copytree(folder, tmp_path / folder.name)
    file = other / "results.jsonl"
    file.write_text("".join(reversed(file.read_text().splitlines(keepends=True))))
    assert report_page(other) == text


@pytest.mark.parametrize(
    ("parts", "most", "present", "absent"),
    [
        (("seeds = 3",), None, "Tails", "Differences to"),  # one controller, no axis
        (("seeds = 2", DRAWN), None, "over wheelbase [m]", "Points:"),
        (("seeds = 2", AXES), 1, "71 missing", "Error over"),
        (("seeds = 2", AXES.replace('"paper", "ttempc", ', "")), None, "hatched", "Differences to"),
    ],
)
def test_any_study_can_be_reported(parts, most, present, absent, tmp_path):
    folder = swept(tmp_path, *parts, most=most)
    text = report_page(folder)
    Page(text)
    assert present in text
    assert absent not in text


def test_an_old_report_is_replaced_and_what_is_not_its_own_is_left(tmp_path):
    folder = swept(tmp_path, "seeds = 1", most=1)
    (folder / "report").mkdir()
    for name in ("maps-2.png", "curves.png", "report.html", "notes.txt"):
        (folder / "report" / name).write_text("old")
    report_page(folder)
    names = {file.name for file in (folder / "report").iterdir()}
    assert names == {"overview.png", "report.html", "summary.md", "notes.txt"}


def test_a_report_that_cannot_be_written_leaves_the_old_one(tmp_path, capsys, monkeypatch):
    folder = swept(tmp_path, "seeds = 1", most=1)
    text = report_page(folder)

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert main(["report", str(folder), "--limit", "0.1"]) == 2
    assert capsys.readouterr().err.endswith("cannot be written: No space left on device\n")
    assert (folder / "report" / "report.html").read_text() == text
    assert not list((folder / "report").glob("*.part"))


def test_the_page_for_docs_names_its_pictures(tmp_path):
    text, pictures = docs_page(make_report(read_sweep(swept(tmp_path, "seeds = 1", most=1))))
    assert text.startswith("# made-up\n")
    assert set(re.findall(r"\]\((.*?\.png)\)", text)) == {*pictures} == {"made-up-overview.png"}


def answer(controller, outcome, holds_at, fails_at, probes):
    """Return an object of the JSON file of `ttempc search limit`."""
    question = Question("grass", controller, "slope", QUANTITIES["slope"], 0.01, 0.6, (1, 2))
    probes = tuple(Probe(value, 2, failed, 0, (0.1, None)) for value, failed in probes)
    return asdict(Envelope(question, outcome, True, holds_at, fails_at, probes))


def test_breaking_points_stand_beside_the_sweep(tmp_path):
    folder, file = swept(tmp_path, "seeds = 1", most=1), tmp_path / "slope.json"
    answers = [
        answer("paper", "found", 0.2, 0.25, [(0.0, 0), (0.2, 0), (0.25, 1), (0.4, 2)]),
        answer("pid", "holds", None, None, [(0.0, 0), (0.4, 0)]),
    ]
    file.write_text(json.dumps({"versions": {}, "envelopes": answers}))
    text = report_page(folder, "--envelope", str(file))
    Page(text)
    (table,) = re.findall(r'id="breaking".*?</table>', text, re.DOTALL)
    cells = [re.findall(r"<td>(.*?)</td>", row) for row in re.findall(r"<tr>.*?</tr>", table, re.S)]
    assert cells[1] == ["paper", "slope [rad]", "0.2", "0.25", "once", "4", "8"]
    assert cells[2] == ["pid", "slope [rad]", "throughout", "–", "–", "2", "4"]
    assert (
        "grass, seeds 1, 2; a run fails where it does not complete, or errs by more than 60 cm"
        in text
    )
    assert (folder / "report" / "envelope.png").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read: No such file"),
        ("", "is not what"),
        ("[]", "is not what"),
        ("{}", "Field required"),
        ('{"versions": {}, "envelopes": [{"question": {}}]}', "Field required"),
    ],
)
def test_a_file_without_an_envelope_is_refused(content, words, tmp_path, capsys):
    folder, file = swept(tmp_path, "seeds = 1", most=1), tmp_path / "slope.json"
    if content is not None:
        file.write_text(content)
    refused(folder, file, words, capsys)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (("question", "quantity"), "colour", "must be one of cone-index, slope"),
        (("question", "mood"), "good", "envelopes.0.question.mood: unknown key"),
        (("outcome",), "perhaps", "envelopes.0.outcome: "),
        (("probes",), [], "envelopes.0.probes: "),
        (("probes", 0, "runs"), 0, "envelopes.0.probes.0.runs: "),
        (("probes", 0, "failed"), -1, "envelopes.0.probes.0.failed: "),
        (("probes", 0, "value"), float("nan"), "envelopes.0.probes.0.value"),
    ],
)
def test_an_invalid_envelope_is_refused_with_its_key(place, value, words, tmp_path, capsys):
    folder, file = swept(tmp_path, "seeds = 1", most=1), tmp_path / "slope.json"
    content = json.loads(json.dumps(answer("pid", "holds", None, None, [(0.0, 0), (0.4, 0)])))
    *above, last = place
    reduce(lambda part, key: part[key], above, content)[last] = value
    file.write_text(json.dumps({"versions": {}, "envelopes": [content]}))
    refused(folder, file, words, capsys)


def refused(folder, file, words, capsys):
    assert main(["report", str(folder), "--envelope", str(file)]) == 2
    printed = capsys.readouterr().err
    assert re.fullmatch(r"ttempc: error: .*slope.json: [^\n]*\n", printed)
    assert words in printed
    assert not (folder / "report").exists()


def test_the_title_is_the_study_in_whatever_folder(folder, tmp_path):
    moved = shutil.copytree(folder, tmp_path / "s2")
    assert "<h1>made-up</h1>" in report_page(moved)


def test_where_no_run_fails_no_table_or_chart_shows_failures(tmp_path):
    harmless = AXES.replace(', "feedforward"', "")
    folder = swept(tmp_path, "seeds = 2", harmless)
    page, summary = report_page(folder), (folder / "report" / "summary.md").read_text()
    for words in ("nowhere", "alone<br>failed", "Failed runs over", "failed [%]</figcaption>"):
        assert words not in page
    assert "failed" not in re.search(r'id="cells".*?</thead>', page, re.DOTALL)[0]
    assert "| failed [%] |" not in summary.partition("## Points")[2]
    assert page.count("minus") == 1  # the map of the difference of the two best
    assert "ttempc minus paper: error [cm]" in page


def test_the_reference_is_the_best_rival_or_that_of_the_reader(folder, tmp_path, capsys):
    copied = shutil.copytree(folder, tmp_path / folder.name)
    page = report_page(copied)
    assert "Differences to paper" in page  # the second best; feedforward fails a third
    assert "ttempc minus paper" in page
    page = report_page(copied, "--against", "ttempc")
    assert "Differences to ttempc" in page
    assert "paper minus ttempc" in page
    assert main(["report", str(copied), "--against", "nobody"]) == 2
    assert "--against nobody: the study has paper, ttempc, feedforward" in capsys.readouterr().err


@needs_browser
def test_the_page_fits_a_phone_and_a_screen(folder, text, tmp_path):
    for width, page in measured(folder / "report" / "report.html", (390, 1280), tmp_path).items():
        assert page["width"] <= width
        assert page["outside"] == []


@needs_browser
def test_a_browser_sorts_tables_and_picks_runs(folder, text, tmp_path):
    # Two clicks on "error, mean" of the controllers, one on the failed runs of feedforward.
    clicks = """<script>
      const heads = document.querySelectorAll("#controllers th button");
      heads[4].click(); heads[4].click();
      location.hash = document.querySelector("#controllers tbody tr:last-child a[data-runs]").hash;
    </script>"""
    file = tmp_path / "clicked.html"
    file.write_text(text.replace("</body>", f"{clicks}</body>"))
    page = dump_dom(file, tmp_path)
    table = re.search(r'id="controllers".*?</table>', page, re.DOTALL)[0]
    order = re.findall(r"<tr><td>([\w-]+)</td>", table)
    assert order == ["feedforward", "paper", "ttempc"]
    assert 'aria-sort="descending"' in table
    shown = re.findall(r'<tr data-run="(\d+)">', page)
    assert [int(run) for run in shown] == list(range(1, 72, 3))
    assert "24 picked." in page
    assert re.search(r'<details id="runs"[^>]* open', page)
