"""Worst cases of every controller."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ttempc.guidance.controllers import CONTROLLERS

from ...scenario.scenario import merge_tables, parse_overrides, read_scenario
from ...search.quantities import read_subject
from ...search.worst_case import Report, find_worst_case
from ...seeds import report_seeds
from ...sweep.engine import engine
from ..kayacan import CONTROLLER
from ..runner import Runner
from ..study import Study
from ..tables import markdown


@dataclass(frozen=True)
class Hunt:
    """A search for worst cases of a controller on `grass`."""

    controller: str
    words: tuple[str, ...]  # of `search`
    limit_m: float | None  # of the trailer's 95 % cross-track error
    seed: int
    budget: int = 30  # runs


HEADLAND: Final = "path={kind='headland', length_m=10.0, passes=2, width_m=14.0}"
HUNTED: Final[dict[str, tuple[tuple[str, ...], float | None]]] = {
    "Gust on the trailer": (("gust",), None),
    "Soft patch on a slope": (("soil_patch", "slope", "terrain.uphill_deg=0:360:free"), None),
    "Late commands": (("commands_late",), 0.3),
}


def hunt(task: Hunt, path: str = HEADLAND) -> Report:
    """Return the report of a search in this process."""
    settings = parse_overrides([path])
    merge_tables(settings, {"controller": {"name": task.controller}})
    subject = read_subject(read_scenario("grass"), "grass", settings, task.words)
    with engine(workers=0) as here:
        return find_worst_case(subject, here, task.seed, task.budget, task.limit_m)


SEARCHED: Final = (*CONTROLLERS, CONTROLLER)


def worst_cases(runner: Runner) -> str:
    """Return the worst case of every controller by question."""
    (seed,) = report_seeds(1)
    tasks = [Hunt(name, *what, seed) for what in HUNTED.values() for name in SEARCHED]
    reports = iter(runner.map(hunt, tasks))
    parts = []
    for title, (words, limit) in HUNTED.items():
        option = f" --limit {limit:g}" if limit else ""
        parts.append(f"**{title}**: `{' '.join(words)}{option}`")
        parts.append(worst_table([next(reports) for _ in SEARCHED]))
    return "\n\n".join(parts).replace(CONTROLLER, "kayacan-nmpc")


def worst_table(reports: Sequence[Report]) -> str:
    """Return the worst case of each report with its values."""
    keys = [key.rpartition(".")[2] for key in reports[0].values]
    lines = []
    for report in reports:
        values = [f"{v:.3g}" if isinstance(v, float) else str(v) for v in report.values.values()]
        severity = f"{report.severity:.2f}" if report.failure else "-"
        end = report.failure or f"holds; least robustness {report.robustness:.2f}"
        failed = f"{report.failed} of {report.runs}"
        lines.append([f"`{report.controller}`", failed, severity, *values, end])
    return markdown(
        ["controller", "failed", "severity", *(f"`{key}`" for key in keys), "end"], lines
    )


STUDIES: Final = (
    Study(
        name="worst-cases",
        seeds=report_seeds(1),
        make=worst_cases,
        checks=tuple(("grass", name) for name in SEARCHED),
    ),
)
