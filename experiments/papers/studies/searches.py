"""Severities at which controllers fail, along rays that all of them share."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ....testbed.recording.provenance import code_digest
from ...results.statistics import mean, proportion
from ...scenario.scenario import merge_tables, parse_overrides, read_scenario
from ...seeds import report_seeds
from ...studies.search.quantities import read_subject
from ...studies.search.rays import RAYS, Report, search_rays
from ...studies.sweep.engine import Engine
from ...studies.trials.score_card import MARGIN
from ..markdown import markdown
from ..runner import Runner
from ..table import Table


@dataclass(frozen=True)
class Hunt:
    """A search along rays with a controller on `grass`."""

    controller: str
    words: tuple[str, ...]  # quantities, as the command `search` takes them
    limit_m: float | None  # of the trailer's 95 % cross-track error
    seed: int
    rays: int = RAYS


HEADLAND: Final = "path={kind='headland', length_m=8.0, passes=2, width_m=12.0}"
_RIVALS: Final = ("ttempc", "nmpc-rti", "lqr", "pid")
_TWO: Final = ("ttempc", "pid")
# What is asked, the limit, and of which controllers. What is known to measure the plant alone is
# asked of two, along half of the rays: enough to see when that changes.
HUNTED: Final[dict[str, tuple[tuple[str, ...], float | None, tuple[str, ...]]]] = {
    "Gust on the trailer": (("gust",), None, _TWO),
    "Soft patch on a slope": (
        ("soil_patch", "slope", "terrain.uphill_deg=0:360:free"),
        None,
        _TWO,
    ),
    "Late commands": (("commands_late",), 0.3, _RIVALS),
}
_SEVERITIES: Final = (0.25, 0.5, 0.75, 1.0)


def hunt(task: Hunt, workers: Engine, folder: Path, path: str = HEADLAND) -> Report:
    """Return the report of a search; its rows are kept in a folder."""
    settings = parse_overrides([path])
    merge_tables(settings, {"controller": {"name": task.controller}})
    subject = read_subject(read_scenario("grass"), "grass", settings, task.words)
    return search_rays(subject, workers, task.seed, task.rays, task.limit_m, folder)


def rays(runner: Runner) -> str:
    """Return the severities of failure by question."""
    (seed,) = report_seeds(1)
    kept = runner.folder / code_digest()
    parts = []
    with runner.engine() as workers:
        for title, (words, limit, names) in HUNTED.items():
            count = RAYS // 2 if names is _TWO else RAYS
            tasks = (Hunt(name, words, limit, seed, count) for name in names)
            reports = [
                hunt(task, workers, kept / f"rays-{task.words[0]}-{task.controller}")
                for task in tasks
            ]
            option = f" --limit {limit:g}" if limit else ""
            parts.append(f"**{title}**: `{' '.join(words)}{option}`")
            parts += ray_tables(reports)
    return "\n\n".join(parts)


def ray_tables(reports: Sequence[Report]) -> list[str]:
    """Return the table of shares of rays survived, and the table of the least severe failures."""
    found = np.array(
        [
            [1.0 if ray.fails is None else 0.5 * (ray.holds + ray.fails) for ray in own.rays]
            for own in reports
        ]
    )
    lines = []
    least = []
    for report, own in zip(reports, found, strict=True):
        held = [proportion(report.survived(x), len(own)) for x in _SEVERITIES]
        gap = mean(own - found[0])
        lines.append(
            (
                f"`{report.controller}`",
                *(f"{100 * p.value:.0f} ({100 * p.low:.0f}-{100 * p.high:.0f})" for p in held),
                f"{own.mean():.3f}",
                "{:+.3f} ({:+.3f} to {:+.3f})".format(gap.value, *gap.ends),
            )
        )
        if report.least is not None:
            ray = report.rays[report.least]
            values = (f"{v:.3g}" if isinstance(v, float) else v for v in report.values.values())
            least.append((f"`{report.controller}`", f"{ray.fails:.3f}", *values, ray.failure))
    keys = [f"`{key.rpartition('.')[2]}`" for key in reports[0].values]
    heads = (f"holds at {x:g} [%]" for x in _SEVERITIES)
    first = f"less that of `{reports[0].controller}`"
    tables = [markdown(("controller", *heads, "mean severity", first), lines)]
    spread = np.ptp(found.mean(axis=1)) / found.mean()
    if spread <= MARGIN:
        tables.append(
            f"All controllers fail within {100 * spread:.1f} % of each other: a limit of plant and "
            "detectors, not of the controller."
        )
    if least:
        tables.append(markdown(("least severe failure", "severity", *keys, "end"), least))
    return tables


TABLES: Final = (
    Table(
        name="worst-cases",
        seeds=report_seeds(1),
        make=rays,
        checks=tuple(("grass", name) for name in _RIVALS),
    ),
)
