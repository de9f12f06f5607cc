"""Containment of the plant in the tube: fitted on some seeds, counted on others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ttempc.errors import InvalidTube
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import ReferenceTube, TubeDesign, report_rows
from ttempc.tube.sets import linear_map, minkowski_sum, outline

from ....testbed.recording.channels import TUBE
from ....testbed.recording.record import Record
from ...errors import InvalidFit
from ...figures import png
from ...figures.style import (
    BLUE,
    BODY_COLOURS,
    GREY,
    PALE,
    RED,
    blank,
    dress,
    legend,
)
from ...results.statistics import proportion
from ...results.tracking_errors import QUANTITIES, START_UP_S, Containment, containment
from ...run.simulate import simulate
from ...scenario.scenario import Scenario, load
from ...scenario.tube_file import TubeFile, read_tube, to_json
from ...seeds import FITTING, report_seeds
from ...tubes.calibration import calibrate_tube, driven_run
from ...tubes.fit import fit_run, fit_tube
from ..runner import Runner
from ..study import Block, Case, Row, Study
from ..tables import Cell, grouped, label

DRIVER: Final = "ttempc-tube"
LAPS: Final = 12  # fresh ones, of each field
FIT_SEEDS: Final = FITTING[:12]
CALIBRATION_SEEDS: Final = FITTING[12:36]
COVERAGE: Final = 0.95  # of the calibration
BORROWED: Final = "grass-soil"  # whose tube the fields without one of their own drive in


@dataclass(frozen=True, slots=True)
class Field:
    """A scenario with its changes, and whether a tube is fitted and calibrated to it."""

    scenario: str
    changes: tuple[str, ...] = ()
    own_tube: bool = False

    @property
    def overrides(self) -> tuple[str, ...]:
        """Changes of the scenario of a lap, but for the tube."""
        return ("path.laps=1", *self.changes, f'controller.name="{DRIVER}"')


FIELDS: Final = {
    "grass-soil": Field("grass", own_tube=True),
    "grass-contact": Field("grass", ('plant.wheels="contact"',), own_tube=True),
    "pavement-soil": Field("pavement", own_tube=True),
    "wet-grass-soil": Field("wet-grass", own_tube=True),
    "side-slope-soil": Field("side-slope", own_tube=True),
    "grass-contact-borrowed": Field("grass", ('plant.wheels="contact"',)),
    "grass-400kpa": Field("grass", ("soil.cone_index_kpa=400.0",)),
    "grass-300kpa": Field("grass", ("soil.cone_index_kpa=300.0",)),
    "grass-200kpa": Field("grass", ("soil.cone_index_kpa=200.0",)),
    "grass-class-E": Field("grass", ('terrain.iso_class="E"',)),
    "grass-class-F": Field("grass", ('terrain.iso_class="F"',)),
    "grass-load-400kg": Field("grass", ("plant.vehicle.load_kg=400.0",)),
    "grass-0.7mps": Field("grass", ("path.speed_mps=0.7",)),
    "grass-1.2mps": Field("grass", ("path.speed_mps=1.2",)),
    "wet-grass-borrowed": Field("wet-grass"),
    "side-slope-borrowed": Field("side-slope"),
}
"""Fields with a tube of their own, then soil, load and speed that the tube of `grass-soil` was not
fitted to."""


def _lap(case: Case, seed: int, *more: str) -> tuple[Record, Scenario]:
    name, scenario = load(case.scenario, (*case.overrides, *more))
    about = {"scenario": name, "controller": DRIVER, "seed": str(seed)}
    return replace(simulate(name, scenario, seed)[1], metadata=about), scenario


def fitted(case: Case) -> Row:
    """Fit a tube to laps of a field, calibrate it on more laps in it, and return its file's text.

    `refused` says why there is no tube, "" if there is one.
    """
    file = case["folder"] / f"{case['field']}.json"
    try:
        tube = fit_tube([fit_run(*_lap(case, seed)) for seed in case["fit"]]).file
        file.write_text(to_json(tube), encoding="utf-8")
        in_it = f'controller.tube="{file}"'
        laps = [driven_run(*_lap(case, seed, in_it)) for seed in case["calibrate"]]
        tube = calibrate_tube(laps, COVERAGE) if laps else tube
    except (InvalidFit, InvalidTube) as error:
        return {"tube": "", "refused": str(error)}
    return {"tube": to_json(tube), "refused": ""}


def fresh_lap(case: Case) -> Row:
    """Drive a lap in a tube and return its counts, and its deviations on the field of the tube."""
    name, scenario = load(case.scenario, case.overrides)
    try:
        summary, record = simulate(name, scenario, case.seed)
    except InvalidTube as error:  # the tube of another field, along another reference
        return {"refused": str(error)}
    found = containment(record)
    inside, membership = found.margin >= 0.0, record[TUBE]["inside"]
    row: dict[str, Any] = {
        "refused": "",
        "status": summary.status,
        "restarts": int((membership[record[TUBE].time_s >= START_UP_S] < 0.5).sum()),
        "largest_m": np.abs(found.deviation[:, found.POINTS]).max(axis=0, initial=0.0),
        "share": found.normalised_deviation.max(axis=0, initial=0.0)[
            [*found.ACROSS.values()]
        ].max(),
    }
    for where, ticks in (("straight", ~found.curved), ("curve", found.curved)):
        row |= {f"{where}_steps": int(ticks.sum()), f"{where}_inside": int(inside[ticks].sum())}
    if case["field"] == BORROWED:
        row |= {"time_s": found.time_s, "deviation": found.deviation, "width": found.half_width}
    return row


def study(
    runner: Runner,
    fit: Sequence[int] = FIT_SEEDS,
    calibrate: Sequence[int] = CALIBRATION_SEEDS,
) -> Block:
    """Fit and calibrate the tubes, drive the fresh laps; return their table and figures."""
    folder = runner.kept().resolve()
    common = {"folder": folder, "fit": tuple(fit), "calibrate": tuple(calibrate)}
    cases = [
        Case(field.scenario, 0, field.overrides, {"field": name, **common})
        for name, field in FIELDS.items()
        if field.own_tube
    ]
    made = runner.frame(cases, fitted)
    tubes = {name: tube for name, tube in zip(made["field"], made["tube"], strict=True) if tube}
    for name, text in tubes.items():
        (folder / f"{name}.json").write_text(text, encoding="utf-8")
    driven_in = {name: name if field.own_tube else BORROWED for name, field in FIELDS.items()}
    fresh = [
        Case(
            FIELDS[name].scenario,
            seed,
            (*FIELDS[name].overrides, f'controller.tube="{folder / tube}.json"'),
            {"field": name},
        )
        for name, tube in driven_in.items()
        if tube in tubes
        for seed in runner.report_seeds(LAPS)
    ]
    laps = runner.frame(fresh, fresh_lap)
    files = {name: read_tube(str(folder / f"{name}.json")) for name in tubes}
    both = pd.concat([made, laps])
    refused = {name: why for name, why in zip(both["field"], both["refused"], strict=True) if why}
    laps = laps.loc[laps["refused"] == ""]
    text = lap_table(laps, {name: files.get(tube) for name, tube in driven_in.items()})
    reasons = [f"`{name}`: {reason}" for name, reason in refused.items()]
    pictures = figures(laps, files[BORROWED].design()) if BORROWED in files else {}
    return Block(
        "\n\n".join([text, *reasons]), {f"../tube/{n}.png": p for n, p in pictures.items()}
    )


def lap_table(laps: pd.DataFrame, tubes: dict[str, TubeFile | None]) -> str:
    """Return the table of the fields: steps and laps inside the tube and the calibrated widths.

    Args:
        laps: fresh laps, as of `fresh_lap`.
        tubes: that the laps of each field were driven in.
    """

    def inside(*where: str) -> Cell:
        def cell(own: pd.DataFrame) -> str:
            counts = [own[[f"{name}_{what}" for name in where]] for what in ("inside", "steps")]
            points, steps = (count.to_numpy().sum() for count in counts)
            return f"{points / steps:.4f}"

        return cell

    def completed(own: pd.DataFrame, kept: Any) -> str:  # noqa: ANN401 - booleans by lap
        return str(proportion(int((kept & (own["status"] == "completed")).sum()), len(own)))

    def whole(own: pd.DataFrame) -> str:
        parts = ("straight", "curve")
        kept = [own[f"{name}_inside"] == own[f"{name}_steps"] for name in parts]
        return completed(own, kept[0] & kept[1])

    def calibrated(own: pd.DataFrame) -> list[str]:
        name = own["field"].iloc[0]
        calibration = (tube := tubes[name]) and tube.calibration
        if calibration is None:
            return ["–"] * 3
        widths = calibration.half_widths
        kept = np.all(np.array([*own["largest_m"]]) <= astuple(widths), axis=1)
        return [
            f"{100.0 * widths.tractor_across_m:.1f} / {100.0 * widths.trailer_across_m:.1f}",
            f"{calibration.guaranteed:.4f}" if FIELDS[name].own_tube else "–",
            completed(own, kept),
        ]

    cells = {
        "case": label("field", "`{}`"),
        "laps": lambda own: f"{len(own)}",
        "lost": lambda own: f"{(own['status'] != 'completed').sum()}",
        "steps with both points inside": inside("straight", "curve"),
        "straight": inside("straight"),
        "curve": inside("curve"),
        "laps wholly inside": whole,
        "restarts a lap": lambda own: f"{own['restarts'].mean():.2f}",
        "largest share of a cross-track half width": lambda own: f"{own['share'].max():.2f}",
        "calibrated across, tractor / trailer [cm]": lambda own: calibrated(own)[0],
        "promised": lambda own: calibrated(own)[1],
        "laps inside the calibrated widths": lambda own: calibrated(own)[2],
    }
    return grouped(laps, ["field"], cells)


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


def figures(laps: pd.DataFrame, design: TubeDesign) -> dict[str, bytes]:
    """Return path, tracks and sections of the laps in their own tube."""
    reference = Reference(figure_eight(laps=1), design.vehicle, ConstantSpeed(1.0))
    own = laps.loc[laps["field"] == BORROWED]
    tracks = [*zip(own["time_s"], own["deviation"], own["width"], strict=True)]
    drawn = {
        "path": _path(reference, tracks),
        "tracks": _tracks(tracks),
        "sections": _sections(design, reference, tracks),
    }
    return {name: png(figure) for name, figure in drawn.items()}


def _path(reference: Reference, tracks: Sequence[tuple[np.ndarray, ...]]) -> Figure:
    """Draw the tube around the path and the laps in it, about a nominal vehicle on the path."""
    figure = blank(3.6)
    views = figure.subplot_mosaic(
        [["whole", "tractor"], ["whole", "trailer"]], width_ratios=(1.5, 1.0)
    )
    time_s, _, widths = tracks[0]
    at = reference.at(time_s)
    middle = _in_the_curve(np.abs(at.curvature))
    places = {"tractor": (at.state[:, :2], 2), "trailer": (at.trailer_xy, 3)}  # yaw's state
    for body, (place, yaw) in places.items():
        near, colour, column = views[body], BODY_COLOURS[body], Containment.ACROSS[body]
        heading = at.state[:, yaw]
        left = np.column_stack([-np.sin(heading), np.cos(heading)])
        width = widths[:, column, None] * left
        band = np.concatenate([place + width, (place - width)[::-1]])
        for axes in (views["whole"], near):
            axes.fill(*band.T, color=PALE, alpha=0.6, linewidth=0.0)
        for number, (times, deviation, _) in enumerate(tracks):
            ticks = slice(len(times))  # fewer in a lap that terminated early
            driven = place[ticks] + (-deviation[:, column, None]) * left[ticks]
            near.plot(*driven.T, color=colour, linewidth=0.5)
            shown = body if number == 0 else None
            views["whole"].plot(*driven.T, color=colour, linewidth=0.5, label=shown)
        (x, y), reach = place[middle], np.array([-_NEAR_M, _NEAR_M])
        near.set(xlim=x + reach, ylim=y + 0.5 * reach)
    for name, axes in views.items():
        axes.set_aspect("equal")
        dress(axes, "" if name == "tractor" else "x [m]", "y [m]")
    legend(views["whole"], 2)
    return figure


def _in_the_curve(curvature: np.ndarray) -> int:
    """Return the index of a sample well inside the first curve."""
    return int(np.argmax(curvature > 0.999 * curvature.max())) + _INTO_THE_CURVE


def _tracks(tracks: Sequence[tuple[np.ndarray, ...]]) -> Figure:
    figure = blank(4.2)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (body, column) in zip(panels, Containment.ACROSS.items(), strict=True):
        time_s, _, width = tracks[0]
        ends = -width[:, column], width[:, column]
        axes.fill_between(time_s, *ends, color=PALE, alpha=0.6, label="tube")
        for number, (times, deviation, _) in enumerate(tracks):
            shown = None if number else f"{len(tracks)} fresh laps"
            across = -deviation[:, column]  # to the left: errors are z_r - z
            axes.plot(times, across, color=BODY_COLOURS[body], linewidth=0.5, label=shown)
        dress(axes, "time [s]" if body == "trailer" else "", f"{body}, to the left [m]")
        legend(axes, 2)
    return figure


def _sections(
    design: TubeDesign, reference: Reference, tracks: Sequence[tuple[np.ndarray, ...]]
) -> Figure:
    """Draw exact projections of the tube, with and without the estimate's error, at two ticks."""
    figure = blank(2.8)
    along = ReferenceTube.along(design, reference, _TICKS).tube
    curvature = np.abs(reference.at(_PERIOD_S * np.arange(_TICKS)).curvature)
    sections = {"straight": int(np.argmin(curvature)), "curve": _in_the_curve(curvature)}
    rows = report_rows(along.system.c)
    for axes, names in zip(figure.subplots(1, 3), _PLANES, strict=True):
        columns = [QUANTITIES.index(name) for name in names]
        points = np.concatenate([deviation[:, columns] for _, deviation, _ in tracks])
        axes.plot(*points.T, ",", color=GREY)
        for (where, k), colour in zip(sections.items(), (BLUE, RED), strict=True):
            plane = rows[k][columns]
            of_estimate = linear_map(plane, along.at(k))
            truth = minkowski_sum([of_estimate, linear_map(plane, design.estimate_error)])
            for section, line in ((of_estimate, "--"), (truth, "-")):
                corners = outline(section, np.eye(2))
                closed = np.vstack([corners, corners[:1]])
                shown = where if line == "-" else None
                axes.plot(*closed.T, line, color=colour, linewidth=1.0, label=shown)
        dress(axes, _LABELS[names[0]], _LABELS[names[1]])
    legend(figure.axes[0], 2)
    return figure


STUDY: Final = Study(
    name="containment",
    seeds=report_seeds(LAPS),
    make=study,
    checks=tuple((name, DRIVER) for name in ("grass", "pavement", "wet-grass", "side-slope")),
    minutes=13.0,
)
STUDIES: Final = (STUDY,)
