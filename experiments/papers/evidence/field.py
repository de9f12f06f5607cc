"""Straight passes of the machine in the field, with its receivers, its filter and its guidance."""

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from ttempc.types import FloatArray, Sensor

from ....testbed.recording.channels import MEASUREMENT, REFERENCE, STATE
from ....testbed.recording.record import Record
from ...results.passes import pass_spreads
from ...results.tracking_errors import START_UP_S, tracking_errors
from ...run.assembly import EDGE_M
from ...run.simulate import simulate
from ...scenario.scenario import load
from ..machine import Constant, settings

SEEDS: Final = range(3001, 3007)
_SPEED: Final = 2.0  # [m/s]; 7.2 km/h
_FRONT_LAG: Final = "vehicle.front_steering.lag_s"
_HARD: Final = (*settings(tool=False, cone_index=2000.0), 'terrain.iso_class="A"')

Point = Literal["tractor", "trailer", "tool"]


def gear(speed: float) -> tuple[str, ...]:
    """Return the settings of the gear in which the farm machine drives a speed [m/s].

    The hydrostat ends at 3.1 m/s in the working gear; the transport gear is assumed to reach 5 m/s.
    """
    fast = ("plant.vehicle.speed_gain_mps=5.0", "controller.vehicle.speed_gain_mps=5.0")
    return fast if speed > 3.0 else ()


def _passes(
    speed: float, *changes: str, seeds: Sequence[int], length_m: float = 190.0
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


def work(wrong: Constant) -> list[float]:
    """Return median, sd [%], autocorrelation after 1, 3, 12 s of slip; sd of the tractor [cm]."""
    length = 5.0 * wrong.of("soil.correlation_m")
    soil = f"soil.random={{coefficient_of_variation=0.3,correlation_m={length}}}"
    driven = _passes(_SPEED, *settings(), soil, seeds=SEEDS)
    passes = [slip_each_second(record) for record in driven]
    slips = 100.0 * np.concatenate(passes)
    memory = [autocorrelation(passes, lag) for lag in (1, 3, 12)]
    guided = 100.0 * float(np.median([_seen_sd(record, "tractor") for record in driven]))
    return [float(np.median(slips)), float(slips.std()), *memory, guided]


def transport_slip(wrong: Constant) -> list[float]:
    """Return the slip of the machine that moves without a tool in the soil [%]."""
    load_kg = 1500.0 * wrong.of("vehicle.load.mass_kg")
    driven = _passes(_SPEED, *_HARD, f"plant.vehicle.load_kg={load_kg}", seeds=SEEDS[:1])
    return [100.0 * float(np.median(np.concatenate([*map(slip_each_second, driven)])))]


def slip_each_second(record: Record) -> FloatArray:
    """Return the mean slip of the driven wheels in each second of driving after start-up, (n,).

    A vehicle that slows down at the end of its line does not count: its rims stand.
    """
    state = record[STATE]
    rim_mps = state["v_rim_mps"]
    counted = (state.time_s >= START_UP_S) & (rim_mps > 0.5 * np.median(rim_mps))
    slip = 1.0 - state["v_mps"][counted] / state["v_rim_mps"][counted]
    rows = round(1.0 / np.median(np.diff(state.time_s)))  # rows in one second
    return slip[: len(slip) // rows * rows].reshape(-1, rows).mean(axis=1)


def autocorrelation(passes: list[FloatArray], lag: int) -> float:
    """Return the autocorrelation at a lag [samples] of several series about their common mean."""
    mean = np.mean(np.concatenate(passes))
    centred = [series - mean for series in passes]
    pairs = np.mean(np.concatenate([series[:-lag] * series[lag:] for series in centred]))
    return float(pairs / np.mean(np.square(np.concatenate(centred))))


def slope(wrong: Constant) -> list[float]:
    """Return the error of an unsteered tool along a slope over the tractor's, and that [cm]."""
    soil = settings(cone_index=900.0 * wrong.of("soil.cone_index_kpa"))
    locked = ('controller.name="pid"', "controller.vehicle.trailer_limit_deg=0.01")
    records = _passes(_SPEED, *soil, *locked, "terrain.slope_rad=0.1", seeds=SEEDS[:2])
    tool, tractor = (
        float(np.median(np.abs(np.concatenate([cross_error(each, point) for each in records]))))
        for point in ("tool", "tractor")
    )
    return [tool / tractor, 100.0 * tractor]


def implement_steering(wrong: Constant) -> list[float]:
    """Return the cross-track sd of the steered trailer by its own position over speed.

    At 15.4 km/h [cm], over those at the middles of two slower ranges of speeds, 9 and 5 km/h, and
    these [cm].
    """
    lag_s = 0.30 * wrong.of("vehicle.trailer_steering.lag_s")
    lag = f"plant.vehicle.parts.trailer_steering.lag_s={lag_s}"
    changes = (*settings(tool=False), lag)

    def spread(speed_kmh: float) -> float:
        records = _passes(round(speed_kmh / 3.6, 3), *changes, seeds=SEEDS[:2])
        return 100.0 * float(np.median([_seen_sd(each, "trailer") for each in records]))

    fast, middle, slow = (spread(speed_kmh) for speed_kmh in (15.4, 9.0, 5.0))
    return [fast, fast / middle, fast / slow, middle, slow]


def _seen_sd(record: Record, body: Point) -> float:
    """Return the standard deviation of a cross-track error as the machine sees it on a pass [m]."""
    _, seen = pass_spreads(record)[1][body]
    return float(np.median(seen))


def pass_to_pass(wrong: Constant) -> list[float]:
    """Return the 95th percentile of the distance of two passes of the tractor on one line [cm]."""
    lag = f"plant.vehicle.parts.front_steering.lag_s={0.20 * wrong.of(_FRONT_LAG)}"
    one, other = (record[STATE] for record in _passes(2.5, *_HARD, lag, seeds=SEEDS[:2]))
    counted = one.time_s >= START_UP_S
    x = one["x_t_m"][counted]
    y = one["y_t_m"][counted]
    apart = np.abs(y - np.interp(x, other["x_t_m"], other["y_t_m"]))
    return [100.0 * float(np.percentile(apart, 95.0))]


def rows(wrong: Constant) -> list[float]:
    """Return the spread of straight rows by the positions of the tractor's receiver [cm]."""
    lag = f"plant.vehicle.parts.front_steering.lag_s={0.20 * wrong.of(_FRONT_LAG)}"
    records = _passes(1.0, *settings(tool=False), lag, seeds=SEEDS[:2], length_m=100.0)
    return [100.0 * float(np.mean([np.std(_received(record)) for record in records]))]


def _received(record: Record) -> FloatArray:
    """Return the offsets of the received positions from a line to the east, (n,) [m]."""
    samples = record[MEASUREMENT]
    names = [f"{Sensor.GNSS_TRACTOR}_{part}" for part in ("time_s", "y_m")]
    taken, y = samples.columns(*names)[np.isfinite(samples[names[1]])].T
    return y[taken >= START_UP_S] - record[REFERENCE]["y_t_m"][-1]
