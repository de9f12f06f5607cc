"""Search for one set of parameters under which both published controllers err as published.

The LMPC is `paper`, the NMPC `nmpc` of this folder, each with four mean errors. The first study
searches class, cone index and slope of the ground for the LMPC's errors, and drives both
controllers on the field `kayacan2016`. The second varies all of `ALL` for the errors of both.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle

from ...seeds import TUNING, report_seeds
from ..runner import Runner
from ..study import Case, Study
from ..tables import COLUMNS, ERRORS, PUBLISHED_LMPC_M, PUBLISHED_NMPC_M, markdown, numbers

_FOLDER: Final = "proving_ground.experiments.papers.kayacan"
CONTROLLER: Final = f"{_FOLDER}.nmpc:controller"
ESTIMATOR: Final = f"{_FOLDER}.nmhe:Estimator"
LMPC: Final = ('controller.name="paper"',)
NMPC: Final = (f'controller.name="{CONTROLLER}"', f'controller.estimator="{ESTIMATOR}"')

# --- Parameters -----------------------------------------------------------------------------------

Value = float | str
Overrides = Callable[[Any], tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number within bounds, or one of a few choices."""

    name: str
    start: Value  # of the first point of the search: defaults, and three values found by hand
    overrides: Overrides  # of a scenario, from the value
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    choices: tuple[str, ...] = ()

    def value(self, share: float) -> Value:
        """Return the value at a share of the way from the lower to the upper bound."""
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        low, high = self._ends
        exact = low + share * (high - low)
        return float(f"{math.exp(exact) if self.log else exact:.3g}")

    def share(self, value: Value) -> float:
        """Return a share that `value` turns into `value`, to three digits."""
        if self.choices:
            return (self.choices.index(str(value)) + 0.5) / len(self.choices)
        low, high = self._ends
        return ((math.log(float(value)) if self.log else float(value)) - low) / (high - low)

    @property
    def _ends(self) -> tuple[float, float]:
        return (math.log(self.low), math.log(self.high)) if self.log else (self.low, self.high)

    @property
    def bounds(self) -> str:
        """Bounds or choices as text."""
        ends = f"{self.low:g} to {self.high:g}" + (" (log)" if self.log else "")
        return ", ".join(self.choices) or ends


def _keys(*keys: str) -> Overrides:
    """Return the overrides that give the value to all `keys`."""
    return lambda value: tuple(
        f"{key}=" + (f'"{value}"' if isinstance(value, str) else f"{value}") for key in keys
    )


def _option(name: str) -> Overrides:
    return _keys(f"controller.options.{name}")


def _dead_time(value: float) -> tuple[str, ...]:
    """Set the dead time of both steering valves, a whole number of physics steps."""
    valves = _keys("actuators.front.dead_time_s", "actuators.trailer.dead_time_s")
    return valves(round(value, 2))


def _hitch(value: float) -> tuple[str, ...]:
    """Set the place of RJ1 between rear axle and RJ2, whose distance is printed."""
    lengths = {"hitch_offset_m": value, "drawbar_m": round(Vehicle().drawbar_offset - value, 4)}
    changes = [
        f"{where}.vehicle.{key}={length}"
        for key, length in lengths.items()
        for where in ("plant", "controller")
    ]
    # Nearer to the axle, the drawbar meets the wheels at a smaller angle than the file's.
    if value < 0.3:
        changes.append("plant.vehicle.parts.hitch.yaw_limit_deg=60.0")
    return tuple(changes)


def _step_weight(value: float) -> tuple[str, ...]:
    return _option("step_weight")([value, value, 1.0])


def _speed_weight(value: float) -> tuple[str, ...]:
    return _option("output_weight")([1.0, 1.0, 1.0, 1.0, value])


def _unset(value: float) -> tuple[str, ...]:
    """Set nothing: `overrides` joins two parameters to one option."""
    return ()


P = Parameter
_STOP: Final = _keys(
    "plant.vehicle.parts.trailer_steering.limit_deg", "controller.vehicle.trailer_limit_deg"
)
FIELD: Final = (
    P("ISO 8608 class", "E", _keys("terrain.iso_class"), choices=("C", "D", "E", "F")),
    P("cone index [kPa]", 160.0, _keys("soil.cone_index_kpa"), 120.0, 600.0, log=True),
    P("slope [rad]", 0.02, _keys("terrain.slope_rad"), 0.0, 0.10),
)
# Of the path the radius alone is printed; the length of its straights follows from the distance.
MACHINE: Final = (
    *FIELD,
    P("distance of the circles [m]", 44.0, _keys("path.centre_distance_m"), 24.0, 44.0),
    P("white share of the GNSS error", 1.0, _keys("sensors.gnss_white_share"), 0.0, 1.0),
    P("GNSS antenna", "point", _keys("sensors.gnss_antenna"), choices=("point", "raw")),
    P("dead time of both valves [s]", 0.01, _dead_time, 0.01, 0.4, log=True),
    P("rear axle to RJ1 [m]", 0.3, _hitch, 0.2, 0.6),
    P("stop of the trailer steering [deg]", 25.0, _STOP, 20.0, 35.0),
)
LMPC_OPTIONS: Final = (  # that are not printed
    P("nominal state of the LMPC", "one-step", _option("nominal"), choices=("one-step", "tube")),
)
_FRONT: Final = P("NMPC: bound of the front steering [deg]", 10.5, _unset, 8.0, 35.0, log=True)
_TRAILER: Final = P("NMPC: bound of the trailer steering [deg]", 6.0, _unset, 3.0, 25.0, log=True)
NMPC_OPTIONS: Final = (  # that are not known
    _FRONT,
    _TRAILER,
    P("NMPC: look-ahead [m]", 1.6, _option("look_ahead_m"), 0.0, 4.0),
    P("NMPC: target", "fixed", _option("target"), choices=("fixed", "moving")),
    P("NMPC: step weight of the steerings", 1.0, _step_weight, 0.1, 100.0, log=True),
    P("NMPC: speed weight", 1.0, _speed_weight, 0.1, 100.0, log=True),
    P("NMPC: trailer input", "lambda", _option("trailer_input"), choices=("lambda", "delta_i")),
)
ALL: Final = (*MACHINE, *LMPC_OPTIONS, *NMPC_OPTIONS)


def overrides(parameters: Sequence[Parameter], shares: Sequence[float]) -> tuple[str, ...]:
    """Return the overrides that set `parameters` to their values at `shares`."""
    values = {item: item.value(share) for item, share in zip(parameters, shares, strict=True)}
    lines = [line for item, value in values.items() for line in item.overrides(value)]
    if _FRONT in values:
        front, trailer = (math.radians(float(values[item])) for item in (_FRONT, _TRAILER))
        lines.append(f"controller.options.input_bound=[{front:.4f}, {trailer:.4f}, 1.0]")
    return tuple(lines)


# --- Search ---------------------------------------------------------------------------------------

SEARCH_SEEDS: Final = tuple(TUNING[:2])
REPORT_SEEDS: Final = report_seeds(5)
WITHIN: Final = 0.25  # relative difference of a number that counts as found
WORST: Final = 3.0  # largest relative difference that counts, also that of a run that is lost
SETS: Final = 16  # of a generation of differential evolution (Storn and Price 1997)
GENERATIONS: Final = {"eight-numbers-fit": 2, "eight-numbers": 3}
NAMES: Final = tuple(f"{name}, {column}" for name in ("LMPC", "NMPC") for column in COLUMNS)
PUBLISHED_CM: Final = 100.0 * np.array([*PUBLISHED_LMPC_M, *PUBLISHED_NMPC_M])


def differences(errors_cm: FloatArray) -> FloatArray:
    """Return |error / published - 1|, at most `WORST`, of (..., n) errors; lost runs have it."""
    relative = np.abs(errors_cm / PUBLISHED_CM[: errors_cm.shape[-1]] - 1.0)
    return np.minimum(np.where(np.isfinite(relative), relative, WORST), WORST)


def distance(errors_cm: FloatArray) -> FloatArray:
    """Return the root mean square of `differences` over the last axis."""
    return np.sqrt(np.mean(np.square(differences(errors_cm)), axis=-1))


@dataclass(frozen=True, slots=True)
class Problem:
    """Errors to find, of the LMPC alone or of both controllers, and what may be varied for it."""

    parameters: tuple[Parameter, ...]
    controllers: tuple[tuple[tuple[str, ...], tuple[Parameter, ...]], ...]  # overrides, parameters

    def cases(self, point: FloatArray, seed: int) -> list[Case]:
        """Return the run of every controller at a point of the unit cube."""
        share = dict(zip(self.parameters, point.tolist(), strict=True))
        return [
            Case(
                "grass",
                seed,
                ("path.laps=1", *fixed, *overrides(own, [share[item] for item in own])),
            )
            for fixed, own in self.controllers
        ]

    def errors_cm(
        self, runner: Runner, points: Sequence[FloatArray], seeds: Sequence[int]
    ) -> FloatArray:
        """Return the errors at points and seeds, (points, seeds, numbers); NaN in a lost run."""
        cases = [case for point in points for seed in seeds for case in self.cases(point, seed)]
        return errors_of(runner.frame(cases)).reshape(len(points), len(seeds), -1)


def errors_of(rows: pd.DataFrame) -> FloatArray:
    """Return the mean errors of runs [cm], (n, 4); NaN in a run that was lost."""
    completed = (rows["status"] == "completed").to_numpy()
    return np.where(completed[:, None], 100.0 * numbers(rows, *ERRORS), np.nan)


LMPC_ON_FIELD: Final = Problem(FIELD, ((LMPC, FIELD),))
_CORRELATED: Final = 'sensors.gnss_error="correlated"'  # a white share of 1 makes it white
BOTH: Final = Problem(
    ALL,
    (
        ((_CORRELATED, *LMPC), (*MACHINE, *LMPC_OPTIONS)),
        ((_CORRELATED, *NMPC), (*MACHINE, *NMPC_OPTIONS)),
    ),
)


@dataclass(frozen=True, slots=True)
class Found:
    """Result of a search."""

    problem: Problem
    tried_cm: FloatArray  # (points, numbers) of all points, first seed
    point: FloatArray  # the best
    report_cm: FloatArray  # (report seeds, numbers)

    @property
    def mean_cm(self) -> FloatArray:
        """Mean over the report seeds that completed, (numbers,); NaN where none did."""
        with np.errstate(invalid="ignore"):
            return np.nansum(self.report_cm, 0) / np.isfinite(self.report_cm).sum(0)

    def values(self) -> list[tuple[str, str, str]]:
        """Return name, bounds and best value of the parameters."""
        pairs = zip(self.problem.parameters, self.point.tolist(), strict=True)
        named = ((item, item.value(share)) for item, share in pairs)
        return [(i.name, i.bounds, v if isinstance(v, str) else f"{v:g}") for i, v in named]


def find(problem: Problem, runner: Runner, generations: int) -> Found:
    """Minimise the mean distance over the search seeds, and drive the report seeds at the best.

    Differential evolution from `ALL` at its starts and a Sobol sequence; `SETS` points a
    generation.
    """
    points: list[FloatArray] = []
    tried: list[FloatArray] = []

    def scores(columns: FloatArray) -> FloatArray:
        errors = problem.errors_cm(runner, [*columns.T], SEARCH_SEEDS)
        points.extend(columns.T)
        tried.extend(errors)
        return distance(errors).mean(axis=1)

    parameters = problem.parameters
    first = qmc.Sobol(len(parameters), rng=np.random.default_rng(0)).random(SETS)
    first[0] = [item.share(item.start) for item in parameters]
    differential_evolution(
        scores,
        [(0.0, 1.0)] * len(parameters),
        maxiter=generations - 1,
        init=first,  # pyright: ignore[reportArgumentType]
        rng=np.random.default_rng(0),
        tol=0.0,
        polish=False,
        updating="deferred",
        vectorized=True,
    )
    best = points[int(np.argmin([distance(errors).mean() for errors in tried]))]
    report_cm = problem.errors_cm(runner, [best], REPORT_SEEDS)[0]
    return Found(problem, np.array(tried)[:, 0], best, report_cm)


# --- Tables ---------------------------------------------------------------------------------------


def fit_table(runner: Runner) -> str:
    """Return the fit of the LMPC's four numbers: best field, and the shipped scenario."""
    fit = find(LMPC_ON_FIELD, runner, GENERATIONS["eight-numbers-fit"])
    cases = [Case("kayacan2016", seed, own) for seed in REPORT_SEEDS for own in (LMPC, NMPC)]
    shipped_cm = errors_of(runner.frame(cases)).reshape(len(REPORT_SEEDS), -1)
    values = ", ".join(f"{name} {value}" for name, _, value in fit.values())
    lines = []
    for i, name in enumerate(NAMES):
        field = _spread(fit.report_cm[:, i]) if i < fit.report_cm.shape[1] else "-"
        lines.append((name, f"{PUBLISHED_CM[i]:.2f}", field, _spread(shipped_cm[:, i])))
    heads = ("controller, error [cm]", "published", "best field", "`kayacan2016`")
    return (
        f"Best of {len(fit.tried_cm)} fields for `paper`: {values}. Distance on the report seeds "
        f"{distance(fit.mean_cm):.2f}.\n\n{markdown(heads, lines)}"
    )


def search_table(found: Found) -> str:
    """Return the best set for all eight numbers, and how near each number came by itself."""
    near = (differences(found.tried_cm) <= WITHIN).sum(axis=0)  # (8,)
    ratio = found.mean_cm / PUBLISHED_CM
    lines = [
        (
            name,
            f"{PUBLISHED_CM[i]:.2f}",
            _spread(found.report_cm[:, i]),
            "-" if np.isnan(ratio[i]) else f"{ratio[i]:.2f}",
            f"{near[i]} of {len(found.tried_cm)}",
        )
        for i, name in enumerate(NAMES)
    ]
    heads = ("controller, error [cm]", "published", "best set", "ours / published")
    off = differences(found.mean_cm) > WITHIN
    lost = np.isnan(found.report_cm)[:, ::4].any(axis=1).sum()
    beyond = ", ".join(name for i, name in enumerate(NAMES) if off[i])
    verdict = (
        f"Best of {len(found.tried_cm)} sets: distance {distance(found.mean_cm):.2f} on the report "
        f"seeds, {lost} of {len(found.report_cm)} with a lost run. Beyond {WITHIN:.0%}: "
        f"{beyond or 'none'}."
    )
    return "\n\n".join(
        (
            markdown((*heads, f"sets within {WITHIN:.0%}"), lines),
            verdict,
            markdown(("parameter", "bounds", "best set"), found.values()),
        )
    )


def _spread(errors_cm: FloatArray) -> str:
    """Return mean, least and greatest of the seeds that completed, and how many were lost."""
    completed = errors_cm[np.isfinite(errors_cm)]
    if not completed.size:
        return "-"
    lost = len(errors_cm) - completed.size
    text = f"{completed.mean():.1f} ({completed.min():.1f}-{completed.max():.1f})"
    return f"{text}, {lost} lost" if lost else text


_CHECKS: Final = (("kayacan2016", "paper"), ("kayacan2016", CONTROLLER))
STUDIES: Final = (
    Study(
        name="eight-numbers-fit",
        make=fit_table,
        seeds=REPORT_SEEDS,
        checks=(*_CHECKS, ("grass", "paper")),
    ),
    Study(
        name="eight-numbers",
        make=lambda runner: search_table(find(BOTH, runner, GENERATIONS["eight-numbers"])),
        seeds=REPORT_SEEDS,
        checks=_CHECKS,
    ),
)
