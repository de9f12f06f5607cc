"""Tables and a figure that are made from the rows of the study `compare`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from ttempc.types import FloatArray

from ..figures import png
from ..figures.style import blank, dress, legend, series
from ..results.leads import leads_sentence
from ..results.published import COLUMNS, PUBLISHED_M, applies_to
from ..results.statistics import IntervalEstimate, caveat, mean
from ..results.summary import ACTUATOR_USE
from ..scenario.scenario import load
from ..seeds import TUNED_FIELDS
from ..sweep_report.format import format_estimate
from .comparison import DEFAULT, Comparison, Ratio, read_comparison, run_errors
from .driver import Driver
from .entry import Product

STUDY: Final = "compare"
_RIVAL: Final = "pid"
_SHOWN: Final = (DEFAULT, _RIVAL, "paper")
_HEADLINE: Final = {
    "pavement": "hard and smooth; GNSS noise is white",
    "grass": "level grass; GNSS noise is white",
    "grass-field": "the same ground; sensors as in the field",
    "cultivate": "with a soil-working tool",
    "wet-slope": "wet slope; GNSS noise is white",
    "old-valves": "worn valves",
    "raw-gnss": "GNSS antennas that lean with the vehicle, IMU",
}
_STEP: Final = "timing.control_step_us.median"


def headline(driver: Driver) -> Product:
    """Return the short table of README: errors on a few fields, and where `pid` is as good."""
    comparison = _rows(driver)
    tractor, trailer = (
        100.0 * comparison.column(f"tracking.all.{body}.mean_euclidean_m")
        for body in ("tractor", "trailer")
    )
    shown = [name for name in _SHOWN if name in comparison.controllers]
    lines = []
    for name, about in _HEADLINE.items():
        if name not in comparison.fields:
            continue
        field = comparison.fields.index(name)
        cells = []
        for controller in shown:
            place = (field, comparison.controllers.index(controller))
            pair = f"{_mean(tractor[place])} / {_mean(trailer[place])}"
            cells.append(_lost(comparison, place) or pair)
        lines.append((f"`{name}`: {about}", *cells))
    heads = ("mean error of tractor / trailer [cm]", *(f"`{name}`" for name in shown))
    return Product(f"{table(heads, lines)}\n\n{_verdicts(comparison)}")


def by_field(driver: Driver) -> Product:
    """Return the default controller beside `pid` and the best rival, field by field."""
    comparison = _rows(driver)
    place = comparison.controllers.index(DEFAULT)
    lines = []
    for field, name in enumerate(comparison.fields):
        own = comparison.error_cm[field, place]
        error = format_estimate(mean(own), 2) if np.isfinite(own).all() else "lost"
        rivals = {
            rival: comparison.ratios[name, rival]
            for rival in comparison.rivals
            if (name, rival) in comparison.ratios
        }
        best = min(rivals, key=lambda rival: rivals[rival].estimate.value, default="")
        lines.append(
            (
                f"`{name}`",
                ", ".join(what for what, fields in TUNED_FIELDS.items() if name in fields) or "–",
                error,
                _ratio(rivals.get(_RIVAL)),
                f"`{best}`" if best else "–",
                _ratio(rivals.get(best)),
            )
        )
    heads = ("field", "tuned here", f"`{DEFAULT}` [cm]", f"`{_RIVAL}`: ratio; p", "best rival")
    text = table((*heads, "its ratio; p"), lines)
    ahead = leads_sentence(run_errors(comparison.by_key.values()), DEFAULT, "fields")
    notes = f"{_verdicts(comparison)} {caveat(len(comparison.seeds))}".rstrip()
    return Product(f"{text}\n\n{ahead}\n\n{notes}")


def controllers(driver: Driver) -> Product:
    """Return cost, error and use of actuators of every controller, by field too, and a figure.

    The use of the actuators is the median of the runs that completed.
    """
    comparison = _rows(driver)
    step = comparison.column(_STEP)
    costs = np.array([np.nanmedian(step[:, c]) for c in range(len(comparison.controllers))])
    reference = costs[comparison.controllers.index(DEFAULT)]
    use = [factor * comparison.column(name) for _, name, factor in ACTUATOR_USE]
    lines, points = [], []
    for number, name in enumerate(comparison.controllers):
        ratio, fields = comparison.over_fields(name)
        verdicts = [item.verdict for (_, other), item in comparison.ratios.items() if other == name]
        lines.append(
            (
                f"`{name}`",
                f"{costs[number]:.0f}",
                f"{costs[number] / reference:.2f}",
                "1" if name == DEFAULT else format_estimate(ratio, 3),
                str(fields),
                f"{verdicts.count('better')} / {verdicts.count('worse')}",
                f"{comparison.lost[:, number].sum()} of {comparison.driven[:, number].sum()}",
                *(f"{np.nanmedian(column[:, number]):.1f}" for column in use),
            )
        )
        if ratio:
            points.append((name, float(costs[number]), ratio))
    heads = (
        "controller",
        "step [us]",
        f"/ `{DEFAULT}`",
        f"error / that of `{DEFAULT}`",
        "fields",
        "better / worse",
        "lost",
        *(head for head, _, _ in ACTUATOR_USE),
    )
    field_heads = ("field", *(f"`{name}`" for name in comparison.controllers))
    field_lines = [
        (f"`{name}`", *(_cell(comparison, field, c) for c in range(len(comparison.controllers))))
        for field, name in enumerate(comparison.fields)
    ]
    text = "\n\n".join(
        [
            "![Error relative to `ttempc` over the cost of a control step](compare.png)",
            table(heads, lines),
            table(field_heads, field_lines),
            caveat(len(comparison.seeds)),
        ]
    )
    return Product(text, {"compare.png": _figure(points)})


def errors(driver: Driver) -> Product:
    """Return errors on straights and curves, by field, with their range over seeds."""
    comparison = _rows(driver)
    places = [*PUBLISHED_M]
    columns = [
        100.0 * comparison.column(f"tracking.{where}.{body}.mean_euclidean_m")
        for where, body in places
    ]
    tables = []
    for controller in (name for name in _SHOWN if name in comparison.controllers):
        number, lines = comparison.controllers.index(controller), []
        for field, name in enumerate(comparison.fields):
            place = (field, number)
            lost = f"{comparison.lost[place]} of {comparison.driven[place]}"
            lines.append((f"`{name}`", *(_range(column[place]) for column in columns), lost))
        if controller == "paper":
            published = (f"{100.0 * PUBLISHED_M[place]:.2f}" for place in places)
            lines.append(("published (field)", *published, "–"))
        tables.append(table((f"`{controller}`", *COLUMNS, "lost"), lines))
    same = ", ".join(f"`{name}`" for name in comparison.fields if applies_to(load(name)[1]))
    note_ = (
        f"The published errors compare with fields that have the paper's vehicle and path: {same}."
    )
    return Product("\n\n".join([*tables, note_]))


def table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    rows = ["| " + " | ".join(line) + " |" for line in (heads, *lines)]
    return "\n".join([rows[0], "|---" * len(heads) + "|", *rows[1:]])


def _rows(driver: Driver) -> Comparison:
    runs = driver.sweep(STUDY)  # checks the rows
    assert not runs.missing
    return read_comparison(driver.rows(STUDY))


def _verdicts(comparison: Comparison) -> str:
    """Return the sentences on where `pid` is as good."""
    ahead: dict[str, list[str]] = {_RIVAL: [], DEFAULT: []}
    significant: dict[str, list[str]] = {_RIVAL: [], DEFAULT: []}
    for (field, controller), ratio in comparison.ratios.items():
        if controller == _RIVAL:
            winner = _RIVAL if ratio.estimate.value < 1.0 else DEFAULT
            ahead[winner].append(f"`{field}`")
            if ratio.verdict:
                significant[winner].append(f"`{field}`")
    count_all = sum(map(len, ahead.values()))
    sentences = [
        f"`{name}` has the smaller mean error of both points on "
        + (
            f"{len(fields)} of {count_all} fields ({', '.join(fields)}), significantly on "
            f"{', '.join(significant[name]) or 'none'}."
            if fields
            else "no field."
        )
        for name, fields in ahead.items()
    ]
    over, count = comparison.over_fields(_RIVAL)
    return (
        f"{' '.join(sentences)} The error of `{_RIVAL}` is {format_estimate(over, 2)} times that "
        f"of `{DEFAULT}` (geometric mean over {count} fields, 95 % interval). Significant: paired "
        f"t-test at 5 % after Holm's correction for {len(comparison.ratios)} comparisons; with "
        f"{len(comparison.seeds)} seeds it finds large differences only."
    )


def _ratio(ratio: Ratio | None) -> str:
    if ratio is None:
        return "lost or not driven"
    p = "–" if np.isnan(ratio.p) else "< 0.001" if ratio.p < 0.001 else f"{ratio.p:.3f}"
    return f"{format_estimate(ratio.estimate, 2)}; {p}"


def _cell(comparison: Comparison, field: int, controller: int) -> str:
    """Return the mean error, with < where it is significantly better, > where worse."""
    place = (field, controller)
    if lost := _lost(comparison, place):
        return lost
    key = (comparison.fields[field], comparison.controllers[controller])
    verdict = comparison.ratios[key].verdict if key in comparison.ratios else ""
    sign = {"better": " <", "worse": " >"}.get(verdict, "")
    return f"{comparison.error_cm[place].mean():.2f}{sign}"


def _lost(comparison: Comparison, place: tuple[int, int]) -> str:
    """Return why a mean over the seeds would say nothing, "" where every run completed."""
    if not comparison.driven[place]:
        return "not driven"
    lost = comparison.lost[place]
    return f"{lost} of {comparison.driven[place]} lost" if lost else ""


def _mean(values: FloatArray) -> str:
    return f"{values.mean():.1f}"


def _range(values: FloatArray) -> str:
    """Return mean, least and greatest value over completed runs, "–" where there is none."""
    known = values[np.isfinite(values)]
    if not len(known):
        return "–"
    return f"{known.mean():.1f} ({known.min():.1f}-{known.max():.1f})"


def _figure(points: Sequence[tuple[str, float, IntervalEstimate]]) -> bytes:
    figure = blank(3.2)
    axes: Axes = figure.subplots()
    for number, (name, cost, ratio) in enumerate(points):
        low, high = ratio.ends
        error = [[ratio.value - low], [high - ratio.value]]
        style = {**series(number), "linestyle": "none", "label": name}
        axes.errorbar([cost], [ratio.value], error, **style)
    legend(axes, 4)
    axes.set_xscale("log")
    axes.set_yscale("log")
    dress(axes, "control step, median [us]", f"error / that of {DEFAULT}")
    return png(figure)
