"""Content of a sweep report: aggregates and charts, shared by page, summary and pictures."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..errors import BadOptions
from ..figures.panel import Panel
from ..sweep.row import Row
from .aggregate import (
    Cell,
    Group,
    PairedDifference,
    Tail,
    cells,
    controller_groups,
    controller_tail,
    difference_cells,
    paired_differences,
    ranking,
)
from .axes import Scale, scales
from .curves import cost_panel, curve_panels, difference_panel, holds_panel, tail_panel
from .envelope_figure import envelope_panel
from .envelope_results import EnvelopeResults
from .heat import boundary_panel, difference_map, error_maps, failure_maps
from .runs import Runs

_MOST_MAPS: Final = 3  # pairs of axes
_WORST: Final = 4  # runs that are listed of each controller


@dataclass(frozen=True, slots=True)
class Section:
    """A group of charts."""

    name: str  # of the picture's file
    title: str
    caption: str
    panels: tuple[Panel, ...]


@dataclass(frozen=True, slots=True)
class SweepReport:
    """Content of a report."""

    runs: Runs
    against: int  # index of the controller that the others are compared with
    rival: int  # index of the best of the others; the same without others
    groups: tuple[Group, ...]  # one per controller
    tails: tuple[Tail, ...]
    differences: tuple[PairedDifference, ...]
    scales: tuple[Scale, ...]  # that the cells are grouped by
    cells: tuple[Cell, ...]  # empty without such a scale
    sections: tuple[Section, ...]
    worst: tuple[tuple[Row, ...], ...]  # worst runs of each controller
    envelopes: tuple[EnvelopeResults, ...]  # results of `ttempc search limit`


def make_report(
    runs: Runs, against: str | None = None, envelopes: Sequence[EnvelopeResults] = ()
) -> SweepReport:
    """Compute the content of a report.

    Args:
        runs: of a sweep.
        against: the controller that the others are compared with; if None the best rival, that
            is the second of `ranking`.
        envelopes: results of `ttempc search limit` to include.

    Raises:
        BadOptions: the study has no such controller.
    """
    controllers = runs.controllers
    if against is not None and against not in controllers:
        raise BadOptions(f"--against {against}: the study has {', '.join(controllers)}")
    ranked = ranking(runs)
    reference = ranked[min(1, len(ranked) - 1)] if against is None else controllers.index(against)
    rival = next((number for number in ranked if number != reference), reference)
    axes = scales(runs)
    grid = tuple(scale for scale in axes if not scale.binned)
    groups = tuple(controller_groups(runs))
    tails = tuple(controller_tail(runs, number) for number in range(len(controllers)))
    over = [(scale, cells(runs, [scale])) for scale in axes if len(scale.texts) > 1]
    differences = tuple(paired_differences(runs, reference))
    return SweepReport(
        runs,
        reference,
        rival,
        groups,
        tails,
        differences,
        grid,
        tuple(cells(runs, grid)) if grid else (),
        (
            *_sections(runs, over, groups, tails, (rival, reference), differences),
            *([_envelope_section(controllers, envelopes)] if envelopes else ()),
        ),
        tuple(_worst(runs, number) for number in range(len(controllers))),
        tuple(envelopes),
    )


def _sections(
    runs: Runs,
    over: Sequence[tuple[Scale, list[Cell]]],
    groups: Sequence[Group],
    tails: Sequence[Tail],
    two: tuple[int, int],
    differences: Sequence[PairedDifference],
) -> list[Section]:
    """Return the groups of charts; of `two` controllers, maps show the difference."""
    controllers = runs.controllers
    names = controllers[two[0]], controllers[two[1]]
    overview = [tail_panel(runs), cost_panel(controllers, groups, tails)]
    if differences:
        overview.append(difference_panel(controllers, two[1], differences))
    grid = [(scale, grouped) for scale, grouped in over if not scale.binned]
    pairs = list(itertools.combinations([scale for scale, _ in grid], 2))
    maps = []
    for number, pair in enumerate(pairs[:_MOST_MAPS], 1):
        # The axis with more values is horizontal, where a page is wider.
        up, across = sorted(pair, key=lambda scale: len(scale.texts))
        grouped = cells(runs, [across, up])
        if number == 1 and any(cell.group.fails for cell in grouped):
            overview.insert(0, boundary_panel(controllers, across, up, grouped))
        maps_of_two = []
        if differences:
            paired = difference_cells(runs, [across, up], *two)
            maps_of_two.append(difference_map(names, across, up, paired))
        maps.append(
            Section(
                "maps" if number == 1 else f"maps-{number}",
                f"{up.label} against {across.label}",
                "Mean 95 % cross-track error of the runs that completed; hatched where none did."
                + (_difference(names) if differences else "")
                + (" Last, the share of runs that failed." if runs.failed.any() else "")
                + (" All other axes are pooled." if len(over) > 2 else ""),
                (
                    *maps_of_two,
                    *error_maps(controllers, across, up, grouped),
                    *failure_maps(controllers, across, up, grouped),
                ),
            )
        )
    if len(grid) == 1 and any(cell.group.fails for cell in grid[0][1]):
        overview.insert(0, holds_panel(controllers, *grid[0]))
    sections = [
        Section(
            "overview",
            "Failure, tail of the error, and cost",
            "Tails: share of all runs with a larger error; a run that did not complete counts as "
            "larger than any. Dashed: the worst 5 %. Bars: 95 % intervals."
            + (" Points without a run count as holding." if runs.missing or runs.refused else ""),
            tuple(overview),
        ),
        *maps,
    ]
    if over:
        sections.append(
            Section(
                "curves",
                "One axis at a time",
                "Bands: 95 % intervals. Errors are those of completed runs: where many fail, they "
                "are a selection of the best runs."
                + (" All other axes are pooled." if len(over) > 1 else ""),
                tuple(
                    panel
                    for scale, grouped in over
                    for panel in curve_panels(controllers, scale, grouped)
                ),
            )
        )
    return sections


def _difference(names: tuple[str, str]) -> str:
    return (
        f" First, of pairs that completed, the error of {names[0]} less that of {names[1]}: blue "
        f"where {names[0]} is better."
    )


def _envelope_section(controllers: Sequence[str], envelopes: Sequence[EnvelopeResults]) -> Section:
    files = ", ".join(dict.fromkeys(name for item in envelopes for name in item.files))
    settings = "; ".join(f"{item.label}: {item.settings}" for item in envelopes)
    return Section(
        "envelope",
        "Breaking points",
        f"All tested values; a bar spans the last value that holds and the first that fails. "
        f"{settings}. From {files}.",
        tuple(envelope_panel(controllers, item) for item in envelopes),
    )


def _worst(runs: Runs, controller: int) -> tuple[Row, ...]:
    """Return a controller's worst runs: first those not completed, with a log, then by error."""
    without_error = np.where(runs.completed, -np.inf, np.inf)
    severity = np.where(np.isnan(runs.error_cm), without_error, runs.error_cm)
    without_log = np.array([not row["log"] for row in runs.rows])
    order = np.lexsort((runs.run, without_log, -severity))
    return tuple(
        runs.rows[place] for place in order[runs.controller_index[order] == controller][:_WORST]
    )
