"""Published figures of real machines beside those of this plant, which is tuned for none.

`evidence.toml` has the published figures and how ours are made; the functions here measure ours.
"""

import json
import math
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, Final, Literal
from unittest.mock import patch

import mujoco
import numpy as np

from ttempc.types import FloatArray, Sensor

from ....testbed.ground.soil import SoilMap
from ....testbed.ground.terrain import flat
from ....testbed.implement.implement import Implement
from ....testbed.recording.channels import ESTIMATE, MEASUREMENT, REFERENCE, STATE
from ....testbed.recording.record import Record
from ....testbed.truth import WHEELS
from ....testbed.validation.bench import DRIVEN, FIRM_KPA, Bench, column, drive, steps
from ....testbed.validation.check import between, number
from ....testbed.validation.validate import validate
from ....testbed.vehicle.servos import tyres_of
from ....testbed.vehicle.vehicle import VEHICLES, read_vehicle
from ....testbed.wheels import tyre
from ....testbed.wheels.soil_law import SoilLaw
from ...results.summary import Summary
from ...results.tracking_errors import START_UP_S, rows_at_same_time, tracking_errors
from ...run.assembly import EDGE_M
from ...run.simulate import simulate
from ...scenario.scenario import load
from ..runner import Runner
from ..study import Study
from ..tables import markdown

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


# The machine, as it ships or with one constant wrong.

WRONG: Final = (0.7, 1.3)
_TOOL: Final = {"width_m": 2.0, "side_stiffness_n_per_deg_m2": 1500.0}


@dataclass(frozen=True, slots=True)
class Machine:
    """The farm machine with its field cultivator, one of `CONSTANTS` times a factor."""

    constant: str = ""
    factor: float = 1.0

    @property
    def file(self) -> str:
        """Name of the vehicle, or path of a file of the changed one."""
        place, _, name = self.constant.partition(".")
        if place != "vehicle":
            return "farm4500"
        content = tomllib.loads(VEHICLES.find("farm4500").read_text(encoding="utf-8"))
        table, key = name.split(".")
        for one in [item for item in content if item.endswith(table.lstrip("*"))]:
            if one == table or table.startswith("*"):
                content[one][key] *= self.factor
        lines = [f"description = {json.dumps(content.pop('description'))}"]
        for head, values in content.items():
            lines += [f"[{head}]", *(f"{key} = {json.dumps(own)}" for key, own in values.items())]
        file = Path(tempfile.gettempdir()) / f"evidence-{name}-{self.factor}.toml".replace("*", "")
        file.write_text("\n".join(lines), encoding="utf-8")
        return str(file)

    @property
    def law(self) -> Mapping[str, float]:
        """Coefficient of the wheel law that is changed, if it is one of all tyres."""
        _, _, name = self.constant.partition(".")
        return {name: self.factor * getattr(SoilLaw(), name)} if "mobility_" in name else {}

    def changes(self, *, tool: bool = True, cone_index: float | None = None) -> tuple[str, ...]:
        """Return the settings of the machine on the field of `farm`, as of `--set`."""
        inside = ",".join(f"{key}={getattr(self.implement, key)}" for key in _TOOL)
        return (
            f"plant.vehicle.file={json.dumps(self.file)}",
            f"soil.cone_index_kpa={self.strength * (cone_index or 900.0)}",
            *(f"plant.wheel_law.{key}={value}" for key, value in self.law.items()),
            *([f'implement={{type="field-cultivator",depth_m=0.10,{inside}}}'] if tool else []),
            'sensors.preset="field"',
        )

    @property
    def of_tyres(self) -> list[str]:
        """Coefficients for `scaled`: those that differ by kind of tyre."""
        place, _, name = self.constant.partition(".")
        return [name] if place == "law" and not self.law else []

    def share(self, constant: str) -> float:
        """Return the factor of a constant: 1, unless it is the one that is wrong."""
        return self.factor if constant == self.constant else 1.0

    @property
    def strength(self) -> float:
        """Cone index of any soil over that which it should have."""
        return self.share("soil.cone_index_kpa")

    @property
    def implement(self) -> Implement:
        """Tool of the machine."""
        own: dict[str, Any] = {k: x * self.share(f"implement.{k}") for k, x in _TOOL.items()}
        return Implement(type="field-cultivator", depth_m=0.10, **own)

    def bench(self) -> Bench:
        """Return the machine on firm, level ground."""
        soil = replace(SoilLaw(), **self.law)
        vehicle = read_vehicle(self.file)
        return Bench(vehicle, flat((300.0, 60.0)), SoilMap(FIRM_KPA), wheel_law=soil)


@contextmanager
def scaled(names: Sequence[str], factor: float) -> Iterator[None]:
    """Let tyres of either kind have coefficients of their law times a factor in the block."""
    kept = SoilLaw.of

    def of(self: SoilLaw, radial: np.ndarray) -> SoilLaw:
        law = copy(kept(self, radial))
        done = getattr(law, "done", ())
        for name in [each for each in names if each not in done]:
            object.__setattr__(law, name, factor * getattr(law, name))
        object.__setattr__(law, "done", (*done, *names))
        return law

    with patch.object(SoilLaw, "of", of):
        yield


# Wheels on soil.

SOILS: Final = {"soft or sandy": 20.0, "tilled": 40.0, "firm": 55.0, "hard": 80.0}
"""Mobility numbers of driven wheels by which ASABE D497 names soils, from secondary sources."""

_REAR: Final = WHEELS.index("rear_left")


def side_ratio(bench: Bench, slip_angle: float, slip: float, bn: float) -> float:
    """Return side force over load of the machine's rear wheel in steady rolling.

    Args:
        bench: of the machine.
        slip_angle: of the wheel [rad].
        slip: driving positive.
        bn: mobility number of the wheel, at its rated load.
    """
    law = bench.wheel_law.of(np.array([True]))
    bn_area, m_area = tyres_of(bench.vehicle).mobility_areas(law)[_REAR]
    numbers, m = np.array([bn]), np.array([bn * m_area / bn_area])
    # the slip angle of the law refers to the speed of travel, or of sliding where it is larger
    travel = max(math.cos(slip_angle), math.cos(slip_angle) * slip / (1.0 - slip))
    angle = np.arctan(np.array([math.sin(slip_angle) / travel]))
    return float(law.combined_ratios(numbers, m, slip, angle)[1][0])


def combined_slip(machine: Machine) -> list[float]:
    """Return the loss of side force by longitudinal slip at 15 and 30 degrees [%]."""
    bench, bn, figures = machine.bench(), SOILS["soft or sandy"], []
    for degrees, slip in ((15.0, 0.23), (15.0, 0.50), (30.0, 0.23), (30.0, 0.50)):
        free, loaded = (side_ratio(bench, math.radians(degrees), each, bn) for each in (0.0, slip))
        figures.append(100.0 * (1.0 - loaded / free))
    return figures


def best_slip(machine: Machine) -> list[float]:
    """Return the slip at best tractive efficiency on the four surfaces of the source [%]."""
    return [_best_slip(machine.bench(), bn) for bn in SOILS.values()]


def _best_slip(bench: Bench, bn: float) -> float:
    """Return it on soil of a mobility number of the driven wheels [%]."""
    plant = bench.plant(flat((20.0, 10.0)))
    load_n = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    per_kpa = tyre.mobility(bench.wheel_law, plant.tyres, load_n, np.ones(len(WHEELS)))[0]
    soil = replace(bench.soil, background=bn / float(per_kpa[DRIVEN].mean()))
    _, check = validate(replace(bench, soil=soil), ("tractive efficiency",))
    return check.figure or math.nan


# Handling and ride on a firm, level plane.

_AMPLITUDE: Final = math.radians(2.0)
_EVERY_S: Final = 0.02
_STIFFNESS: Final = (
    "side_stiffness_per_rad",
    "side_stiffness_mobility_per_rad",
    "side_stiffness_most_per_rad",
)


def yaw_response(bench: Bench, speed: float, frequency_hz: float, periods: int = 3) -> FloatArray:
    """Return yaw rates of tractor and trailer over the steering angle, complex (2,) [1/s]."""
    plant = bench.plant(bench.terrain)
    plant.reset(-140.0, 0.0, 0.0, speed)
    rate, rows = 2.0 * math.pi * frequency_hz, []
    for k in range(round((periods + 1) / frequency_hz / _EVERY_S)):
        command = bench.command(speed, delta_t=_AMPLITUDE * math.sin(rate * k * _EVERY_S))
        truth = plant.advance(command, steps(plant, _EVERY_S))
        rows.append((truth.yaw_rate_t, truth.yaw_rate_i, truth.delta_t))
    steady = np.array(rows[round(1.0 / frequency_hz / _EVERY_S) :])  # after the transient
    tractor, trailer, angle = np.exp(-1j * rate * _EVERY_S * np.arange(len(steady))) @ steady
    return np.array([tractor, trailer]) / angle


def cornering_stiffness(machine: Machine) -> list[float]:
    """Return how far yaw rates change when the stiffness of all tyres is 10, 25, 50 % off [%].

    The mean of both bodies, of 0.2, 0.5 and 1 Hz, and of both signs, of the complex responses.
    """
    bench = machine.bench()
    fast = replace(bench.vehicle.hydrostat, speed_gain_mps=6.0)
    bench = replace(bench, vehicle=replace(bench.vehicle, hydrostat=fast))

    def responses(share: float) -> FloatArray:
        with scaled(_STIFFNESS, share):
            return np.array([yaw_response(bench, 4.5, frequency) for frequency in (0.2, 0.5, 1.0)])

    known, figures = responses(1.0), []
    for off in (0.10, 0.25, 0.50):
        changes = [np.abs(responses(1.0 + sign * off) / known - 1.0) for sign in (-1.0, 1.0)]
        figures.append(100.0 * float(np.mean(changes)))
    return figures


def ride(machine: Machine) -> list[float]:
    """Return the frequencies of the tractor's roll, bounce and pitch after a kick at 1 m/s [Hz]."""
    bench, figures = machine.bench(), []
    for dof, name in ((3, "roll"), (2, "z"), (4, "pitch")):  # of the tractor's free joint
        plant = bench.plant(flat((30.0, 20.0)))
        plant.reset(0.0, 0.0, 0.0, 1.0)
        plant.data.qvel[dof] += 0.1
        mujoco.mj_step1(plant.model, plant.data)  # pyright: ignore[reportAttributeAccessIssue]
        moved = column(drive(plant, bench.command(1.0), 4.0, 0.01), f"tractor.{name}")
        acceleration = np.gradient(np.gradient(moved))  # as vibrations are measured
        spectrum = np.abs(np.fft.rfft(acceleration[2:], 2**14))
        figures.append(float(spectrum.argmax()) / (2**14 * 0.01))
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


def straight_pass(
    speed: float, seed: int, changes: Sequence[str], length_m: float = 190.0
) -> tuple[Summary, Record]:
    """Drive a straight line east from the middle of `grass` with changes.

    Args:
        speed: along the line [m/s].
        seed: of the run.
        changes: overrides of the scenario.
        length_m: of the line.
    """
    path = f'path={{kind="straight",length_m={length_m},speed_mps={speed}}}'
    field = (f"terrain.size_x_m={2.0 * (length_m + EDGE_M)}", "terrain.size_y_m=20.0")
    return simulate(*load("grass", (*changes, path, *field, *gear(speed))), seed)


def _passes(
    speed: float, *changes: str, seeds: Sequence[int] = SEEDS, length_m: float = 190.0
) -> list[Record]:
    return [straight_pass(speed, seed, changes, length_m)[1] for seed in seeds]


def cross_error(record: Record, point: Point) -> FloatArray:
    """Return the true cross-track errors of a point after the start-up, (n,) [m]."""
    errors = tracking_errors(record)
    return errors.by_point[point].cross_m[errors.time_s >= START_UP_S]


def seen_cross_error(record: Record, body: str) -> FloatArray:
    """Return the errors of body "t" or "i" by the estimate, on a line to the east, (n,) [m]."""
    time_s, rows, line = rows_at_same_time(record, ESTIMATE, REFERENCE)
    offset = record[ESTIMATE][f"y_{body}_m"][rows] - record[REFERENCE][f"y_{body}_m"][line]
    return offset[time_s >= START_UP_S]


def work(machine: Machine) -> list[float]:
    """Return median, sd [%], autocorrelation after 1, 3, 12 s of slip; sd of the tractor [cm]."""
    soil = "soil.random={coefficient_of_variation=0.3,correlation_m=5.0}"  # the defaults
    driven = _passes(_SPEED, *machine.changes(), soil, seeds=range(201, 207))
    passes = [slip_each_second(record) for record in driven]
    slips = 100.0 * np.concatenate(passes)
    memory = [autocorrelation(passes, lag) for lag in (1, 3, 12)]
    guided = np.median([np.std(seen_cross_error(record, "t")) for record in driven])
    return [float(np.median(slips)), float(slips.std()), *memory, 100.0 * float(guided)]


def transport_slip(machine: Machine) -> list[float]:
    """Return the slip of the machine that moves without a tool in the soil [%]."""
    hard = (*machine.changes(tool=False, cone_index=2000.0), 'terrain.iso_class="A"')
    driven = _passes(_SPEED, *hard, seeds=SEEDS[:1])
    return [100.0 * float(np.median(np.concatenate([*map(slip_each_second, driven)])))]


def slip_each_second(record: Record) -> FloatArray:
    """Return the mean slip of the driven wheels in every second after the start-up, (n,)."""
    state = record[STATE]
    counted = state.time_s >= START_UP_S
    slip = 1.0 - state["v_mps"][counted] / state["v_rim_mps"][counted]
    rows = round(1.0 / np.median(np.diff(state.time_s)))  # of a second
    return slip[: len(slip) // rows * rows].reshape(-1, rows).mean(axis=1)


def autocorrelation(passes: list[FloatArray], lag: int) -> float:
    """Return the autocorrelation at a lag [samples] of several series about their common mean."""
    mean = np.mean(np.concatenate(passes))
    centred = [series - mean for series in passes]
    pairs = np.mean(np.concatenate([series[:-lag] * series[lag:] for series in centred]))
    return float(pairs / np.mean(np.square(np.concatenate(centred))))


def slope(machine: Machine) -> list[float]:
    """Return the error of an unsteered tool along a slope over the tractor's, and that [cm]."""
    locked = ('controller.name="pid"', "controller.vehicle.trailer_limit_deg=0.01")
    records = _passes(_SPEED, *machine.changes(), *locked, "terrain.slope_rad=0.1", seeds=SEEDS[:2])
    tool, tractor = (
        float(np.median(np.abs(np.concatenate([cross_error(each, point) for each in records]))))
        for point in ("tool", "tractor")
    )
    return [tool / tractor, 100.0 * tractor]


def implement_steering(machine: Machine) -> list[float]:
    """Return the cross-track sd of the steered trailer by its own position at 15.4 km/h [cm]."""
    return [_steered_sd(machine, 15.4)]


def slow_implement_steering(machine: Machine) -> list[float]:
    """Return the same at the middle of two slower ranges of speeds [cm]."""
    return [_steered_sd(machine, speed_kmh) for speed_kmh in (5.0, 9.0)]


def _steered_sd(machine: Machine, speed_kmh: float) -> float:
    records = _passes(round(speed_kmh / 3.6, 3), *machine.changes(), seeds=SEEDS[:2])
    return 100.0 * float(np.median([np.std(seen_cross_error(each, "i")) for each in records]))


def pass_to_pass(machine: Machine) -> list[float]:
    """Return the 95th percentile of the distance of two passes of the tractor on one line [cm]."""
    hard = (*machine.changes(tool=False, cone_index=2000.0), 'terrain.iso_class="A"')
    one, other = (record[STATE] for record in _passes(2.5, *hard, seeds=SEEDS[:2]))
    counted = one.time_s >= START_UP_S
    x, y = one["x_t_m"][counted], one["y_t_m"][counted]
    apart = np.abs(y - np.interp(x, other["x_t_m"], other["y_t_m"]))
    return [100.0 * float(np.percentile(apart, 95.0))]


def rows(machine: Machine) -> list[float]:
    """Return the spread of straight rows by the positions of the tractor's receiver [cm]."""
    records = _passes(1.0, *machine.changes(tool=False), seeds=SEEDS[:2], length_m=100.0)
    return [100.0 * float(np.mean([np.std(_received(record)) for record in records]))]


def _received(record: Record) -> FloatArray:
    """Return the offsets of the received positions from a line to the east, (n,) [m]."""
    samples = record[MEASUREMENT]
    names = [f"{Sensor.GNSS_TRACTOR}_{part}" for part in ("time_s", "y_m")]
    taken, y = samples.columns(*names)[np.isfinite(samples[names[1]])].T
    return y[taken >= START_UP_S] - record[REFERENCE]["y_t_m"][-1]


Experiment = Callable[[Machine], list[float]]

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
    return beside(name, EXPERIMENTS[name](Machine()))


def _own(runner: Runner) -> list[Evidence]:
    found = runner.map(measure, [*EXPERIMENTS])
    return [item for items in found for item in items]


def constants() -> list[str]:
    """Return the names of the main constants."""
    return [f"{part}.{name}" for part, of in _content()["constants"].items() for name in of]


def wrong_machines() -> list[Machine]:
    """Return the machine with each main constant too small and too large."""
    return [Machine(name, factor) for name in constants() for factor in WRONG]


def turned_out(out: Mapping[Machine, Sequence[int]], refused: Iterable[Machine] = ()) -> str:
    """Return how many rows each constant turns out, and which; last the constants that turn none.

    Args:
        out: numbers of the rows that each machine with a wrong constant turns out.
        refused: machines that nobody can build.
    """
    cells: dict[str, list[str]] = {}
    for machine, rows in out.items():
        text = f"{len(rows)}: {', '.join(map(str, rows))}".rstrip(": ")
        own = cells.setdefault(machine.constant, [f"`{machine.constant}`"])
        own.append("refused" if machine in refused else text)
    heads = ["constant", "30 % too small turns out", "30 % too large"]
    idle = [name for name, *own in cells.values() if own == ["0", "0"]]
    table = markdown(heads, (own for own in cells.values() if own[0] not in idle))
    return f"{table}\n\nNo row: {', '.join(idle)}." if idle else table


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
STUDIES: Final = (Study(name="evidence", make=lambda runner: page(_own(runner)), checks=_CHECKS),)
