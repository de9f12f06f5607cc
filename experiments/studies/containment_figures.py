"""Figures of the containment study: tracks in the tube, cross-sections, containment over slip."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.ticker import PercentFormatter

from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference, ReferenceSample
from ttempc.tube.reference_tube import ReferenceTube, TubeDesign, report_rows
from ttempc.tube.sets import linear_map, minkowski_sum, outline
from ttempc.types import State

from ..figures.style import (
    BLACK,
    BLUE,
    BODY_COLOURS,
    GREY,
    ORANGE,
    PALE,
    RED,
    blank,
    dress,
    legend,
)
from ..results.containment import QUANTITIES, Containment, leftward

_PLANES: Final = (("y_t_e_m", "psi_t_e_rad"), ("y_t_e_m", "y_i_e_m"), ("y_i_e_m", "psi_i_e_rad"))
_LABELS: Final = {
    "y_t_e_m": "tractor across [m]",
    "y_i_e_m": "trailer across [m]",
    "psi_t_e_rad": "tractor yaw [rad]",
    "psi_i_e_rad": "trailer yaw [rad]",
}
_PERIOD_S: Final = 0.2
_TICKS: Final = 690
_NEAR_M: Final = 0.9  # half width of the close views
_INTO_THE_CURVE: Final = 40  # ticks from its start to the cross-sections and the close views


def draw_containment(
    folder: Path, design: TubeDesign, laps: Sequence[dict[str, Any]], key: str
) -> None:
    """Write path.png, tracks.png and sections.png of the case `key`, and slip.png of all cases."""
    reference = Reference(figure_eight(laps=1), design.vehicle, ConstantSpeed(1.0))
    along = ReferenceTube.along(design, reference, _TICKS)
    tracks = [np.load(file) for file in sorted((folder / "tracks").glob(f"{key}-2*.npz"))]
    _path(folder / "path.png", reference, tracks)
    _tracks(folder / "tracks.png", tracks)
    _sections(folder / "sections.png", design, reference, along, tracks)
    _slip(folder / "slip.png", laps)


def _path(file: Path, reference: Reference, tracks: Sequence[Any]) -> None:
    """Draw the tube around the path and the laps in it, about a nominal vehicle on the path."""
    figure = blank(3.6)
    views = figure.subplot_mosaic(
        [["whole", "tractor"], ["whole", "trailer"]], width_ratios=(1.5, 1.0)
    )
    time_s = tracks[0]["time_s"]
    on_path = reference.at(time_s)
    middle = _in_the_curve(on_path)
    bodies = {
        "tractor": (on_path.state[:, :2], on_path.state[:, State.PSI_T]),
        "trailer": (on_path.trailer_xy, on_path.state[:, State.PSI_I]),
    }
    for body, (place, heading) in bodies.items():
        near, colour, column = views[body], BODY_COLOURS[body], Containment.ACROSS[body]
        left = np.column_stack([-np.sin(heading), np.cos(heading)])
        width = tracks[0]["half_width"][:, column, None] * left
        band = np.concatenate([place + width, (place - width)[::-1]])
        for axes in (views["whole"], near):
            axes.fill(*band.T, color=PALE, alpha=0.6, linewidth=0.0)
        for number, track in enumerate(tracks):
            ticks = slice(len(track["time_s"]))  # fewer in a lap that terminated early
            driven = place[ticks] + leftward(track["deviation"][:, column, None]) * left[ticks]
            near.plot(*driven.T, color=colour, linewidth=0.5)
            label = body if number == 0 else None
            views["whole"].plot(*driven.T, color=colour, linewidth=0.5, label=label)
        (x, y), reach = place[middle], np.array([-_NEAR_M, _NEAR_M])
        near.set(xlim=x + reach, ylim=y + 0.5 * reach)
    for name, axes in views.items():
        axes.set_aspect("equal")
        dress(axes, "" if name == "tractor" else "x [m]", "y [m]")
    legend(views["whole"], 2)
    figure.savefig(file)


def _in_the_curve(samples: ReferenceSample) -> int:
    """Return the index of a sample well inside the first curve."""
    curvature = np.abs(samples.curvature)
    return int(np.argmax(curvature > 0.999 * curvature.max())) + _INTO_THE_CURVE


def _tracks(file: Path, tracks: Sequence[Any]) -> None:
    figure = blank(4.2)
    for axes, (body, column) in zip(
        figure.subplots(2, 1, sharex=True), Containment.ACROSS.items(), strict=True
    ):
        width = tracks[0]["half_width"][:, column]
        time_s = tracks[0]["time_s"]
        axes.fill_between(time_s, -width, width, color=PALE, alpha=0.6, label="tube")
        for place, track in enumerate(tracks):
            label = f"{len(tracks)} fresh laps" if place == 0 else None
            axes.plot(
                track["time_s"],
                leftward(track["deviation"][:, column]),
                color=BODY_COLOURS[body],
                linewidth=0.5,
                label=label,
            )
        dress(axes, "time [s]" if body == "trailer" else "", f"{body}, to the left [m]")
        legend(axes, 2)
    figure.savefig(file)


def _sections(
    file: Path,
    design: TubeDesign,
    reference: Reference,
    along: ReferenceTube,
    tracks: Sequence[Any],
) -> None:
    """Draw exact projections of the tube, with and without the estimate's error, at two ticks."""
    figure = blank(2.8)
    curvature = np.abs(reference.at(_PERIOD_S * np.arange(_TICKS)).curvature)
    sections = {
        "straight": int(np.argmin(curvature)),
        "curve": int(np.argmax(curvature > 0.0999)) + _INTO_THE_CURVE,
    }
    rows = report_rows(along.tube.system.c)
    for axes, names in zip(figure.subplots(1, 3), _PLANES, strict=True):
        columns = [QUANTITIES.index(name) for name in names]
        points = np.concatenate([track["deviation"][:, columns] for track in tracks])
        axes.plot(*points.T, ",", color=GREY)
        for (where, k), colour in zip(sections.items(), (BLUE, RED), strict=True):
            plane = rows[k][columns]
            of_estimate = linear_map(plane, along.tube.at(k))
            truth = minkowski_sum([of_estimate, linear_map(plane, design.estimate_error)])
            for section, line in ((of_estimate, "--"), (truth, "-")):
                corners = outline(section, np.eye(2))
                closed = np.vstack([corners, corners[:1]])
                label = where if line == "-" else None
                axes.plot(*closed.T, line, color=colour, linewidth=1.0, label=label)
        dress(axes, _LABELS[names[0]], _LABELS[names[1]])
    legend(figure.axes[0], 2)
    figure.savefig(file)


def _slip(file: Path, laps: Sequence[dict[str, Any]]) -> None:
    """Draw the largest share of a cross-track half width over the mean slip, tube of grass only."""
    figure = blank(3.0)
    axes = figure.subplots()
    columns = list(Containment.ACROSS.values())
    own = [lap for lap in laps if lap["case"] == "grass-soil"]
    others = [lap for lap in laps if lap["case"].startswith("grass-") or "borrowed" in lap["case"]]
    others = [lap for lap in others if lap["case"] not in ("grass-soil", "grass-contact")]
    for some, colour, label in ((others, ORANGE, "other ground"), (own, BLUE, "as fitted")):
        slip = [lap["slip_mean"] for lap in some]
        used = [max(lap["largest_share"][column] for column in columns) for lap in some]
        axes.plot(slip, used, "o", color=colour, markersize=3, label=label)
    axes.axhline(1.0, color=BLACK, linewidth=0.8)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.yaxis.set_minor_formatter(PercentFormatter(1.0, decimals=0))
    axes.tick_params(which="minor", labelsize=8.0)
    dress(axes, "mean slip of the driven wheels in a lap", "share of half width, largest")
    legend(axes, 2)
    figure.savefig(file)
