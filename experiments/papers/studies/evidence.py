"""Published figures of real machines beside those of this plant, which is tuned for none.

`evidence.toml` has the published figures and how ours are made; the functions here measure ours.
"""

import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from ttempc.types import FloatArray, Sensor

from ....testbed.ground.soil import SoilMap
from ....testbed.ground.terrain import flat
from ....testbed.recording.channels import ESTIMATE, MEASUREMENT, REFERENCE, STATE, TOOL
from ....testbed.recording.record import Record
from ....testbed.truth import WHEELS
from ....testbed.validation.bench import DRIVEN, FIRM_KPA, Bench, steps
from ....testbed.validation.check import Check, between, number
from ....testbed.validation.validate import validate
from ....testbed.vehicle.servos import tyres_of
from ....testbed.vehicle.vehicle import read_vehicle
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

Figure = float | tuple[float, str]
"""A figure of ours, with a note on it if there is one."""

ASSUMED: Final = "the source states no spread: ± 25 %, assumed"


@dataclass(frozen=True, kw_only=True, slots=True)
class Evidence:
    """A figure of the plant, the band of the published one, and the reason where it is outside."""

    name: str
    figure: float  # ours [unit]; NaN: none
    unit: str
    band: tuple[float, float]  # of the published figure
    published: str  # as the source states it
    rule: str = ASSUMED  # where the band comes from
    source: str
    method: str  # what was driven: scenario, settings, seeds
    below: str = "unknown"  # reason, shown where our figure is below the band
    above: str = "unknown"  # reason, shown where it is above, or without a figure
    note: str = ""

    @property
    def verdict(self) -> str:
        """Place of our figure against the band."""
        if math.isnan(self.figure):
            return "no figure"
        low, high = self.band
        return "below" if self.figure < low else "above" if self.figure > high else "in band"

    @property
    def reason(self) -> str:
        """Physical reason of a figure outside the band, "unknown" where we have none, else ""."""
        verdict = self.verdict
        return "" if verdict == "in band" else self.below if verdict == "below" else self.above

    @property
    def cells(self) -> list[str]:
        """Cells of the table: figure, published, band, ours, verdict."""
        ours = f"{number(float(f'{self.figure:.3g}'))} {self.unit}".rstrip()
        band = between("", self.figure, *self.band, self.unit, "").expectation
        return [
            self.name,
            self.published,
            f"{band} {self.unit}".rstrip(),
            "–" if math.isnan(self.figure) else ours,
            self.verdict if self.verdict == "in band" else f"**{self.verdict}**",
        ]


@cache
def _published() -> dict[str, list[dict[str, Any]]]:
    """Return the published figures of each experiment."""
    content = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return {
        name: [{**table, **figure} for figure in table.pop("figures")]
        for name, table in content.items()
    }


def beside(name: str, figures: Sequence[Figure]) -> list[Evidence]:
    """Return the figures of an experiment, in the order of the file, beside the published ones."""
    pairs = [item if isinstance(item, tuple) else (item, "") for item in figures]
    return [
        Evidence(**table, figure=figure, note=note)
        for table, (figure, note) in zip(_published()[name], pairs, strict=True)
    ]


def page(items: Sequence[Evidence]) -> str:
    """Return how many figures are inside their bands, the table, and how they were made."""
    held = sum(item.verdict == "in band" for item in items)
    sources = len({item.source for item in items})
    numbered = list(enumerate(items, 1))
    heads = ["", "figure", "published", "band", "ours", "verdict"]
    notes = groupby(numbered, lambda pair: (pair[1].source, pair[1].method))
    return "\n\n".join(
        [
            f"{held} of {len(items)} figures from {sources} sources are inside their bands.",
            markdown(heads, [[str(k), *item.cells] for k, item in numbered]),
            *(_note(list(group)) for _, group in notes),
        ]
    )


def _note(group: list[tuple[int, Evidence]]) -> str:
    """Return how a run of figures with one source and method was made."""
    (first, item), (last, _) = group[0], group[-1]
    place = f"{first}" if first == last else f"{first} to {last}"
    lines = [f"**{place}.** {item.source.rstrip('.')}. Ours: {item.method}.", ""]
    for what, of in (("Band of", "rule"), ("Of", "note"), ("Outside,", "reason")):
        for text, members in groupby(group, lambda pair, of=of: getattr(pair[1], of)):
            listed = ", ".join(str(k) for k, _ in members)
            lines += [f"- {what} {listed}: {text}."] if text else []
    return "\n".join(lines)


# Wheels on soil.

SOILS: Final = {"soft or sandy": 20.0, "tilled": 40.0, "firm": 55.0, "hard": 80.0}
"""Mobility numbers of driven wheels by which ASABE D497 names soils, from secondary sources."""

_REAR: Final = WHEELS.index("rear_left")


def farm(mass: float = 1.0) -> Bench:
    """Return the farm machine on firm, level ground, the tractor's mass times a factor."""
    vehicle = read_vehicle("farm4500")
    tractor = replace(vehicle.tractor, mass_kg=mass * vehicle.tractor.mass_kg)
    return Bench(replace(vehicle, tractor=tractor), flat((300.0, 60.0)), SoilMap(FIRM_KPA))


def side_ratio(slip_angle: float, slip: float, bn: float) -> float:
    """Return side force over load of the farm machine's rear wheel in steady rolling.

    Args:
        slip_angle: of the wheel [rad].
        slip: driving positive.
        bn: mobility number of the wheel, at its rated load.
    """
    law = SoilLaw(tyre="radial")
    bn_area, m_area = tyres_of(farm().vehicle).mobility_areas(law)[_REAR]
    numbers, m = np.array([bn]), np.array([bn * m_area / bn_area])
    # the slip angle of the law refers to the speed of travel, or of sliding where it is larger
    travel = max(math.cos(slip_angle), math.cos(slip_angle) * slip / (1.0 - slip))
    angle = np.arctan(np.array([math.sin(slip_angle) / travel]))
    return float(law.combined_ratios(numbers, m, slip, angle)[1][0])


def combined_slip() -> list[Figure]:
    """Return the loss of side force by longitudinal slip at 15 and 30 degrees [%]."""
    figures: list[Figure] = []
    for degrees, slip in ((15.0, 0.23), (15.0, 0.50), (30.0, 0.23), (30.0, 0.50)):
        free, loaded = (
            side_ratio(math.radians(degrees), each, SOILS["soft or sandy"]) for each in (0.0, slip)
        )
        note = f"side force over load {abs(free):.2f} without slip, {abs(loaded):.2f} with it"
        figures.append((100.0 * (1.0 - loaded / free), note))
    return figures


def best_slip() -> list[Figure]:
    """Return the slip at best tractive efficiency on the four surfaces of the source [%]."""
    checks = [_efficiency(farm(), bn)[1] for bn in SOILS.values()]
    return [(check.figure or math.nan, check.note) for check in checks]


def second_pass() -> list[Figure]:
    """Return the gain of best tractive efficiency of wheels that run in a rut [%]."""
    rut = replace(farm(), wheel_law=SoilLaw(second_pass=True))
    first, second = (_best(_efficiency(each, SOILS["tilled"])[0]) for each in (farm(), rut))
    return [(100.0 * (second / first - 1.0), f"efficiency {first:.3f} and {second:.3f}")]


def _efficiency(bench: Bench, bn: float) -> list[Check]:
    """Return the checks of tractive efficiency on soil of a mobility number of driven wheels."""
    plant = bench.plant(flat((20.0, 10.0)))
    load = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    per_kpa = tyre.mobility(bench.wheel_law, plant.tyres, load, np.ones(len(WHEELS)))[0]
    soil = replace(bench.soil, background=bn / float(per_kpa[DRIVEN].mean()))
    return [*validate(replace(bench, soil=soil), ("tractive efficiency",))]


def _best(check: Check) -> float:
    """Return the largest measured efficiency of a check's chart."""
    assert check.chart is not None
    return float(check.chart.lines[0].y.max())


# Handling of the farm machine on a firm, level plane.

_FREQUENCY_HZ: Final = 0.2
_AMPLITUDE: Final = math.radians(4.0)


def yaw_gain(bench: Bench, speed: float, periods: int = 3) -> float:
    """Return the amplitude of the yaw rate over that of v tan(delta) / L, sinusoidal steering."""
    plant = bench.plant(bench.terrain)
    plant.reset(-140.0, 0.0, 0.0, speed)
    every, period, rows = 0.05, 1.0 / _FREQUENCY_HZ, []
    for k in range(round((periods + 1) * period / every)):
        phase = 2.0 * math.pi * _FREQUENCY_HZ * k * every
        command = bench.command(speed, delta_t=_AMPLITUDE * math.sin(phase))
        truth = plant.advance(command, steps(plant, every))
        ackermann = truth.speed * math.tan(truth.delta_t) / bench.nominal.wheelbase
        rows.append((truth.yaw_rate_t, ackermann))
    steady = np.array(rows[round(period / every) :])  # the first period is the transient
    angles = 2.0 * math.pi * _FREQUENCY_HZ * every * np.arange(len(steady))
    yaw, ackermann = np.abs(np.exp(-1j * angles) @ steady)
    return float(yaw / ackermann)


def yaw_response() -> list[Figure]:
    """Return how far the response of the yaw rate depends on weight and on speed [%]."""
    by_mass = [yaw_gain(farm(mass), 2.8) for mass in (0.75, 1.0, 1.25)]
    by_speed = [yaw_gain(farm(), speed) for speed in (0.7, 1.4, 2.8)]
    return [
        (
            100.0 * (max(gains) - min(gains)) / float(np.mean(gains)),
            "gains over Ackermann " + ", ".join(f"{gain:.3f}" for gain in gains),
        )
        for gains in (by_mass, by_speed)
    ]


# Straight passes of the farm machine.

SEEDS: Final = range(201, 204)  # smaller ones are for tuning
FIELD_SENSORS: Final = ('sensors.preset="field"',)
FARM: Final = ('plant.vehicle.file="farm4500"', "soil.cone_index_kpa=900.0")  # as in `farm`
# As wide as the machine, at a usual depth.
FARM_TOOL: Final = (*FARM, 'implement={type="field-cultivator",width_m=2.0,depth_m=0.10}')
LONGEST_M: Final = 190.0  # straight line from the middle of the largest field
_SPEED: Final = 2.0  # [m/s]; 7.2 km/h

Point = Literal["tractor", "trailer", "tool"]


def gear(speed: float) -> tuple[str, ...]:
    """Return the settings of the gear in which the farm machine drives a speed [m/s].

    The hydrostat ends at 3.1 m/s in the working gear; the transport gear is assumed to reach 5 m/s.
    """
    fast = ("plant.vehicle.speed_gain_mps=5.0", "controller.vehicle.speed_gain_mps=5.0")
    return fast if speed > 3.0 else ()


def straight_pass(
    speed: float, seed: int, changes: Sequence[str], length_m: float = LONGEST_M
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
    return simulate(*load("grass", (path, *field, *gear(speed), *changes)), seed)


def _passes(speed: float, *changes: str, seeds: Sequence[int] = SEEDS) -> list[Record]:
    return [straight_pass(speed, seed, changes)[1] for seed in seeds]


def cross_error(record: Record, point: Point) -> FloatArray:
    """Return the true cross-track errors of a point after the start-up, (n,) [m]."""
    errors = tracking_errors(record)
    return errors.by_point[point].cross_m[errors.time_s >= START_UP_S]


def seen_cross_error(record: Record) -> FloatArray:
    """Return the trailer's cross-track errors by the estimate, on a line to the east, (n,) [m]."""
    time_s, rows, line = rows_at_same_time(record, ESTIMATE, REFERENCE)
    offset = record[ESTIMATE]["y_i_m"][rows] - record[REFERENCE]["y_i_m"][line]
    return offset[time_s >= START_UP_S]


def working_slip(seeds: Sequence[int] = range(201, 207)) -> list[Figure]:
    """Return the slip of a tractor at work: median and sd [%], autocorrelation after 1, 3, 12 s."""
    soil = "soil.random={coefficient_of_variation=0.3,correlation_m=5.0}"  # the defaults
    driven = _passes(_SPEED, *FARM_TOOL, *FIELD_SENSORS, soil, seeds=seeds)
    passes = [slip_each_second(record) for record in driven]
    slips = 100.0 * np.concatenate(passes)
    memory = [autocorrelation(passes, lag) for lag in (1, 3, 12)]
    return [(float(np.median(slips)), f"{len(slips)} rows"), float(slips.std()), *memory]


def transport_slip() -> list[Figure]:
    """Return the slip of the machine that moves without a tool in the soil [%]."""
    hard = ("soil.cone_index_kpa=2000.0", 'terrain.iso_class="A"')
    driven = _passes(_SPEED, FARM[0], *hard, *FIELD_SENSORS)
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


def tool_forces(seeds: Sequence[int] = SEEDS) -> list[Figure]:
    """Return the mean draft of the tool [N], and its side force by slip angle [N/deg]."""
    records = _passes(_SPEED, *FARM_TOOL, *FIELD_SENSORS, seeds=seeds)
    drafts = [record[TOOL]["draft_n"][record[TOOL].time_s >= START_UP_S] for record in records]
    stiffness = np.mean([side_stiffness(record) for record in records])
    return [float(np.mean([draft.mean() for draft in drafts])), float(stiffness)]


def side_stiffness(record: Record) -> float:
    """Return the side force of a tool per slip angle of its point, by least squares [N/deg]."""
    time_s, tool, state = rows_at_same_time(record, TOOL, STATE)
    yaw = record[STATE]["psi_i_rad"][state]
    vx, vy = (np.gradient(record[TOOL][name][tool], time_s) for name in ("x_m", "y_m"))
    sideways, ahead = vy * np.cos(yaw) - vx * np.sin(yaw), vx * np.cos(yaw) + vy * np.sin(yaw)
    counted = time_s >= START_UP_S
    angle = np.degrees(np.arctan2(sideways, ahead))[counted]
    side = record[TOOL]["side_n"][tool][counted]
    return float(-(side @ angle) / (angle @ angle))


def unsteered_tool(
    slope: float = 0.10,
    sensors: Sequence[str] = FIELD_SENSORS,
    seeds: Sequence[int] = SEEDS,
) -> list[Figure]:
    """Return the errors of a guided tractor and of its unsteered tool along a side slope [cm]."""
    locked = ('controller.name="pid"', "controller.vehicle.trailer_limit_deg=0.01")
    changes = (*FARM_TOOL, *sensors, *locked, f"terrain.slope_rad={slope}")
    records = _passes(_SPEED, *changes, seeds=seeds)
    points: tuple[Point, ...] = ("tractor", "tool")
    errors = (np.concatenate([cross_error(each, point) for each in records]) for point in points)
    return [100.0 * float(np.median(np.abs(error))) for error in errors]


def implement_steering() -> list[Figure]:
    """Return the cross-track sd of the steered trailer at the speeds of CNH's records [cm]."""
    figures: list[Figure] = []
    for speed_kmh in (5.0, 9.0, 15.0):  # middle of each range
        records = _passes(round(speed_kmh / 3.6, 3), *FARM_TOOL, *FIELD_SENSORS)
        seen = np.median([np.std(seen_cross_error(record)) for record in records])
        true = np.median([np.std(cross_error(record, "tool")) for record in records])
        note = f"the true position of the tool has {100.0 * true:.1f} cm"
        figures.append((100.0 * float(seen), note))
    return figures


def steered_joint() -> list[Figure]:
    """Return the lateral error of a steered joint at 12 km/h, on passes and on curves [cm]."""
    speed = round(12.0 / 3.6, 3)
    places = [[straight_pass(speed, seed, (*FARM, *FIELD_SENSORS)) for seed in SEEDS]]
    eight = (f"path.speed_mps={speed}", *gear(speed), *FIELD_SENSORS)
    for name in ("ttempc", "pid"):
        _, scenario = load("farm", (*eight, f'controller.name="{name}"'))
        places.append([simulate("farm", scenario, seed) for seed in SEEDS])
    figures: list[Figure] = []
    for driven in places:
        failures = sorted({run.failure for run, _ in driven if run.failure})
        errors = np.abs(np.concatenate([cross_error(record, "trailer") for _, record in driven]))
        figures.append(
            (math.nan, f"lost: {'; '.join(failures)}")
            if failures
            else 100.0 * float(np.percentile(errors, 95.0))
        )
    return figures


def receivers(seeds: Sequence[int] = SEEDS) -> list[Figure]:
    """Return the error of RTK receivers, and the spread of straight rows that they guide [cm]."""
    rows = _passes(1.0, *FARM, *FIELD_SENSORS, seeds=seeds)
    still = _passes(1.0, *FARM, *FIELD_SENSORS, 'sensors.gnss_antenna="point"', seeds=seeds)
    errors = [np.concatenate([*map(receiver_error, records)]) for records in (still, rows)]
    spread = np.mean([np.std(cross_error(row, "tractor")) for row in rows])
    rms = [100.0 * float(np.sqrt(np.mean(np.square(error)))) for error in errors]
    return [*rms, 100.0 * float(spread)]


def receiver_error(record: Record) -> FloatArray:
    """Return horizontal errors of the tractor's positions at the times of their samples, (n,) [m].

    Times of delivery and of samples differ by the latency.
    """
    state, samples = record[STATE], record[MEASUREMENT]
    names = [f"{Sensor.GNSS_TRACTOR}_{part}" for part in ("time_s", "x_m", "y_m")]
    taken, x, y = samples.columns(*names)[np.isfinite(samples[names[1]])].T
    true = (np.interp(taken, state.time_s, state[name]) for name in ("x_t_m", "y_t_m"))
    return np.hypot(*(given - actual for given, actual in zip((x, y), true, strict=True)))


EXPERIMENTS: Final[dict[str, Callable[[], list[Figure]]]] = {
    experiment.__name__: experiment
    for experiment in (
        combined_slip,
        best_slip,
        second_pass,
        working_slip,
        transport_slip,
        tool_forces,
        unsteered_tool,
        yaw_response,
        implement_steering,
        steered_joint,
        receivers,
    )
}
"""By the name of their table, in the order of the page."""


def measure(name: str) -> list[Evidence]:
    """Return the figures of an experiment beside the published ones."""
    return beside(name, EXPERIMENTS[name]())


def _page(runner: Runner) -> str:
    return page([item for items in runner.map(measure, [*EXPERIMENTS]) for item in items])


STUDIES: Final = (
    Study(
        name="evidence",
        make=_page,
        checks=(("farm", "ttempc"), ("cultivate", "ttempc"), ("grass", "ttempc")),
    ),
)
