"""Report of a run: self-contained, complete, with escaped text."""

import base64
import re
from dataclasses import replace

import pytest
from proving_ground.experiments.pictures.figures import draw
from proving_ground.experiments.pictures.report.run_report import render_run_report
from proving_ground.experiments.results.summary import RunFacts, summarise
from proving_ground.testbed.recording.record import Event

from tests.records import record

FACTS = RunFacts(
    run_id="0",
    scenario="made-up",
    controller="none",
    seed=1,
    status="lost",
    failure="roll-over <at> the & fence",
    versions={"ttempc": "9.8"},
    log="log.mcap",
)
SCENARIO = 'name = "made-up"\n# <script>alert(1)</script>\n'


@pytest.fixture(scope="module")
def run():
    return record(cross=(0.1234, 0.0567), events=(Event(31.4, "warning", "fallback <b>"),))


@pytest.fixture(scope="module")
def pictures(run):
    return draw(run)


@pytest.fixture(scope="module")
def text(run, pictures):
    summary = summarise(run, FACTS)
    return render_run_report(
        summary,
        run,
        SCENARIO,
        pictures,
        description="Sand & <b>stones</b>",
    )


def links(page):
    return [link for link in re.findall(r'(?:href|src)="([^"]*)"', page) if link[:5] != "data:"]


def test_it_loads_no_other_file(text):
    assert not re.search(r"https?:|//|@import|url\(", re.sub(r"base64,[\w+/=]*", "", text))
    assert links(text) == ["log.mcap", "summary.json", "scenario.toml"]
    assert not re.search(r"<(script|link|iframe)\b", text)


def test_it_holds_every_figure_with_an_alternative_text(text, pictures):
    images = re.findall(r'<img src="data:image/png;base64,([^"]*)" alt="[^"]+"', text)
    assert [base64.b64decode(image) for image in images] == list(pictures.values())


def test_it_shows_errors_status_events_machine_and_versions(run, text):
    # Measured errors [cm], outcome, versions, time of an event.
    for word in ("12.3", "5.7", "roll-over", "ttempc 9.8", "31.40 s"):
        assert word in text
    metadata = {"started": "2026-03-01T23:30:00+02:00", "machine": "an abacus, 3 cores"}
    dated = replace(run, metadata=metadata)
    page = render_run_report(summarise(run, FACTS), dated, SCENARIO, {})
    assert "01 March 2026, 21:30 UTC, on an abacus, 3 cores" in page


def test_text_is_escaped(text):
    for danger in ("<script>", "<b>", "<at>"):
        assert danger not in text
    assert "roll-over &lt;at&gt; the &amp; fence" in text


def test_a_flood_of_events_is_cut_and_counted(run):
    flooded = replace(run, events=[Event(float(k), "info", "one of many") for k in range(250)])
    text = render_run_report(summarise(run, FACTS), flooded, SCENARIO, {})
    assert text.count("of many") == 100
    assert "150 more in the log" in text


def test_a_run_without_log_failure_events_or_numbers_has_a_report():
    facts = replace(FACTS, status="completed", failure=None, log=None)
    empty = record(duration_s=0.0)
    assert links(render_run_report(summarise(empty, facts), empty, "", {})) == [
        "summary.json",
        "scenario.toml",
    ]


def test_the_report_of_a_run_with_an_implement_has_its_tool_and_draft():
    with_tool = record(tool=(0.03, 0.04))
    text = render_run_report(summarise(with_tool, FACTS), with_tool, SCENARIO, {})
    for words in ("tool, straight", "tool, curve", "tool, all", "draft 919 N (mean)"):
        assert words in text
