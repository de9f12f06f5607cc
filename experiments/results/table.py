"""Console table of a run: plain text, at most 80 columns."""

from __future__ import annotations

import textwrap
from typing import Final

from .published import CAVEAT, compare
from .summary import BodyStatistics, ErrorStatistics, Summary

WIDTH: Final = 80

_HEADS: Final = ("mean", "published", "rms", "p95", "max", "cross mean", "sd")
_BODY_WIDTH: Final = 18


def format_run(summary: Summary) -> str:
    """Return the tracking errors of a run and the published ones as text, in centimetres."""
    published = {(item.where, item.body): item.published_m for item in compare(summary)}
    lines = [
        f"{summary.scenario} · {summary.controller} · seed {summary.seed}: {summary.status} "
        f"after {summary.duration_s:.1f} s",
        "",
        "Tracking error [cm]".ljust(_BODY_WIDTH) + _row(_HEADS),
    ]
    for where in ("straight", "curve", "all"):
        bodies: BodyStatistics = getattr(summary.tracking, where)
        for body, error in bodies.by_point.items():
            cells = _cells(error, published.get((where, body)))
            lines.append(f"{where:<10}{body}".ljust(_BODY_WIDTH) + _row(cells))
    lines += [
        "",
        *_other_numbers(summary),
        CAVEAT[0].upper() + CAVEAT[1:] + ". The first 8 s do not count.",
    ]
    if summary.failure:
        lines += ["", *textwrap.wrap(f"{summary.status}: {summary.failure}", WIDTH)]
    return "\n".join(lines)


def centimetres(metres: float | None, decimals: int = 1) -> str:
    """Return a length as text in centimetres, a dash for None."""
    return "–" if metres is None else f"{100.0 * metres:.{decimals}f}"


def _cells(error: ErrorStatistics, published_m: float | None) -> tuple[str, ...]:
    """Return the cells of one line in the order of `_HEADS`."""
    numbers = (
        error.mean_euclidean_m,
        published_m,
        error.rms_m,
        error.p95_m,
        error.max_m,
        error.cross_mean_m,
        error.cross_sd_m,
    )
    return tuple(centimetres(number) for number in numbers)


def _row(cells: tuple[str, ...]) -> str:
    widths = [max(len(head), 5) + 2 for head in _HEADS]
    return "".join(cell.rjust(width) for cell, width in zip(cells, widths, strict=True))


def _other_numbers(summary: Summary) -> list[str]:
    """Return lines on timing and containment, as far as the run has these numbers."""
    step, factor = summary.timing.control_step_us, summary.timing.real_time_factor
    lines = []
    if step.median is not None and step.p99 is not None:
        lines.append(f"Control step {step.median:.0f} us (median), {step.p99:.0f} us (p99)")
    slip, implement = summary.slip.rear_mean, summary.implement
    if implement is not None and implement.draft_mean_n is not None and slip is not None:
        lines.append(
            f"Draft {implement.draft_mean_n:.0f} N (mean), {implement.draft_p95_n:.0f} N (p95); "
            f"slip of the rear wheels {100.0 * slip:.1f} % (mean)"
        )
    tube = summary.tube
    if tube is not None and tube.contained_fraction is not None and tube.margin_min is not None:
        lines.append(
            f"In the tube {100.0 * tube.contained_fraction:.2f} % of the ticks, smallest margin "
            f"{tube.margin_min:.2f}"
        )
    if factor is not None:
        lines.append(f"Simulated {factor:.0f} times faster than real time")
    return lines
