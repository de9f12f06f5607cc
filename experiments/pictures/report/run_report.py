"""Report of a run as one self-contained HTML page."""

import contextlib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Final

from ....testbed.recording.record import Record
from ...results.mismatch import mismatch_rows
from ...results.summary import Summary
from ...results.table import COLUMNS, format_corridor, format_line
from ...results.tracking_errors import START_UP_S
from ..figures import CAPTIONS
from .html import Picture, environment

_COLUMNS: Final = COLUMNS | {"distance mean": "mean_euclidean_m", "distance max": "max_m"}
_EVENTS_SHOWN: Final = 100  # an intermittent fault would fill the page; the log has all
_SPREAD: Final = "median {0}.median:.0f}} µs, p99 {0}.p99:.0f}} µs, max {0}.max:.0f}} µs"
_INPUT: Final = (
    "at a limit {0}.saturated_fraction:.1%}} of the ticks, rms rate {0}.rms_rate:.3f}} {1}/s, "
    "travel {0}.travel_per_m:.3f}} {1}/m"
)
_FACTS: Final = {
    "real-time factor": "{s.timing.real_time_factor:.1f}",
    "control step": _SPREAD.format("{s.timing.control_step_us"),
    "QP solve": _SPREAD.format("{s.timing.qp_solve_us"),
    "QP answers": "{s.solver.needed_solver} of {s.solver.ticks} ticks needed the solver, "
    "{s.solver.soft} with soft bounds; {s.solver.rejected} without a solution",
    "estimator": _SPREAD.format("{s.timing.estimator_us"),
    "physics step": _SPREAD.format("{s.timing.plant_step_us"),
    "estimation error": "tractor {s.estimation.tractor.mean_euclidean_m:.3f} m, "
    "trailer {s.estimation.trailer.mean_euclidean_m:.3f} m (mean)",
    "front steering": _INPUT.format("{s.inputs.delta_t", "rad"),
    "trailer steering": _INPUT.format("{s.inputs.delta_i", "rad"),
    "hydrostat": _INPUT.format("{s.inputs.hp", "1"),
    "slip": "rear wheels {s.slip.rear_mean:.1%} (mean), {s.slip.rear_p95:.1%} (p95); "
    "trailer slip angle {s.slip.trailer_slip_angle_p95_rad:.3f} rad (p95)",
    "implement": "draft {s.implement.draft_mean_n:.0f} N (mean), {s.implement.draft_p95_n:.0f} N "
    "(p95); side force {s.implement.side_p95_n:.0f} N (p95); depth "
    "{s.implement.depth_mean_m:.3f} m (mean)",
}
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
        columns=list(_COLUMNS),
        errors=_errors(summary),
        facts=_facts(summary),
        mismatch=mismatch_rows(record.metadata.get("mismatch", ""), summary.learnt),
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
        (f"{point}, {where}", tuple(getattr(error, key) for key in _COLUMNS.values()))
        for where in ("all", "straight", "curve")
        for point, error in getattr(summary.tracking, where).by_point.items()
    ]


def _facts(summary: Summary) -> list[tuple[str, str]]:
    """Return names and texts of what the run has; a fact without its numbers is left out."""
    facts = [("run", summary.run_id)]
    facts += [("versions", ", ".join(f"{name} {text}" for name, text in summary.versions.items()))]
    for name, form in _FACTS.items():
        with contextlib.suppress(AttributeError, TypeError):  # the summary has no such numbers
            facts.append((name, form.format(s=summary)))
    if summary.line:
        facts.append(("line as given", format_line(summary.line)))
    return facts + ([("corridor", format_corridor(summary.corridor))] if summary.corridor else [])
