"""Published figures of real machines beside this plant's, which is tuned for none of them.

`evidence.toml` has the published figures and how ours are made; the functions here measure ours.
"""

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from ttempc.types import FloatArray, Sensor

from ....testbed.ground.terrain import flat
from ....testbed.recording.channels import MEASUREMENT, REFERENCE, STATE
from ....testbed.recording.record import Record
from ....testbed.truth import WHEELS
from ....testbed.validation.bench import DRIVEN, Bench
from ....testbed.validation.check import between, number
from ....testbed.validation.single_manoeuvres import natural_frequencies, side_ratio, yaw_response
from ....testbed.validation.validate import validate
from ....testbed.wheels import tyre
from ...results.passes import pass_spreads
from ...results.tracking_errors import START_UP_S, tracking_errors
from ...run.assembly import EDGE_M
from ...run.simulate import simulate
from ...scenario.scenario import load
from ..machine import machine, scaled_law, settings
from ..markdown import markdown
from ..runner import Runner
from ..table import Table

Kind = Literal["two-sided", "one-sided"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Evidence:
    """A figure of the plant, and the band of the published one."""

    name: str
    figure: float  # ours [unit]; NaN: none
    unit: str
    band: tuple[float, float]  # of the published figure
    published: str  # as the source states it
    rule: str  # where the band comes from
    source: str
    quote: str = ""  # of the source, verbatim
    method: str  # what was driven: scenario, settings, seeds
    kind: Kind = "two-sided"
    at_work: bool = False  # of a machine in a field
    why: str = "unknown"  # reason where ours is outside

    @property
    def verdict(self) -> str:
        """Place of our figure against the band."""
        if math.isnan(self.figure):
            return "no figure"
        low, high = self.band
        return "below" if self.figure < low else "above" if self.figure > high else "in band"

    @property
    def inside(self) -> bool:
        """Whether our figure is in the band."""
        return self.verdict == "in band"

    @property
    def cells(self) -> list[str]:
        """Cells of the table: figure, published, band, ours, verdict."""
        ours = f"{number(float(f'{self.figure:.3g}'))} {self.unit}".rstrip()
        band = between("", self.figure, *self.band, self.unit, "").expectation
        return [
            self.name + (" (at work)" if self.at_work else ""),
            self.published,
            f"{band} {self.unit}".rstrip(),
            "–" if math.isnan(self.figure) else ours,
            self.verdict if self.inside else f"**{self.verdict}**",
        ]


@cache
def _content() -> dict[str, Any]:
    """Return the file of the published figures."""
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def beside(name: str, figures: Sequence[float]) -> list[Evidence]:
    """Return the figures of an experiment, in the order of the file, beside the published ones."""
    about = {key: value for key, value in _content()[name].items() if key != "figures"}
    pairs = zip(_content()[name]["figures"], figures, strict=True)
    return [Evidence(**{**about, **row}, figure=figure) for row, figure in pairs]


# Wheels on soil.

SOILS: Final = {"soft or sandy": 20.0, "tilled": 40.0, "firm": 55.0, "hard": 80.0}
"""Mobility numbers of driven wheels by which ASABE D497 names soils, from secondary sources."""


def combined_slip() -> list[float]:
    """Return the loss of side force by longitudinal slip at 15 and 30 degrees [%]."""
    bench = machine().bench
    bn = SOILS["soft or sandy"]
    figures = []
    for degrees, slip in ((15.0, 0.23), (15.0, 0.50), (30.0, 0.23), (30.0, 0.50)):
        free, loaded = (side_ratio(bench, math.radians(degrees), each, bn) for each in (0.0, slip))
        figures.append(100.0 * (1.0 - loaded / free))
    return figures


def best_slip() -> list[float]:
    """Return the slip at best tractive efficiency on the four surfaces of the source [%]."""
    return [_best_slip(machine().bench, bn) for bn in SOILS.values()]


def _best_slip(bench: Bench, bn: float) -> float:
    """Return it on soil of a mobility number of the driven wheels [%]."""
    plant = bench.plant(flat((20.0, 10.0)))
    load_n = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    per_kpa = tyre.mobility(bench.wheel_law, plant.tyres, load_n, np.ones(len(WHEELS)))[0]
    soil = replace(bench.soil, background=bn / float(per_kpa[DRIVEN].mean()))
    _, check = validate(replace(bench, soil=soil), ("tractive efficiency",))
    return check.figure or math.nan


# Handling and ride on a firm, level plane.

_STIFFNESS: Final = (
    "side_stiffness_per_rad",
    "side_stiffness_mobility_per_rad",
    "side_stiffness_most_per_rad",
)


def cornering_stiffness() -> list[float]:
    """Return how far yaw rates change when the stiffness of all tyres is 10, 25, 50 % off [%].

    The mean of both bodies, of 0.2, 0.5 and 1 Hz, and of both signs, of the complex responses.
    """
    bench = machine().bench
    fast = replace(bench.vehicle.hydrostat, speed_gain_mps=6.0)
    bench = replace(bench, vehicle=replace(bench.vehicle, hydrostat=fast))

    def responses(share: float) -> FloatArray:
        own = replace(bench, wheel_law=scaled_law(bench.vehicle, _STIFFNESS, share))
        return np.array([yaw_response(own, 4.5, frequency) for frequency in (0.2, 0.5, 1.0)])

    known = responses(1.0)
    figures = []
    for off in (0.10, 0.25, 0.50):
        changes = [np.abs(responses(1.0 + sign * off) / known - 1.0) for sign in (-1.0, 1.0)]
        figures.append(100.0 * float(np.mean(changes)))
    return figures


# Straight passes of the machine in the field.

SEEDS: Final = range(201, 204)  # smaller ones are for tuning
_SPEED: Final = 2.0  # [m/s]; 7.2 km/h

Point = Literal["tractor", "trailer", "tool"]


def gear(speed: float) -> tuple[str, ...]:
    """Return the settings of the gear in which the farm machine drives a speed [m/s].

    The hydrostat ends at 3.1 m/s in the working gear; the transport gear is assumed to reach 5 m/s.
    """
    fast = ("plant.vehicle.speed_gain_mps=5.0", "controller.vehicle.speed_gain_mps=5.0")
    return fast if speed > 3.0 else ()


def _passes(
    speed: float, *changes: str, seeds: Sequence[int] = SEEDS, length_m: float = 190.0
) -> list[Record]:
    """Return the records of straight lines east from the middle of `grass`.

    Args:
        speed: along the line [m/s].
        changes: overrides of the scenario.
        seeds: of the runs.
        length_m: of the line.
    """
    path = f'path={{kind="straight",length_m={length_m},speed_mps={speed}}}'
    field = (f"terrain.size_x_m={2.0 * (length_m + EDGE_M)}", "terrain.size_y_m=20.0")
    name, scenario = load("grass", (*changes, path, *field, *gear(speed)))
    return [simulate(name, scenario, seed)[1] for seed in seeds]


def cross_error(record: Record, point: Point) -> FloatArray:
    """Return the true cross-track errors of a point after the start-up, (n,) [m]."""
    errors = tracking_errors(record)
    return errors.by_point[point].cross_m[errors.time_s >= START_UP_S]


def ride() -> list[float]:
    """Return the frequencies of the tractor's roll, bounce and pitch after a kick [Hz]."""
    return natural_frequencies(machine().bench)


def work() -> list[float]:
    """Return median, sd [%], autocorrelation after 1, 3, 12 s of slip; sd of the tractor [cm]."""
    soil = "soil.random={coefficient_of_variation=0.3,correlation_m=5.0}"
    driven = _passes(_SPEED, *settings(), soil, seeds=range(201, 207))
    passes = [slip_each_second(record) for record in driven]
    slips = 100.0 * np.concatenate(passes)
    memory = [autocorrelation(passes, lag) for lag in (1, 3, 12)]
    guided = 100.0 * float(np.median([_seen_sd(record, "tractor") for record in driven]))
    return [float(np.median(slips)), float(slips.std()), *memory, guided]


def transport_slip() -> list[float]:
    """Return the slip of the machine that moves without a tool in the soil [%]."""
    hard = (*settings(tool=False, cone_index=2000.0), 'terrain.iso_class="A"')
    driven = _passes(_SPEED, *hard, seeds=SEEDS[:1])
    return [100.0 * float(np.median(np.concatenate([*map(slip_each_second, driven)])))]


def slip_each_second(record: Record) -> FloatArray:
    """Return the mean slip of the driven wheels in every second after the start-up, (n,)."""
    state = record[STATE]
    counted = state.time_s >= START_UP_S
    slip = 1.0 - state["v_mps"][counted] / state["v_rim_mps"][counted]
    rows = round(1.0 / np.median(np.diff(state.time_s)))  # rows in one second
    return slip[: len(slip) // rows * rows].reshape(-1, rows).mean(axis=1)


def autocorrelation(passes: list[FloatArray], lag: int) -> float:
    """Return the autocorrelation at a lag [samples] of several series about their common mean."""
    mean = np.mean(np.concatenate(passes))
    centred = [series - mean for series in passes]
    pairs = np.mean(np.concatenate([series[:-lag] * series[lag:] for series in centred]))
    return float(pairs / np.mean(np.square(np.concatenate(centred))))


def slope() -> list[float]:
    """Return the error of an unsteered tool along a slope over the tractor's, and that [cm]."""
    locked = ('controller.name="pid"', "controller.vehicle.trailer_limit_deg=0.01")
    records = _passes(_SPEED, *settings(), *locked, "terrain.slope_rad=0.1", seeds=SEEDS[:2])
    tool, tractor = (
        float(np.median(np.abs(np.concatenate([cross_error(each, point) for each in records]))))
        for point in ("tool", "tractor")
    )
    return [tool / tractor, 100.0 * tractor]


def implement_steering() -> list[float]:
    """Return the cross-track sd of the steered trailer by its own position at 15.4 km/h [cm]."""
    return [_steered_sd(15.4)]


def slow_implement_steering() -> list[float]:
    """Return the same at the middle of two slower ranges of speeds [cm]."""
    return [_steered_sd(speed_kmh) for speed_kmh in (5.0, 9.0)]


def _steered_sd(speed_kmh: float) -> float:
    records = _passes(round(speed_kmh / 3.6, 3), *settings(), seeds=SEEDS[:2])
    return 100.0 * float(np.median([_seen_sd(each, "trailer") for each in records]))


def _seen_sd(record: Record, body: Point) -> float:
    """Return the standard deviation of a cross-track error as the machine sees it on a pass [m]."""
    _, seen = pass_spreads(record)[1][body]
    return float(np.median(seen))


def pass_to_pass() -> list[float]:
    """Return the 95th percentile of the distance of two passes of the tractor on one line [cm]."""
    hard = (*settings(tool=False, cone_index=2000.0), 'terrain.iso_class="A"')
    one, other = (record[STATE] for record in _passes(2.5, *hard, seeds=SEEDS[:2]))
    counted = one.time_s >= START_UP_S
    x = one["x_t_m"][counted]
    y = one["y_t_m"][counted]
    apart = np.abs(y - np.interp(x, other["x_t_m"], other["y_t_m"]))
    return [100.0 * float(np.percentile(apart, 95.0))]


def rows() -> list[float]:
    """Return the spread of straight rows by the positions of the tractor's receiver [cm]."""
    records = _passes(1.0, *settings(tool=False), seeds=SEEDS[:2], length_m=100.0)
    return [100.0 * float(np.mean([np.std(_received(record)) for record in records]))]


def _received(record: Record) -> FloatArray:
    """Return the offsets of the received positions from a line to the east, (n,) [m]."""
    samples = record[MEASUREMENT]
    names = [f"{Sensor.GNSS_TRACTOR}_{part}" for part in ("time_s", "y_m")]
    taken, y = samples.columns(*names)[np.isfinite(samples[names[1]])].T
    return y[taken >= START_UP_S] - record[REFERENCE]["y_t_m"][-1]


Experiment = Callable[[], list[float]]

EXPERIMENTS: Final[Mapping[str, Experiment]] = {
    each.__name__: each
    for each in (
        combined_slip,
        best_slip,
        cornering_stiffness,
        ride,
        work,
        transport_slip,
        slope,
        implement_steering,
        pass_to_pass,
        rows,
        slow_implement_steering,
    )
}
"""By the name of their table, in the order of the page."""


def measure(name: str) -> list[Evidence]:
    """Return the figures of an experiment beside the published ones."""
    return beside(name, EXPERIMENTS[name]())


def _own(runner: Runner) -> list[Evidence]:
    found = runner.map(measure, [*EXPERIMENTS], "evidence")
    return [item for items in found for item in items]


def constants() -> list[str]:
    """Return the names of the main constants."""
    return [f"{part}.{name}" for part, of in _content()["constants"].items() for name in of]


def page(items: Sequence[Evidence]) -> str:
    """Return the page: counted rows, the other rows, how all were made."""
    two_sided = [item for item in items if item.kind == "two-sided"]
    one_sided = [item for item in items if item.kind == "one-sided"]
    heads = ["", "figure", "published", "band", "ours", "verdict"]
    lists = _content()["not_measured"].items()
    return "\n\n".join(
        [
            f"{_held(two_sided)} two-sided figures from "
            f"{len({item.source for item in two_sided})} sources are inside their bands, "
            f"{_held([item for item in two_sided if item.at_work])} of machines at work.",
            markdown(heads, [[str(k), *item.cells] for k, item in enumerate(two_sided, 1)]),
            "One-sided, not counted, a kinder plant passes better:",
            markdown(heads, [[f"a{k}", *item.cells] for k, item in enumerate(one_sided, 1)]),
            *("\n".join([f"{head}\n", *(f"- {text}" for text in texts)]) for head, texts in lists),
            *_notes(two_sided, ""),
            *_notes(one_sided, "a"),
        ]
    )


def _held(items: Sequence[Evidence]) -> str:
    return f"{sum(item.inside for item in items)} of {len(items)}"


def _notes(items: Sequence[Evidence], letter: str) -> list[str]:
    """Return how each run of figures with one source and method was made."""
    notes = []
    for _, run in groupby(enumerate(items, 1), lambda pair: (pair[1].source, pair[1].method)):
        group = list(run)
        (first, item), (last, _) = group[0], group[-1]
        place = f"{letter}{first}" + ("" if first == last else f" to {letter}{last}")
        quote = f' "{item.quote}".' if item.quote else ""
        lines = [f"**{place}.** {item.source.rstrip('.')}.{quote} Ours: {item.method}.", ""]
        outside = [(k, each) for k, each in group if not each.inside]
        for head, of, rows in (("Band of", "rule", group), ("Outside,", "why", outside)):
            for text, members in groupby(rows, lambda pair, of=of: getattr(pair[1], of)):
                listed = ", ".join(f"{letter}{k}" for k, _ in members)
                lines.append(f"- {head} {listed}: {text}.")
        notes.append("\n".join(lines))
    return notes


_CHECKS: Final = (("farm", "ttempc"), ("cultivate", "ttempc"), ("grass", "ttempc"))
TABLES: Final = (Table(name="evidence", make=lambda runner: page(_own(runner)), checks=_CHECKS),)
