"""Report of a run as one self-contained HTML page."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from datetime import UTC, datetime
from typing import Final

from ...testbed.recording.record import Record
from ..figures import CAPTIONS
from ..results.summary import ImplementStatistics, InputStatistics, Spread, Summary
from ..results.table import centimetres, format_corridor
from ..results.tracking_errors import START_UP_S
from .html import Picture, environment

_EVENTS_SHOWN: Final = 100  # an intermittent fault would fill the page; the log has all
FILES: Final = ("summary.json", "scenario.toml")
"""Files of a run beside its report."""


def render_run_report(
    summary: Summary,
    record: Record,
    scenario_toml: str,
    pictures: Mapping[str, bytes],
    *,
    description: str = "",
    files: Sequence[str] = FILES,
) -> str:
    """Return the text of `report.html`.

    Args:
        summary: of the run.
        record: of the run; its metadata have date, machine and parameter mismatch.
        scenario_toml: the resolved scenario.
        pictures: contents of PNG files, by the figure's name.
        description: of the scenario.
        files: beside the page, besides the log.
    """
    template = environment().get_template("report.html.j2")
    return template.render(
        summary=summary,
        start_up_s=START_UP_S,
        errors=_errors(summary),
        facts=[
            *_facts(summary),
            ("parameter mismatch", record.metadata.get("mismatch", "unknown")),
        ],
        description=description,
        dated=_dated(record.metadata),
        files=[*([summary.log] if summary.log else []), *files],
        pictures=[
            Picture.of(name, CAPTIONS.get(name, name), content)
            for name, content in pictures.items()
        ],
        events=record.events[:_EVENTS_SHOWN],
        hidden_events=max(0, len(record.events) - _EVENTS_SHOWN),
        scenario_toml=scenario_toml,
    )


def _dated(metadata: Mapping[str, str]) -> str:
    """Return when and where a run was driven; logs of earlier versions do not say where."""
    started = metadata.get("started", "")
    with contextlib.suppress(ValueError):
        started = f"{datetime.fromisoformat(started).astimezone(UTC):%d %B %Y, %H:%M} UTC"
    where = metadata.get("machine", "an unknown machine")
    return f"Driven on {started or 'an unknown day'}, on {where}."


def _errors(summary: Summary) -> list[tuple[str, tuple[float | None, ...]]]:
    return [
        (f"{point}, {where}", astuple(error))
        for where in ("straight", "curve", "all")
        for point, error in getattr(summary.tracking, where).by_point.items()
    ]


def _facts(summary: Summary) -> list[tuple[str, str]]:
    timing, inputs, slip = summary.timing, summary.inputs, summary.slip
    estimation, implement = summary.estimation, summary.implement
    return [
        ("run", summary.run_id),
        ("versions", ", ".join(f"{name} {text}" for name, text in summary.versions.items())),
        ("real-time factor", _number(timing.real_time_factor, "{:.1f}")),
        ("control step", _spread(timing.control_step_us)),
        ("QP solve", _spread(timing.qp_solve_us)),
        ("estimator", _spread(timing.estimator_us)),
        ("physics step", _spread(timing.plant_step_us)),
        (
            "estimation error",
            f"tractor {centimetres(estimation.tractor.mean_euclidean_m)} cm, "
            f"trailer {centimetres(estimation.trailer.mean_euclidean_m)} cm (mean)",
        ),
        ("front steering", _input(inputs.delta_t, "rad")),
        ("trailer steering", _input(inputs.delta_i, "rad")),
        ("hydrostat", _input(inputs.hp, "1")),
        (
            "slip",
            f"rear wheels {_number(slip.rear_mean, '{:.1%}')} (mean), "
            f"{_number(slip.rear_p95, '{:.1%}')} (p95); trailer slip angle "
            f"{_number(slip.trailer_slip_angle_p95_rad, '{:.3f}')} rad (p95)",
        ),
        *([("implement", _implement(implement))] if implement else []),
        *([("corridor", format_corridor(summary.corridor))] if summary.corridor else []),
    ]


def _spread(cost_us: Spread) -> str:
    parts = (("median", cost_us.median), ("p99", cost_us.p99), ("max", cost_us.max))
    return ", ".join(f"{name} {_number(value, '{:.0f}')} µs" for name, value in parts)


def _implement(statistics: ImplementStatistics) -> str:
    return (
        f"draft {_number(statistics.draft_mean_n, '{:.0f}')} N (mean), "
        f"{_number(statistics.draft_p95_n, '{:.0f}')} N (p95); side force "
        f"{_number(statistics.side_p95_n, '{:.0f}')} N (p95); depth "
        f"{centimetres(statistics.depth_mean_m)} cm (mean)"
    )


def _input(statistics: InputStatistics, unit: str) -> str:
    return (
        f"at a limit {_number(statistics.saturated_fraction, '{:.1%}')} of the ticks, "
        f"rms rate {_number(statistics.rms_rate, '{:.3f}')} {unit}/s, "
        f"travel {_number(statistics.travel_per_m, '{:.3f}')} {unit}/m"
    )


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else form.format(value)
