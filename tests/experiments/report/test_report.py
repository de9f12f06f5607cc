"""Report of a run: self-contained, complete, with escaped text."""

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from proving_ground.experiments.figures import draw
from proving_ground.experiments.report.run_report import render_run_report
from proving_ground.experiments.results.metrics import summarise
from proving_ground.experiments.results.published import compare
from proving_ground.experiments.results.summary import RunFacts
from proving_ground.testbed.recording.record import Event
from tests.records import record

FACTS = RunFacts(
    run_id="0",
    scenario="made-up",
    controller="none",
    seed=1,
    status="lost",
    failure="roll-over <at> the & fence",
    wall_s=10.0,
    versions={"ttempc": "9.8"},
    log="log.mcap",
)
SCENARIO = 'name = "made-up"\n# <script>alert(1)</script>\n'


class Page(HTMLParser):
    """Parser that checks the nesting of tags and collects links and images."""

    VOID = frozenset({"meta", "img", "br", "link"})

    def __init__(self, text):
        super().__init__()
        self.open, self.links, self.images, self.tags = [], [], [], set()
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        attributes = dict(attrs)
        self.links += [attributes[name] for name in ("href", "src") if name in attributes]
        if tag == "img":
            self.images.append(attributes)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def run():
    return record(cross=(0.1234, 0.0567), events=(Event(31.4, "warning", "fallback <b>"),))


@pytest.fixture(scope="module")
def pictures(run):
    return draw(run)


@pytest.fixture(scope="module")
def text(run, pictures):
    summary = summarise(run, FACTS)
    return render_run_report(summary, run.events, SCENARIO, pictures, comparison=compare(summary))


def test_it_loads_no_other_file(text):
    assert not re.search(r"https?:|//|@import|url\(", re.sub(r"base64,[\w+/=]*", "", text))
    links = [link for link in Page(text).links if not link.startswith("data:")]
    assert links == ["log.mcap", "summary.json", "scenario.toml"]
    assert not Page(text).tags & {"script", "link", "iframe"}


def test_it_holds_every_figure_with_an_alternative_text(text, pictures):
    images = Page(text).images
    contents = [base64.b64decode(image["src"].partition(",")[2]) for image in images]
    assert contents == list(pictures.values())
    assert all(image["alt"] for image in images)


def test_it_shows_errors_status_and_events(text):
    for word in (
        "12.3",  # measured [cm]
        "5.7",
        "23.49",  # published [cm]
        "21.21",
        "39.82",
        "36.21",
        "lost",
        "roll-over",
        "ttempc 9.8",
        "31.40 s",
        "ield experiment; here: simulation",
        "60.0 s",
    ):
        assert word in text


def test_text_is_escaped(text):
    for danger in ("<script>", "<b>", "<at>"):
        assert danger not in text
    assert "roll-over &lt;at&gt; the &amp; fence" in text


def test_a_flood_of_events_is_cut_and_counted(run, pictures):
    events = [Event(float(k), "info", f"event {k} of many") for k in range(250)]
    text = render_run_report(summarise(run, FACTS), events, SCENARIO, pictures)
    assert text.count("of many") == 100
    assert "150 more in the log" in text


def test_a_run_without_log_failure_events_or_numbers_has_a_report():
    facts = replace(FACTS, status="completed", failure=None, log=None)
    empty = record(duration_s=0.0)
    page = Page(render_run_report(summarise(empty, facts), (), "", {}))
    assert page.links == ["summary.json", "scenario.toml"]


def test_the_report_of_a_run_with_an_implement_has_its_tool_and_draft():
    summary = summarise(record(tool=(0.03, 0.04)), FACTS)
    text = render_run_report(summary, (), SCENARIO, {})
    for words in ("tool, straight", "tool, curve", "tool, all", "draft 919 N (mean)"):
        assert words in text
    without = render_run_report(summarise(record(), FACTS), (), SCENARIO, {})
    assert "tool, " not in without
    assert "draft" not in without
