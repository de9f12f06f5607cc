"""Sweep report in Markdown with references to its pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from ..results.statistics import caveat
from ..results.summary import ACTUATOR_USE
from ..results.table import centimetres
from ..sweep.failure import ERROR, unmeasured_text
from .format import format_estimate, format_numbers, format_percent, rerun_command
from .report import SweepReport

_MOST_CELLS: Final = 60  # rows of a table that fits between the pictures


def render_summary(report: SweepReport, prefix: str = "") -> str:
    """Return the text of `summary.md`.

    Args:
        report: its content.
        prefix: of the names of the picture files.
    """
    runs = report.runs
    limit = runs.limit_m
    unmeasured = unmeasured_text(runs.unmeasured, limit)
    warning = caveat(runs.unit_count, runs.units, tails=True)
    lines = [
        f"# {runs.name}",
        "",
        runs.study.description,
        "",
        f"{len(runs.rows)} of {runs.planned} runs"
        + (f": **in progress, {runs.missing} missing**" if runs.missing else "")
        + (f", {runs.refused} refused by a scenario or a controller" if runs.refused else "")
        + f"; seeds {format_numbers(runs.study.point_seeds)}, the same ground and noise for every "
        "controller. A run fails where it does not complete"
        + (
            f", or where the trailer's 95 % cross-track error exceeds {centimetres(limit)} cm"
            if limit is not None
            else ""
        )
        + ". "
        + (f"{unmeasured} " if unmeasured else "")
        + "Errors are the 95th percentile of the trailer's unsigned cross-track error in a run, of "
        "runs that completed [cm]. In brackets 95 % intervals: failure rates by "
        f"Clopper and Pearson, means and differences by Student's t over whole {runs.units}, the "
        "other two by bootstrap over them. " + (f"{warning} " if warning else "") + "Simulation.",
        "",
        *_controllers(report),
        *(_differences(report) if report.differences else ()),
    ]
    for section in report.sections:
        picture = f"![{section.title}]({prefix}{section.name}.png)"
        lines += [f"## {section.title}", "", section.caption, "", picture, ""]
    if 0 < len(report.cells) <= _MOST_CELLS:
        lines += _cells(report)
    lines += _worst(report)
    versions = ", ".join(f"{name} {text}" for name, text in runs.origin["versions"].items())
    lines += [
        "## The study",
        "",
        f"Driven with {versions}; code {runs.origin['code']}.",
        "",
        "```toml",
        runs.study.dump().rstrip(),
        "```",
    ]
    return "\n".join(lines) + "\n"


def _controllers(report: SweepReport) -> list[str]:
    heads = [
        "controller",
        "runs",
        "failed",
        "failed [%]",
        "error, mean",
        "95 % of runs below",
        "mean of worst 5 %",
        "control step [us]",
        *(head for head, _, _ in ACTUATOR_USE),
    ]
    rows = []
    for group in report.groups:
        tail = report.tails[group.controller]
        rows.append(
            (
                f"`{report.runs.controllers[group.controller]}`",
                str(group.count),
                str(len(group.failed)),
                format_percent(group.failure_rate),
                format_estimate(group.error_cm),
                format_estimate(tail.quantile95_cm),
                format_estimate(tail.cvar95_cm),
                format_estimate(tail.step_us, 0),
                *map(format_estimate, tail.use),
            )
        )
    return _table(heads, rows)


def _differences(report: SweepReport) -> list[str]:
    against = report.runs.controllers[report.against]
    failures = report.runs.failed.any()
    heads = [f"against `{against}`", "paired runs", "both completed", "difference of errors"]
    if failures:
        heads += ["it alone failed", f"`{against}` alone failed"]
    rows = [
        (
            f"`{report.runs.controllers[item.controller]}`",
            str(len(item.runs)),
            str(item.pairs),
            format_estimate(item.error_cm, sign="+"),
            *((str(len(item.alone_failed)), str(len(item.other_failed))) if failures else ()),
        )
        for item in report.differences
    ]
    return _table(heads, rows)


def _cells(report: SweepReport) -> list[str]:
    labels = [scale.label for scale in report.scales]
    failed = ["failed [%]"] if report.runs.failed.any() else []
    heads = (*labels, "controller", *failed, "error, mean", "runs")
    rows = []
    for cell in report.cells:
        values = [
            scale.texts[place] for scale, place in zip(report.scales, cell.places, strict=True)
        ]
        group = cell.group
        controller = f"`{report.runs.controllers[group.controller]}`"
        failures = [format_percent(group.failure_rate)] if failed else []
        error = format_estimate(group.error_cm)
        rows.append((*values, controller, *failures, error, format_numbers(group.runs)))
    return ["## Points", "", *_table(heads, rows)]


def _worst(report: SweepReport) -> list[str]:
    lines = [
        "## The worst run of each controller",
        "",
        "The command below a run repeats it and writes its log.",
        "",
    ]
    for row, *_ in report.worst:
        error = row[ERROR]
        size = f", {centimetres(error)} cm" if isinstance(error, float) else ""
        why = f": {row['failure']}" if row["failure"] else ""
        lines += [
            f"- `{row['controller']}`, run {row['run']}, {row['status']}{why}{size}",
            "",
            f"      {rerun_command(report.runs.study, row)}",
            "",
        ]
    return lines


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    return [line(heads), "|---" * len(heads) + "|", *map(line, rows), ""]
