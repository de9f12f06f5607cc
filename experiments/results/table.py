"""Console tables of runs: plain text, at most 80 columns."""

import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from ...testbed.recording.record import OVERRUN, Event
from ...testbed.terminal import one_line
from .summary import (
    BodyStatistics,
    CorridorStatistics,
    LineStatistics,
    Summary,
    TrackingStatistics,
)
from .tracking_errors import START_UP_S

WIDTH: Final = 80

COUNTED: Final = f"The first {START_UP_S:g} s and a final standstill do not count."
COLUMNS: Final = {
    "p95": "cross_p95_m",
    "sd": "cross_sd_m",
    "mean": "cross_mean_m",
    "along mean": "along_mean_m",
    "along sd": "along_sd_m",
}
"""Columns of the tables of runs: head, and key of an error statistic; the headline first."""
_BODY_WIDTH: Final = 22  # of the first column of a table


def format_run(summary: Summary) -> str:
    """Return the tracking errors of a run as text, in centimetres.

    The first lines are on the whole path, and of these the first on the working point.
    """
    lines = [
        f"{summary.scenario} · {summary.controller} · seed {summary.seed}: {summary.status} "
        f"after {summary.duration_s:.1f} s",
        "",
        "Cross-track error [cm]".ljust(_BODY_WIDTH) + _row(COLUMNS),
    ]
    for place, body, *cells in tracking_rows(summary.tracking):
        lines.append(f"{place:<12}{body}".ljust(_BODY_WIDTH) + _row(cells))
    lines += ["", *_other_numbers(summary)]
    lines.append("p95: of the absolute error. " + COUNTED)
    for text in summary.learnt:
        lines += textwrap.wrap(f"Learnt at {text}", WIDTH, subsequent_indent="  ")
    if summary.failure:
        lines += ["", *textwrap.wrap(f"{summary.status}: {summary.failure}", WIDTH)]
    return "\n".join(lines)


def tracking_rows(tracking: TrackingStatistics) -> list[tuple[str, ...]]:
    """Return rows of place, point and `COLUMNS` in cm, the whole path and the working point first.

    A path without curves, or of curves alone, has no rows of what it lacks.
    """
    rows = []
    for where, place in (("all", "whole path"), ("straight", "straight"), ("curve", "curve")):
        bodies: BodyStatistics = getattr(tracking, where)
        for body, error in bodies.by_point.items():
            if where != "all" and error.cross_p95_m is None:
                continue
            cells = (centimetres(getattr(error, key)) for key in COLUMNS.values())
            rows.append((place, body, *cells))
    return rows


def format_events(events: Sequence[Event], folder: Path) -> list[str]:
    """Return lines on the warnings of a run; of overruns, which tell of the machine, the count."""
    warnings = [event for event in events if event.level == "warning"]
    if not warnings:
        return []
    overruns = [event for event in warnings if event.text.startswith(OVERRUN)]
    others = [event for event in warnings if not event.text.startswith(OVERRUN)]
    first = (others or overruns)[0]
    counted = f" ({len(overruns)} of a slow machine: overruns)" if overruns else ""
    text = f"Warnings: {len(warnings)}{counted}, at {first.time_s:.1f} s: {first.text}"
    lines = textwrap.wrap(one_line(text), WIDTH, subsequent_indent="  ")
    return [*lines, f"All events: ttempc log info {folder}"]


def format_corridor(corridor: CorridorStatistics) -> str:
    """Return the departure from the corridor as one line of text."""
    points = {"tractor": corridor.tractor, "trailer": corridor.trailer, "tool": corridor.tool}
    parts = [
        f"{name} {100.0 * point.outside_fraction:.2f} % "
        f"(largest distance {centimetres(point.max_m)} cm)"
        for name, point in points.items()
        if point is not None and point.outside_fraction is not None
    ]
    if corridor.hitch_outside_fraction is not None:
        parts.append(f"hitch angle {100.0 * corridor.hitch_outside_fraction:.2f} %")
    return f"Outside the corridor: {', '.join(parts) or 'nothing counted'}"


def format_line(line: LineStatistics) -> str:
    """Return the offsets from the line as given as one line of text."""
    points = {"tractor": line.tractor, "trailer": line.trailer, "tool": line.tool}
    parts = [
        f"{name} {centimetres(offset.p95_m)} cm (p95)"
        for name, offset in points.items()
        if offset is not None
    ]
    bent = line.tractor_reference
    towed = line.trailer_reference
    parts.append(f"reference {centimetres(bent.rms_m)} (rms), {centimetres(bent.max_m)} (largest)")
    parts.append(f"reference of the trailer {centimetres(towed.max_m)} (largest)")
    return f"Beside the line as given: {', '.join(parts)}"


def centimetres(metres: float | None, decimals: int = 1) -> str:
    """Return a length as text in centimetres, a dash for None."""
    return "–" if metres is None else f"{100.0 * metres:.{decimals}f}"


def _row(cells: Iterable[str]) -> str:
    """Return cells side by side, each as wide as its head in `COLUMNS`."""
    widths = (max(len(head), 5) + 2 for head in COLUMNS)
    return "".join(cell.rjust(width) for width, cell in zip(widths, cells, strict=True))


def _other_numbers(summary: Summary) -> list[str]:
    step = summary.timing.control_step_us
    factor = summary.timing.real_time_factor
    lines = []
    if step.median is not None and step.p99 is not None:
        lines.append(f"Control step {step.median:.0f} µs (median), {step.p99:.0f} µs (p99)")
    inputs = summary.inputs
    shares = {
        "front steering": inputs.delta_t.saturated_fraction,
        "trailer steering": inputs.delta_i.saturated_fraction,
        "hydrostat": inputs.hp.saturated_fraction,
    }
    held = [f"{name} {100.0 * share:.1f} %" for name, share in shares.items() if share]
    if held:
        lines += textwrap.wrap(f"At a limit of size or rate: {', '.join(held)} of the ticks", WIDTH)
    slip = summary.slip.rear_mean
    implement = summary.implement
    if implement is not None and implement.draft_mean_n is not None and slip is not None:
        lines.append(
            f"Draft {implement.draft_mean_n:.0f} N (mean), {implement.draft_p95_n:.0f} N (p95); "
            f"slip of the rear wheels {100.0 * slip:.1f} % (mean)"
        )
    tube = summary.tube
    if tube is not None and tube.contained_fraction is not None and tube.margin_min is not None:
        lines.append(
            f"Both true axle points in the tube at {100.0 * tube.contained_fraction:.2f} % of the "
            f"ticks, smallest margin {tube.margin_min:.2f}"
        )
    if summary.corridor is not None:
        lines += textwrap.wrap(format_corridor(summary.corridor), WIDTH, subsequent_indent="  ")
    if summary.line is not None:
        lines += textwrap.wrap(format_line(summary.line), WIDTH, subsequent_indent="  ")
    if factor is not None:
        lines.append(f"Simulated {factor:.0f} times faster than real time")
    return lines
