"""Report of a run from its log alone, also of a torn or an old one."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Final, cast

from ...testbed.configuration.config_io import parse_toml
from ...testbed.log.reader import RECOVERED_KEY, SALVAGED_KEY, read_content, record_of
from ...testbed.recording.channels import CHANNELS, EVENT_TOPIC, STATE
from ...testbed.recording.record import Record
from ..errors import InvalidReplay
from ..pictures.figures import draw
from ..pictures.report.run_report import render_run_report
from ..results.summary import RunFacts, Status, summarise
from ..run.run_log import BEGINS, ENDS, versions_of
from ..scenario.scenario import ScenarioFile, identity

_SCENARIO: Final = "scenario.toml"
_SAID_ELSEWHERE: Final = (BEGINS, ENDS)  # the page has its own lines of start and end
_STATUS: Final = re.compile(rf"{ENDS}(completed|stopped|lost|invalid) after")


def report_of_log(log: Path) -> str:
    """Return the page of a run as `ttempc run` makes it, as far as its log has the numbers.

    Raises:
        LogError: no such file, not a log of this project, or of another version of it.
        InvalidReplay: the log has no states, or not its scenario.
    """
    topics = {EVENT_TOPIC, *(channel.topic for channel in CHANNELS)}
    content = read_content(log, topics.__contains__)
    record = record_of(content)
    if _SCENARIO not in content.attachments or not len(record[STATE]):
        raise InvalidReplay(f"{log}: has no {_SCENARIO} or no state, as a log that was cut early")
    if not {"scenario", "controller"} <= {*record.metadata} or not _seed(record).isdecimal():
        raise InvalidReplay(f"{log}: does not say scenario, controller and seed of its run")
    text = content.attachments[_SCENARIO].decode(errors="replace")
    source = ScenarioFile(log, parse_toml(text, InvalidReplay, f"{log}: {_SCENARIO}"))
    summary = summarise(record, _facts(log, record, text))
    kept = [event for event in record.events if not event.text.startswith(_SAID_ELSEWHERE)]
    return render_run_report(
        summary,
        replace(record, events=kept),
        text,
        draw(record),
        description=str(source.content.get("description", "")),
        files=(),
    )


def _facts(log: Path, record: Record, scenario_toml: str) -> RunFacts:
    metadata = record.metadata
    versions = versions_of(record.metadata)
    seed = int(_seed(record))
    status, failure = _outcome(record)
    return RunFacts(
        run_id=identity(scenario_toml, seed, versions),
        scenario=metadata["scenario"],
        controller=metadata["controller"],
        seed=seed,
        status=status,
        failure=failure,
        versions=versions,
        log=log.name,
    )


def _seed(record: Record) -> str:
    return record.metadata.get("seed", "")


def _outcome(record: Record) -> tuple[Status, str | None]:
    """Return how the run of a log ended, and why where it did not complete."""
    errors = [event.text for event in record.events if event.level == "error"]
    ends = [match[1] for event in record.events if (match := _STATUS.match(event.text))]
    torn = record.metadata.get(SALVAGED_KEY) or record.metadata.get(RECOVERED_KEY)
    failure = errors[0] if errors else None
    if ends:
        return cast(Status, ends[-1]), failure
    if torn:
        return "torn", failure or f"the log is not whole: {torn}"
    return ("ended early" if errors else "completed"), failure
