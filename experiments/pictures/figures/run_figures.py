"""Figures of a run. Each is a function from a record to a matplotlib figure."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from ttempc.types import FloatArray

from ....testbed.recording.channels import (
    CONTROL,
    CORRIDOR,
    REFERENCE,
    STATE,
    TIMING,
    TOOL,
    TUBE,
    TYRES,
)
from ....testbed.recording.record import LEARNT, Record, Table, fault_spans
from ...results.summary import solver_statistics
from ...results.tracking_errors import (
    BODIES,
    BodyError,
    TrackingErrors,
    containment,
    counted,
    position_fields,
    rows_at_same_time,
    tracking_errors,
)
from .magnified import beside, counted_errors, extent_of, line_of, magnification
from .style import (
    BLACK,
    BLUE,
    BODY_COLOURS,
    GREEN,
    GREY,
    PALE,
    RED,
    SKY,
    blank,
    dress,
    label_below,
    legend,
    mark_faults,
    note,
    shade,
    stacked,
)

_TIME_OF_ERRORS: Final = "time [s] (hatched: not counted; shaded: curves)"
LENGTH: Final = "length of the path [m] (hatched: not counted; shaded: curves)"

_ZOOM_M: Final = 1.0  # half of the width of a close-up
_ZOOM_IN: Final = 3.6  # its height
# Height of the whole path over its width, for lines and squares.
_FLATTEST = 0.3
_TALLEST = 0.8
_TEXT_IN: Final = 1.0  # height of all labels, titles and the legend

INPUTS: Final = (  # field, label, factor from the field's unit to the label's
    ("delta_t_rad", "front steering [deg]", np.degrees(1.0)),
    ("delta_i_rad", "trailer steering [deg]", np.degrees(1.0)),
    ("hp", "hydrostat position [%]", 100.0),
)
_ACTIONS: Final = (  # field, label, colour (the paper's roles: cyan, red, blue, black), line
    ("command", "total, as sent", BLACK, "-"),
    ("feedforward", "feedforward", SKY, (0, (3, 3))),
    ("feedback", "feedback", RED, (0, (6, 2))),
    ("robust", "robust", BLUE, (0, (1.5, 1.5))),
    ("total", "total, before limits", GREY, (0, (3, 2))),
)
# Of equal lines both are seen: gaps of a later one show those below it, in grey print too.
_LINES: Final = {"tractor": "-", "trailer": (0, (5, 2)), "tool": (0, (1.5, 1.5))}
_CUT: Final = 1e-6  # least difference between an action and what is sent of it [rad or 1]
_NEAR: Final = 0.3  # of the range of the signals; bounds farther away would flatten them
_BOUND_LINE: Final[dict[str, Any]] = {"color": BLACK, "linestyle": "--", "linewidth": 0.9}
BOUNDS: Final = Line2D([], [], label="bounds", **_BOUND_LINE)
"""Entry of the legend for what `draw_bounds` draws."""

_AXLES: Final = {"front": GREEN, "rear": BLUE, "trailer": RED}
_SIDES: Final = {"left": "-", "right": (0, (2, 1))}
_WHEELS: Final = (  # field, label, factor from the field's unit to the label's, axles
    ("slip", "slip, driven [%]", 100.0, ("rear",)),
    ("slip_angle_rad", "slip angle [deg]", np.degrees(1.0), ("front", "trailer")),
    ("load_n", "wheel load [kN]", 1e-3, ("front", "rear", "trailer")),
)
_WINDOW_S: Final = 1.0  # bumps vary the load faster than a page can show

_TIMES: Final = (
    ("estimator_us", "estimator"),
    ("control_step_us", "control step"),
    ("qp_solve_us", "QP solve"),
    ("plant_step_us", "plant, one physics step"),
)
_BINS: Final = 40
_FEWEST: Final = 10  # times of a histogram


def driven_path(record: Record) -> FloatArray:
    """Return the true path of the tractor point, (n, 2) [m]."""
    return record[STATE].columns(*position_fields("tractor"))


def path_figure(record: Record) -> Figure:
    """Return the reference, and beside it the errors across it, many times as large.

    Without a reference, as in an imported log, it shows the driven paths.
    """
    figure = blank(1.0)
    width_in = figure.get_figwidth()
    reference = record[REFERENCE].columns(*position_fields("tractor"))
    drawn = reference if np.isfinite(reference).any() else driven_path(record)
    extent = np.nanmax(drawn, axis=0) - np.nanmin(drawn, axis=0)
    shape = float(np.clip(extent[1] / max(extent[0], 1e-9), _FLATTEST, _TALLEST))
    figure.set_figheight(shape * width_in + _TEXT_IN)
    axes = figure.subplots()
    label = "x east [m]"
    if drawn is reference:
        label += f" (errors across the line: {_draw_magnified(axes, record):g} times as large)"
    else:
        _draw_paths(axes, record)
    dress(axes, label, "y north [m]")
    axes.set_aspect("equal", adjustable="datalim")
    legend(axes, 4)
    return figure


def _draw_magnified(axes: Axes, record: Record) -> float:
    """Draw the tractor's reference and, beside it, all errors enlarged; return the factor."""
    points, headings = line_of(record, "tractor")
    errors = counted_errors(tracking_errors(record))
    factor = magnification(extent_of(points), list(errors.values()))
    axes.plot(*points.T, color=PALE, linewidth=2.0, label="reference")
    for body, error in errors.items():
        axes.plot(*beside(points, headings, factor * error).T, **_line(body))
    return factor


def zoom_figure(record: Record) -> Figure:
    """Return the paths where the tractor was farthest from its reference: straight and curve."""
    errors = tracking_errors(record)
    _, state, rows = rows_at_same_time(record, STATE, REFERENCE)
    centres = record[REFERENCE].columns(*position_fields("tractor"))[rows]
    tractor = record[STATE].columns(*position_fields("tractor"))[state]
    parts = {"on a straight": ~errors.curved, "on a curve": errors.curved}
    known = np.isfinite(errors.tractor.euclidean_m) & np.isfinite(centres).all(axis=1)
    shown = {name: part & errors.counted & known for name, part in parts.items()}
    shown = {name: part for name, part in shown.items() if part.any()}
    figure = blank(_ZOOM_IN)
    closeups = np.atleast_1d(figure.subplots(1, max(len(shown), 1)))
    for axes, (name, part) in zip(closeups, shown.items(), strict=False):
        places = np.flatnonzero(part)
        farthest = places[np.argmax(errors.tractor.euclidean_m[places])]
        _draw_paths(axes, record)
        x, y = centres[farthest]
        axes.plot(x, y, "o", color=GREY)
        axes.plot(*tractor[farthest], "o", color=BODY_COLOURS["tractor"])
        axes.set(xlim=(x - _ZOOM_M, x + _ZOOM_M), ylim=(y - _ZOOM_M, y + _ZOOM_M))
        axes.set_aspect("equal", adjustable="box")
        distance_cm = 100.0 * errors.tractor.euclidean_m[farthest]
        title = f"{name}, {errors.time_s[farthest]:.0f} s: {distance_cm:.0f} cm"
        dress(axes, "x east [m]", "y north [m]", title)
    if shown:
        closeups[0].legend(loc="best", fontsize="small")
    return figure


def _draw_paths(axes: Axes, record: Record) -> None:
    """Draw reference and driven paths of all points."""
    reference = record[REFERENCE].columns(*position_fields("tractor"))
    axes.plot(*reference.T, color=PALE, linewidth=3.0, label="reference")
    for body in BODIES:
        driven = record[STATE].columns(*position_fields(body))
        axes.plot(*driven.T, **_line(body))
    tool = record[TOOL]
    if len(tool):
        driven = np.where(tool["lowered"] == 1.0, tool.columns("x_m", "y_m").T, np.nan)
        looks: dict[str, Any] = _line("tool") | {"label": "tool, lowered"}
        axes.plot(*driven, **looks)


def _line(body: str) -> dict[str, Any]:
    style = {"color": BODY_COLOURS[body], "linestyle": _LINES[body], "linewidth": 1.0}
    return style | {"label": body}


def shade_errors(axes: Axes, x: FloatArray, errors: TrackingErrors) -> None:
    """Shade the curves, hatch what statistics leave out."""
    shade(axes, x, errors.curved)
    shade(axes, x, ~errors.counted, hatch="////")


def error_figure(record: Record) -> Figure:
    """Return the Euclidean errors of all points over time, as in the paper, with their means."""
    errors = tracking_errors(record)
    figure, rows = stacked(len(errors.by_point), 2.1, share_y=True)
    for axes, (body, error) in zip(rows, errors.by_point.items(), strict=True):
        shade_errors(axes, errors.time_s, errors)
        mark_faults(axes, fault_spans(record.events), float(errors.time_s[-1]))
        _mark_learnt(axes, record)
        colour = BODY_COLOURS[body]
        axes.plot(errors.time_s, 100 * error.euclidean_m, color=colour, linewidth=1.0)
        dress(axes, "", f"{body} error [cm]")
        _draw_means(axes, errors, error)
        axes.margins(x=0.0)
    rows[0].set_ylim(bottom=0.0)
    rows[0].set_ylim(top=1.22 * rows[0].get_ylim()[1])  # space for the text of the means
    label_below(rows[-1], _TIME_OF_ERRORS)
    return figure


def _mark_learnt(axes: Axes, record: Record) -> None:
    """Mark the times at which a learnt model came to act, the first one with a word."""
    times = [event.time_s for event in record.events if event.text.startswith(LEARNT)]
    for time_s in times:
        axes.axvline(time_s, color=GREY, linewidth=1.0, linestyle=":")
    if times:
        place = axes.get_xaxis_transform()  # time, and height as a share of the axes
        axes.text(times[0], 0.02, " learnt", transform=place, color=GREY, va="bottom")


def _draw_means(axes: Axes, errors: TrackingErrors, error: BodyError) -> None:
    """Draw the mean errors on straights and on curves as lines, with their values as text."""
    parts = []
    for name, shape in {"straights": ~errors.curved, "curves": errors.curved}.items():
        rows = shape & errors.counted & np.isfinite(error.along_m)
        if rows.any():
            mean_cm = 100 * float(np.mean(error.euclidean_m[rows]))
            mean = np.where(rows, mean_cm, np.nan)
            axes.plot(errors.time_s, mean, color=BLACK, linewidth=1.0)
            parts.append(f"{name} {mean_cm:.1f} cm")
    text = f"mean on {', on '.join(parts)}" if parts else "shorter than the start-up"
    note(axes, 0.05, 0.93, text, va="top", color="black" if parts else GREY)


def cross_track_figure(record: Record) -> Figure:
    """Return the errors to the left of the reference over the tractor's arc length of it."""
    errors = tracking_errors(record)
    length_m = path_length(record)
    figure, (axes,) = stacked(1, 2.6)
    shade_errors(axes, length_m, errors)
    for body, error in errors.by_point.items():
        axes.plot(length_m, 100 * error.cross_m, **_line(body))
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    dress(axes, LENGTH, "cross-track error,\nleft positive [cm]")
    legend(axes, 3)
    axes.margins(x=0.0)
    return figure


def path_length(record: Record) -> FloatArray:
    """Return the tractor's arc length of the reference at the rows of the errors [m], (n,)."""
    _, _, rows = rows_at_same_time(record, STATE, REFERENCE)
    places = record[REFERENCE].columns(*position_fields("tractor"))[rows]
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))])


def corridor_figure(record: Record) -> Figure:
    """Return the offsets of all true points to the left of their paths, with the corridor."""
    table = record[CORRIDOR]
    points = [name for name in BODY_COLOURS if np.isfinite(table[f"{name}_m"]).any()]
    figure, rows = stacked(len(points), 1.8, share_y=True)
    hatched = ~counted(record, table.time_s)
    width = table["half_width_m"]
    for axes, name in zip(rows, points, strict=True):
        shade(axes, table.time_s, hatched, hatch="////")
        _draw_offset(axes, table.time_s, table[f"{name}_m"], width, name, "corridor")
        dress(axes, "", "offset from path,\nleft positive [cm]")
    label_below(rows[-1], "time [s] (hatched: not counted)")
    return figure


def tube_figure(record: Record) -> Figure:
    """Return the cross-track deviation of both true axle points, and their margin in the tube."""
    contained = containment(record)
    time_s = contained.time_s
    margin = contained.margin
    width = contained.half_width
    figure, rows = stacked(3, 1.8)
    for axes in rows:
        shade(axes, time_s, contained.curved)
    for axes, (body, column) in zip(rows[:2], contained.ACROSS.items(), strict=True):
        offset = -contained.deviation[:, column]  # positive to the left of the path
        _draw_offset(axes, time_s, offset, width[:, column], body, "tube")
        dress(axes, "", "deviation from nominal\nstate, left positive [cm]")
    last = rows[-1]
    last.plot(time_s, margin, color=BLACK, linewidth=0.8)
    last.axhline(0.0, color=GREY, linewidth=0.8)
    dress(last, "time [s] (shaded: curves)", "margin [1]")
    last.margins(x=0.0)
    inside = 100.0 * np.mean(margin >= 0.0) if margin.size else np.nan
    note(last, 0.02, 0.06, f"both true axle points inside at {inside:.2f} % of the ticks")
    return figure


def _draw_offset(
    axes: Axes, time_s: FloatArray, offset: FloatArray, band: FloatArray, body: str, label: str
) -> None:
    """Draw an offset and the band around zero that it should stay in, both given in metres."""
    axes.fill_between(time_s, -100 * band, 100 * band, color=PALE, alpha=0.6, label=label)
    axes.plot(time_s, 100 * offset, color=BODY_COLOURS[body], linewidth=0.8, label=body)
    axes.margins(x=0.0)
    legend(axes, 2)


def signals_figure(record: Record) -> Figure:
    """Return feedforward, feedback, robust and total action of each input with its bounds.

    Parts that a controller does not have, or that are zero throughout, are left out.
    """
    table = record[CONTROL]
    given = [
        action
        for action in _ACTIONS
        if action[0] == "command"
        or any(np.nan_to_num(_shown(table, name, action[0])).any() for name, _, _ in INPUTS)
    ]
    figure, rows = stacked(3, 2.1)
    for axes, (name, label, factor) in zip(rows, INPUTS, strict=True):
        for action, text, colour, line in given:
            style = {"color": colour, "linewidth": 0.9, "linestyle": line, "label": text}
            axes.plot(table.time_s, factor * _shown(table, name, action), **style)
        dress(axes, "", label)
        draw_bounds(axes, table, name, factor)
    legend(rows[0], 6, [BOUNDS])
    label_below(rows[-1], "time [s]")
    return figure


def _shown(control: Table, name: str, action: str) -> FloatArray:
    """Return an action of an input, NaN where the total is what is sent."""
    values = control[f"{name}_{action}"]
    if action != "total":
        return values
    return np.where(np.abs(values - control[f"{name}_command"]) > _CUT, values, np.nan)


def draw_bounds(axes: Axes, control: Table, name: str, factor: float) -> None:
    """Draw the bounds of an input, in view where they are near the signals in the axes.

    Args:
        axes: with the signals.
        control: rows of the commands of a run.
        name: of the input.
        factor: from the unit of the input's field to that of the axes.
    """
    axes.margins(x=0.0)
    low, high = axes.get_ylim()
    near = _NEAR * (high - low)
    view = [low, high]
    for end in ("min", "max"):
        values = factor * control[f"{name}_{end}"]
        axes.plot(control.time_s, values, **_BOUND_LINE)
        view += [*values[(values >= low - near) & (values <= high + near)]]
    axes.set_ylim(min(view), max(view))


def tyres_figure(record: Record) -> Figure:
    """Return slip, slip angle and load of the wheels over time, curves shaded.

    Lines are means over a second.
    """
    table = record[TYRES]
    errors = tracking_errors(record)
    starts = np.flatnonzero(np.diff(np.floor(table.time_s / _WINDOW_S), prepend=-1.0))
    counts = np.diff(np.append(starts, len(table)))
    time_s = np.add.reduceat(table.time_s, starts) / counts
    figure, rows = stacked(3, 2.1)
    for axes, (field, label, factor, axles) in zip(rows, _WHEELS, strict=True):
        shade(axes, errors.time_s, errors.curved)
        for axle in axles:
            for side, line in _SIDES.items():
                samples = factor * table[f"{axle}_{side}_{field}"]
                mean = np.add.reduceat(samples, starts) / counts
                style = {"color": _AXLES[axle], "linewidth": 1.1, "label": f"{axle} {side}"}
                axes.plot(time_s, mean, linestyle=line, **style)
        dress(axes, "", label)
        axes.margins(x=0.0)
        legend(axes, 6)
    label_below(rows[-1], "time [s] (shaded: curves; means over 1 s)")
    return figure


def timing_figure(record: Record) -> Figure:
    """Return a histogram of each time with its median and 99th percentile."""
    figure = blank(4.2)
    for axes, (field, title) in zip(figure.subplots(2, 2).flat, _TIMES, strict=True):
        cost_us = record[TIMING][field]
        known = np.isfinite(cost_us)
        empty = "not recorded"
        if field == "qp_solve_us":
            empty = _solver_use(record)
            title += f": {empty}"
        dress(axes, "wall-clock time [µs]", "control periods", title)
        histogram(axes, cost_us[known & (cost_us > 0.0)], empty)
    return figure


def _solver_use(record: Record) -> str:
    """Return in how many ticks the QP needed the solver, in words."""
    solver = solver_statistics(record)
    if solver is None:
        return "the controller solves no QP"
    return f"{solver.needed_solver} of {solver.ticks} ticks needed the solver"


def histogram(axes: Axes, cost_us: FloatArray, empty: str = "not recorded") -> None:
    """Draw the distribution of times [µs] with median, 99 % and maximum; `empty` without any."""
    if len(cost_us) < _FEWEST:
        times = ", ".join(f"{time:.0f}" for time in cost_us)
        text = f"{times} µs: too few to draw" if times else empty
        note(axes, 0.5, 0.5, text, ha="center", color=GREY)
        axes.set(xticks=[], yticks=[])
        return
    low = 0.9 * cost_us.min()
    high = 1.1 * cost_us.max()
    axes.set_xscale("log")
    axes.hist(cost_us, bins=np.geomspace(low, high, _BINS).tolist(), color=SKY)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0) if high < 100.0 * low else (1.0,)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_locator(NullLocator())  # the layout would measure each of their labels
    median, p99 = np.percentile(cost_us, [50.0, 99.0])
    axes.axvline(median, color=BLACK, linewidth=1.0)
    axes.axvline(p99, color=RED, linewidth=1.0, linestyle="--")
    text = f"median {median:.0f}\n99 % below {p99:.0f}\nmax {cost_us.max():.0f}"
    note(axes, 0.98, 0.95, text, ha="right", va="top")


FIGURES: Final[dict[str, Callable[[Record], Figure]]] = {
    "path": path_figure,
    "zoom": zoom_figure,
    "error": error_figure,
    "cross-track": cross_track_figure,
    "signals": signals_figure,
    "tyres": tyres_figure,
    "timing": timing_figure,
    "tube": tube_figure,
    "corridor": corridor_figure,
}

CAPTIONS: Final = {
    "path": "Reference, and beside it the errors across it, drawn many times as large.",
    "zoom": "Reference and driven paths where the tractor was farthest from its time-based "
    "reference, on a straight and on a curve. Dots: reference and tractor at that time.",
    "error": "Distance to the time-based reference, and its means.",
    "cross-track": "Error to the left of the reference over the length of the path.",
    "signals": "The three actions, the command sent, and their sum where a limit cuts it. Dashed: "
    "the vehicle's bounds, where they are near.",
    "tyres": "Slip of the driven wheels, slip angles of front and trailer wheels, loads of all.",
    "tube": "Offset of the true vehicle to the left of the nominal one, and the tube of the "
    "controller. The tube of ttempc is that of one step, predicted from the last estimate. "
    "Below: margin of both true axle points, 1 at the centre of the tube, 0 on its boundary.",
    "corridor": "Offset of the true points to the left of their paths, and the corridor.",
    "timing": "Wall-clock time of the parts of a control period, on the machine of the run. A QP "
    "without an active bound needs no solve.",
}


def shown_figures(record: Record) -> list[str]:
    """Return the names of the figures of a run; without tube or corridor it has none of them."""
    channels = {"tube": TUBE, "corridor": CORRIDOR}
    return [name for name in FIGURES if name not in channels or len(record[channels[name]])]
