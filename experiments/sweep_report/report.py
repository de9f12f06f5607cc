"""All that a report of a sweep tells, worked out once for page, summary and pictures."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..errors import BadOptions
from ..figures.panel import Panel
from ..sweep.row import Row
from .aggregate import Cell, Difference, Group, Tail, cells, differences, tail, whole
from .axes import Scale, scales
from .curves import cost_panel, curve_panels, difference_panel, holds_panel, tail_panel
from .envelope_figure import breaking_panel
from .envelope_results import Breaking
from .heat import boundary_panel, error_maps, failure_maps
from .runs import Runs

_MOST_MAPS: Final = 3  # pairs of axes
_WORST: Final = 4  # runs that are listed of each controller


@dataclass(frozen=True, slots=True)
class Section:
    """Charts that belong together."""

    name: str  # of its picture's file
    title: str
    caption: str
    panels: tuple[Panel, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """What a report tells."""

    runs: Runs
    against: int  # the controller that the others are compared with
    groups: tuple[Group, ...]  # a controller each
    tails: tuple[Tail, ...]
    differences: tuple[Difference, ...]
    scales: tuple[Scale, ...]  # that the cells are grouped by
    cells: tuple[Cell, ...]  # none where there is no such scale
    sections: tuple[Section, ...]
    worst: tuple[tuple[Row, ...], ...]  # of each controller
    breaking: tuple[Breaking, ...]  # what was found apart from the sweep


def report(runs: Runs, against: str | None = None, breaking: Sequence[Breaking] = ()) -> Report:
    """Work out a report.

    Args:
        runs: of a sweep.
        against: the controller that the others are compared with; the first of the study if None.
        breaking: breaking points that belong to it.

    Raises:
        BadOptions: the study has no such controller.
    """
    controllers = runs.controllers
    if against is not None and against not in controllers:
        raise BadOptions(f"--against {against}: the study has {', '.join(controllers)}")
    reference = 0 if against is None else controllers.index(against)
    found = scales(runs)
    grid = tuple(scale for scale in found if not scale.binned)
    groups = tuple(whole(runs))
    tails = tuple(tail(runs, number) for number in range(len(controllers)))
    over = [(scale, cells(runs, [scale])) for scale in found if len(scale.texts) > 1]
    paired = tuple(differences(runs, reference))
    return Report(
        runs,
        reference,
        groups,
        tails,
        paired,
        grid,
        tuple(cells(runs, grid)) if grid else (),
        (
            *_sections(runs, over, groups, tails, reference, paired),
            *([_breaking(controllers, breaking)] if breaking else ()),
        ),
        tuple(_worst(runs, number) for number in range(len(controllers))),
        tuple(breaking),
    )


def _sections(
    runs: Runs,
    over: Sequence[tuple[Scale, list[Cell]]],
    groups: Sequence[Group],
    tails: Sequence[Tail],
    against: int,
    differences: Sequence[Difference],
) -> list[Section]:
    controllers = runs.controllers
    overview = [tail_panel(runs), cost_panel(controllers, groups, tails)]
    if differences:
        overview.append(difference_panel(controllers, against, differences))
    grid = [(scale, found) for scale, found in over if not scale.binned]
    pairs = list(itertools.combinations([scale for scale, _ in grid], 2))
    maps = []
    for number, pair in enumerate(pairs[:_MOST_MAPS], 1):
        # The longer axis goes to the right, where a page has more room for it.
        up, across = sorted(pair, key=lambda scale: len(scale.texts))
        found = cells(runs, [across, up])
        if number == 1:
            overview.insert(0, boundary_panel(controllers, across, up, found))
        maps.append(
            Section(
                "maps" if number == 1 else f"maps-{number}",
                f"{up.label} against {across.label}",
                "Share of runs that failed, and mean 95 % cross-track error of those that "
                "completed; hatched where none did."
                + (" All other axes are pooled." if len(over) > 2 else ""),
                tuple(
                    itertools.chain.from_iterable(
                        zip(
                            failure_maps(controllers, across, up, found),
                            error_maps(controllers, across, up, found),
                            strict=True,
                        )
                    )
                ),
            )
        )
    if len(grid) == 1:
        overview.insert(0, holds_panel(controllers, *grid[0]))
    sections = [
        Section(
            "overview",
            "Where it ends, how bad it gets, what it costs",
            "Tails: the share of all runs that are worse than an error, failed runs worse than "
            "any; dashed: the worst 5 %. Bars: 95 % intervals."
            + (" What has no run yet counts as holding." if runs.missing else ""),
            tuple(overview),
        ),
        *maps,
    ]
    if over:
        sections.append(
            Section(
                "curves",
                "One axis at a time",
                "Bands: 95 % intervals. Errors are those of the runs that completed: where "
                "many fail, only the lucky ones are left."
                + (" All other axes are pooled." if len(over) > 1 else ""),
                tuple(
                    panel
                    for scale, found in over
                    for panel in curve_panels(controllers, scale, found)
                ),
            )
        )
    return sections


def _breaking(controllers: Sequence[str], breaking: Sequence[Breaking]) -> Section:
    files = ", ".join(dict.fromkeys(name for item in breaking for name in item.files))
    asked = "; ".join(f"{item.label}: {item.asked}" for item in breaking)
    return Section(
        "envelope",
        "Breaking points",
        f"All values that were tried, bars between the last that holds and the first that fails. "
        f"{asked}. From {files}.",
        tuple(breaking_panel(controllers, item) for item in breaking),
    )


def _worst(runs: Runs, controller: int) -> tuple[Row, ...]:
    """Return a controller's worst runs: what did not complete, with a log first, then by error."""
    badness = np.where(np.isnan(runs.error_cm), np.inf, runs.error_cm)
    silent = np.array([not row["log"] for row in runs.rows])
    order = np.lexsort((runs.run, silent, -badness))
    return tuple(runs.rows[place] for place in order[runs.driver[order] == controller][:_WORST])
