"""Report of a run: self-contained, complete, with escaped text."""

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from proving_ground.experiments.figures import draw
from proving_ground.experiments.report.run_report import render_run_report
from proving_ground.experiments.results.summary import RunFacts, summarise
from proving_ground.testbed.recording.record import Event

from tests.browser import luminances, measured, needs_browser, printed_pages
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

    VOID = frozenset({"meta", "img", "br", "link", "input"})

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
    return render_run_report(
        summary,
        run,
        SCENARIO,
        pictures,
        description="Sand & <b>stones</b>",
    )


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


def test_a_flood_of_events_is_cut_and_counted(run, pictures):
    events = [Event(float(k), "info", f"event {k} of many") for k in range(250)]
    flooded = replace(run, events=events)
    text = render_run_report(summarise(run, FACTS), flooded, SCENARIO, pictures)
    assert text.count("of many") == 100
    assert "150 more in the log" in text


def test_a_run_without_log_failure_events_or_numbers_has_a_report():
    facts = replace(FACTS, status="completed", failure=None, log=None)
    empty = record(duration_s=0.0)
    page = Page(render_run_report(summarise(empty, facts), empty, "", {}))
    assert page.links == ["summary.json", "scenario.toml"]


def test_the_report_of_a_run_with_an_implement_has_its_tool_and_draft():
    with_tool = record(tool=(0.03, 0.04))
    text = render_run_report(summarise(with_tool, FACTS), with_tool, SCENARIO, {})
    for words in ("tool, straight", "tool, curve", "tool, all", "draft 919 N (mean)"):
        assert words in text
    without = render_run_report(summarise(record(), FACTS), record(), SCENARIO, {})
    assert "tool, " not in without
    assert "draft" not in without


@needs_browser
def test_it_fits_a_phone_a_tablet_and_a_screen_and_prints_three_pages(text, tmp_path):
    """Nothing is cut off sideways: what is wider than the page scrolls within its own box."""
    file = tmp_path / "report.html"
    file.write_text(text)
    for width, page in measured(file, (390, 768, 1280), tmp_path).items():
        assert page["width"] <= width, "the page itself does not scroll sideways"
        assert page["outside"] == [], "every element lies on the page or in a box that scrolls"
        assert all(0.8 * min(width, 864) <= image <= width for image in page["images"])
        assert page["hint"] is (page["scrolls"] > 0), "a hint where a table scrolls"
    assert printed_pages(file, tmp_path) <= 3


@needs_browser
def test_the_settings_are_folded_and_a_dark_page_is_dark(text, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(text)
    light = luminances(file, tmp_path)
    dark = luminances(file, tmp_path, "--blink-settings=preferredColorScheme=0")
    assert light["paper"] > 0.9 > 0.1 > dark["paper"]
    for page in (light, dark):
        assert abs(page["ink"] - page["paper"]) > 0.5
    assert light["open"] == dark["open"] == 0
