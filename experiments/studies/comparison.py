"""Rows of paired runs -> means with their confidence, as a table and as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..errors import InvalidRows
from ..figures import png
from ..figures.style import blank, dress, series
from ..results.statistics import Estimate, bootstrap
from ..sweep.row import Row

_ERRORS: Final = tuple(f"tracking.all.{body}.mean_euclidean_m" for body in ("tractor", "trailer"))
_STEP: Final = "timing.control_step_us.median"


@dataclass(frozen=True, slots=True)
class Comparison:
    """Errors and costs of runs, (scenario, seed, controller), NaN where one did not complete."""

    scenarios: tuple[str, ...]
    seeds: tuple[int, ...]
    controllers: tuple[str, ...]
    against: int  # place of the controller that the others are compared with
    error_cm: FloatArray  # mean Euclidean error, the mean of both points
    step_us: FloatArray  # median cost of a control step
    runs: NDArray[np.intp]  # 1 where there was a run

    @classmethod
    def of(cls, rows: Sequence[Row], against: str) -> Comparison:
        """Return the comparison of a file's rows with the controller `against`.

        Raises:
            InvalidRows: there is no run of it, or there are two of one controller, scenario and
                seed.
        """
        runs_of = {_key(row): row for row in rows}
        if len(runs_of) < len(rows):
            raise InvalidRows("there are two runs of one controller, scenario and seed")
        scenarios = tuple(dict.fromkeys(scenario for scenario, _, _ in runs_of))
        seeds = tuple(dict.fromkeys(seed for _, seed, _ in runs_of))
        controllers = tuple(dict.fromkeys(controller for _, _, controller in runs_of))
        if against not in controllers:
            raise InvalidRows(
                f"no run of {against!r} to compare with, there are {', '.join(controllers)}"
            )
        shape = len(scenarios), len(seeds), len(controllers)
        error, cost = np.full(shape, np.nan), np.full(shape, np.nan)
        runs = np.zeros(shape, dtype=np.intp)
        for (scenario, seed, controller), row in runs_of.items():
            place = scenarios.index(scenario), seeds.index(seed), controllers.index(controller)
            runs[place] = 1
            cost[place] = _number(row[_STEP])
            if row["status"] == "completed":
                error[place] = 100.0 * np.mean([_number(row[name]) for name in _ERRORS])
        return cls(scenarios, seeds, controllers, controllers.index(against), error, cost, runs)

    def lost(self, controller: int) -> int:
        """Return how many runs of a controller did not complete."""
        ended = np.isfinite(self.error_cm[..., controller])
        return int(self.runs[..., controller].sum() - ended.sum())

    def error(self, scenario: int, controller: int) -> Estimate | None:
        """Return the mean error [cm] of the runs that completed, None where there is none."""
        found = self.error_cm[scenario, :, controller]
        found = found[np.isfinite(found)]
        return bootstrap(found) if len(found) else None

    def over(self, scenarios: Sequence[int], controller: int) -> Estimate | None:
        """Return the mean error [cm] over scenarios in which all runs completed."""
        found = self.error_cm[list(scenarios)][..., controller].T  # (seeds, scenarios)
        return bootstrap(found.mean(axis=1)) if found.size else None

    def difference(self, scenarios: Sequence[int], controller: int) -> Estimate | None:
        """Return the mean of the paired differences to `against` [cm], over whole seeds alone."""
        chosen = self.error_cm[list(scenarios)]
        paired = (chosen[..., controller] - chosen[..., self.against]).T  # (seeds, scenarios)
        paired = paired[np.isfinite(paired).all(axis=1)]
        return bootstrap(paired.mean(axis=1)) if paired.size else None

    def survived(self, controller: int) -> list[int]:
        """Return the scenarios in which all runs of it and of `against` completed."""
        both = self.error_cm[..., [controller, self.against]]
        return [int(s) for s in np.flatnonzero(np.isfinite(both).all(axis=(1, 2)))]

    def cost_us(self, controller: int) -> float:
        """Return the median over all runs of the median cost of a step."""
        return float(np.nanmedian(self.step_us[..., controller]))


def markdown(comparison: Comparison) -> str:
    """Return the two tables of docs/compare.md."""
    it, against = comparison, comparison.controllers[comparison.against]
    everything = range(len(it.controllers))
    lines = [
        "# Every controller on every field",
        "",
        f"Seeds {', '.join(map(str, it.seeds))}; all controllers met the same ground and noise. "
        "Errors are mean Euclidean errors after the first 8 s, the mean of tractor and trailer "
        f"[cm]; in brackets the 95 % bootstrap confidence interval of the paired difference to "
        f"`{against}`, of `{against}` itself that of its mean. Costs are medians of the control "
        "step within the runs. Simulation; written by",
        "",
        f"    python -m experiments.studies.compare draw FILE --against {against}",
        "",
        "![Tracking error over the cost of a control step](compare.png)",
        "",
        f"| controller | step [us] | / `{against}` | error, all fields | fields | lost |",
        "|---|---|---|---|---|---|",
    ]
    for c in everything:
        fields = it.survived(c)
        mean, whole = it.over(fields, c), it.difference(fields, c)
        value = "-" if mean is None else f"{mean.value:.2f}"
        span = _interval(mean, "") if c == it.against else _interval(whole, "+")
        cost = it.cost_us(c)
        lines.append(
            f"| `{it.controllers[c]}` | {cost:.0f} | {cost / it.cost_us(it.against):.2f} | "
            f"{value} {span} | {len(fields)} | {it.lost(c)} |"
        )
    lines += ["", "Only fields on which no run of the pair was lost count in the first table.", ""]
    lines.append("| field | " + " | ".join(f"`{name}`" for name in it.controllers) + " |")
    lines.append("|---" * (len(it.controllers) + 1) + "|")
    for s, name in enumerate(it.scenarios):
        cells = []
        for c in everything:
            mean = it.error(s, c)
            span = _interval(mean, "") if c == it.against else _interval(it.difference([s], c), "+")
            none = "lost" if it.runs[s, :, c].any() else "not driven"
            cells.append(none if mean is None else f"{mean.value:.2f} {span}")
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def picture(comparison: Comparison) -> bytes:
    """Return error over cost as PNG: a small point a field, a large one for all of them."""
    figure = blank(4.4)
    axes = figure.subplots()
    dress(axes, "control step, median [us]", "mean Euclidean error, both points [cm]")
    axes.set(xscale="log", yscale="log")
    it = comparison
    for c, name in enumerate(it.controllers):
        looks: dict[str, Any] = series(c) | {"linestyle": "none"}
        cost = it.cost_us(c)
        errors = [mean for s in range(len(it.scenarios)) if (mean := it.error(s, c))]
        values = [mean.value for mean in errors]
        axes.plot([cost] * len(values), values, markersize=3, alpha=0.4, **looks)
        fields = it.survived(c)
        whole = it.over(fields, c)
        if whole is not None:
            low, high = whole.ends
            axes.errorbar(
                [cost],
                [whole.value],
                yerr=[[whole.value - low], [high - whole.value]],
                markersize=8,
                capsize=3,
                label=f"{name} ({len(fields)}/{len(it.scenarios)} fields)",
                **looks,
            )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=7.5)
    return png(figure)


def _interval(mean: Estimate | None, sign: str) -> str:
    if mean is None or mean.low is None:
        return ""
    return f"({mean.low:{sign}.2f} to {mean.high:{sign}.2f})"


def _key(row: Row) -> tuple[str, int, str]:
    seed = row["seed"]
    assert isinstance(seed, int)
    return str(row["scenario"]), seed, str(row["controller"])


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else np.nan
