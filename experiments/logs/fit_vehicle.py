"""Fit of a vehicle to a log: lengths, actuators, sensors and slip, each with a standard deviation.

Lengths come from the innovations of the filter (`ttempc.learning.lengths`), dead times and lags
from the responses to the commands (`ttempc.learning.actuators`): the identifiers of a run, on the
whole log. Regressions on the samples give the rest. A quantity whose samples or commands the log
lacks is left out, and said.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
import tomli_w

from ttempc.estimation.noise import ProcessNoise, SensorNoise
from ttempc.learning.actuators import fit_actuator
from ttempc.learning.learner import LENGTHS
from ttempc.learning.lengths import likely_lengths
from ttempc.learning.window import RecordedTick
from ttempc.types import FloatArray, Input
from ttempc.vehicle import Vehicle

from ...testbed.recording.channels import CONTROL, MEASUREMENT, STATE
from ...testbed.recording.record import NOT_MEASURED_KEY, Record
from ..errors import InvalidReplay
from ..scenario.scenario import Scenario
from .replay import ticks

_PRIOR_SD: Final = 0.2  # of each length, relative; assumed
_BLOCK_S: Final = 5.0  # over which errors of a mean are correlated; as of `fit_lengths`
_STEP_S: Final = 0.002  # default step of the physics
_MOVING_MPS: Final = 0.3
_START_S: Final = 8.0  # left out: a start is no steady motion
_SHORT_S: Final = 30.0  # of a log below which nothing is fitted


@dataclass(frozen=True, slots=True)
class Fitted:
    """Value of one parameter and the standard deviation of its error."""

    key: str  # with its unit
    value: float
    sd: float
    places: tuple[str, ...] = ()  # dotted keys of a scenario that it fills; none: it is told only

    def __str__(self) -> str:
        return f"{self.key:<32}{self.value:>10.4g} +- {self.sd:.2g}"


@dataclass(frozen=True, slots=True)
class VehicleFit:
    """Parameters that fit a log best."""

    parameters: tuple[Fitted, ...]
    vehicle: Vehicle  # the model with them
    missing: tuple[str, ...]  # what could not be fitted, and why

    def to_toml(self, vehicle_file: str, source: str) -> str:
        """Return the tables of a scenario with the parameters, and a table `fit` of all of them."""
        content: dict[str, Any] = {"plant": {"vehicle": {"file": vehicle_file}}}
        for parameter in self.parameters:
            for place in parameter.places:
                value = float(f"{parameter.value:.6g}")
                if place.startswith("actuators."):  # of whole steps of the physics
                    value = round(round(value / _STEP_S) * _STEP_S, 6)
                _put(content, place.split("."), value)
        content["fit"] = {
            item.key: {"value": item.value, "sd": item.sd} for item in self.parameters
        }
        return f"# Fitted to {source} by `ttempc fit vehicle`\n{tomli_w.dumps(content)}"

    def to_json(self) -> str:
        """Return the parameters as JSON."""
        rows = [asdict(item) for item in self.parameters]
        return json.dumps({"parameters": rows, "missing": self.missing}, indent=2) + "\n"


def _put(content: dict[str, Any], keys: Sequence[str], value: float) -> None:
    for key in keys[:-1]:
        content = content.setdefault(key, {})
    content[keys[-1]] = value


# Key, field of `Vehicle`, and places of a scenario, for the parameters of the model.
_LENGTH_PLACES: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "wheelbase": (
        "wheelbase_m",
        ("plant.vehicle.parts.tractor.wheelbase_m", "controller.vehicle.wheelbase_m"),
    ),
    "hitch_offset": (
        "hitch_offset_m",
        ("plant.vehicle.hitch_offset_m", "controller.vehicle.hitch_offset_m"),
    ),
    "drawbar_length": ("drawbar_m", ("plant.vehicle.drawbar_m", "controller.vehicle.drawbar_m")),
    "trailer_length": ("trailer_m", ("plant.vehicle.trailer_m", "controller.vehicle.trailer_m")),
}
_ACTUATORS: Final = {
    Input.DELTA_T: ("front", "steering_lag_t", "dead_time_t", "steering_tractor"),
    Input.DELTA_I: ("trailer", "steering_lag_i", "dead_time_i", "steering_trailer"),
    Input.HP: ("hydrostat", "speed_time_constant", "dead_time_hp", "encoder"),
}
# Mean product of relative errors of the lengths of largest likelihood, in the order of `LENGTHS`:
# of 18 simulated vehicles drawn within 30 % on `grass` (tests/experiments/logs/drawn_vehicles.py,
# seeds 1001 to 1021, three of which were lost). Trailers that slip outwards pass for other lengths.
_SYSTEMATIC: Final = (
    (0.0033, 0.0664, -0.0188, -0.0038),
    (0.0664, 1.6992, -0.4903, -0.0912),
    (-0.0188, -0.4903, 0.1437, 0.0250),
    (-0.0038, -0.0912, 0.0250, 0.0057),
)
_LARGEST_SD_S: Final = 0.1  # of a dead time that counts as known, as in a run
# Errors of the same runs that the deviations of the regressions do not have in them
_DEAD_TIME_SD_S: Final = 0.009
_DEAD_TIME_BY_LAG_SD_S: Final = 0.015  # where the lag stays as given
_LAG_SD_S: Final = 0.010
_GAIN_SD: Final = 0.013  # relative
_SLIP_SD_PCT: Final = 0.3
_OFFSET_SD_DEG: Final = 0.1
_RATIO_SD: Final = 0.03  # a command that moves slowly is not steady
_NEEDED: Final = ("gnss_trailer", "steering_tractor", "steering_trailer", "hitch")


def fit_vehicle(record: Record, scenario: Scenario) -> VehicleFit:
    """Return the parameters that fit a log best.

    Args:
        record: of a run or of an import, with samples and estimates.
        scenario: of the log: the vehicle at which the search starts and about which lengths have a
            prior of 20 %, and the noise of its sensors.

    Raises:
        InvalidReplay: the log is too short.
    """
    window = list(ticks(record))
    if not window or window[-1].time_s - window[0].time_s < _SHORT_S:
        raise InvalidReplay(f"record: a fit needs {_SHORT_S:g} s of driving or more")
    not_measured = record.metadata.get(NOT_MEASURED_KEY, "").split(", ")
    start = scenario.vehicles().model
    noise = scenario.controller.noise.sensor_noise(scenario.sensors)
    fitted: list[Fitted] = []
    missing: list[str] = []

    vehicle = start
    actuators, vehicle = _fit_actuators(window, vehicle, not_measured, missing)
    fitted += actuators
    lacking = [name for name in _NEEDED if name in not_measured]
    if lacking:
        missing.append(f"lengths: the log has no {', '.join(lacking)}")
    else:
        lengths, vehicle = _fit_lengths(window, vehicle, start, noise, missing)
        fitted += lengths
    for name, fit in (
        ("steering offset", _steering_offset),
        ("steering ratio", _steering_ratio),
        ("speed gain", _speed_gain),
        ("noise", _noise),
        ("wheel slip", _wheel_slip),
    ):
        found = fit(record, not_measured)
        if found:
            fitted += found
            for item in found:
                if item.key == "speed_gain_mps":
                    vehicle = replace(vehicle, speed_gain=item.value)
        else:
            missing.append(f"{name}: the log has too few samples or commands of it")
    return VehicleFit(tuple(fitted), vehicle, tuple(missing))


def _fit_actuators(
    window: Sequence[RecordedTick],
    vehicle: Vehicle,
    not_measured: Sequence[str],
    missing: list[str],
) -> tuple[list[Fitted], Vehicle]:
    """Return dead times and lags, and the vehicle with them."""
    fitted = []
    for actuator, (name, lag_field, dead_field, sensor) in _ACTUATORS.items():
        commands = [tick.command for tick in window if tick.command is not None]
        known = [c for c in commands if math.isfinite(c.as_array()[actuator])]
        if sensor in not_measured or len(known) < 10:
            missing.append(f"{name}: the log has no command, or no samples of {sensor}")
            continue
        fit = fit_actuator(window, vehicle, actuator)
        if fit is None or not fit.dead_time_sd < _LARGEST_SD_S:
            missing.append(f"{name}: its commands change too little")
            continue
        model = f"controller.vehicle.{name}"
        beside = _DEAD_TIME_SD_S if fit.lag_sd > 0.0 else _DEAD_TIME_BY_LAG_SD_S
        fitted.append(
            Fitted(
                f"{name}_dead_time_s",
                fit.dead_time,
                math.hypot(fit.dead_time_sd, beside),
                (f"actuators.{name}.dead_time_s", f"{model}_dead_time_s"),
            )
        )
        vehicle = replace(vehicle, **{dead_field: min(fit.dead_time, 2.0)})
        if fit.lag_sd > 0.0:
            key = "speed_time_constant_s" if actuator == Input.HP else f"{name}_lag_s"
            part = f"plant.vehicle.parts.{name}_steering.lag_s"
            places = (
                (f"plant.vehicle.{key}", f"controller.vehicle.{key}")
                if actuator == Input.HP
                else (part, f"controller.vehicle.{key}")
            )
            fitted.append(Fitted(key, fit.lag, math.hypot(fit.lag_sd, _LAG_SD_S), places))
            vehicle = replace(vehicle, **{lag_field: fit.lag})
    return fitted, vehicle


def _fit_lengths(
    window: Sequence[RecordedTick],
    vehicle: Vehicle,
    given: Vehicle,
    noise: SensorNoise,
    missing: list[str],
) -> tuple[list[Fitted], Vehicle]:
    """Return the lengths, and the vehicle with them.

    The lengths l of largest likelihood with covariance C meet a prior N(l_0, P_0) at those given,

        P = (P_0^-1 + (C + T)^-1)^-1,   l_fit = P (P_0^-1 l_0 + (C + T)^-1 l),

    where T is what no length describes: tyres that slip sideways, offsets of the angle sensors.
    """
    found = likely_lengths(window, vehicle, noise, ProcessNoise.of(vehicle))
    if found is None:
        missing.append("lengths: the search does not converge; curves to both sides are needed")
        return [], vehicle
    likely, covariance = found
    mean = np.array([getattr(given, name) for name in LENGTHS])
    systematic = np.array(_SYSTEMATIC) * np.outer(mean, mean)
    of_prior = np.diag((_PRIOR_SD * mean) ** -2.0)
    of_data = np.linalg.inv(covariance + systematic)
    spread = np.linalg.inv(of_prior + of_data)
    lengths = spread @ (of_prior @ mean + of_data @ likely)
    sds = np.sqrt(np.diag(spread)).tolist()
    values = lengths.tolist()
    fitted = [
        Fitted(*(_LENGTH_PLACES[name][0], value, sd, _LENGTH_PLACES[name][1]))
        for name, value, sd in zip(LENGTHS, values, sds, strict=True)
    ]
    return fitted, replace(vehicle, **dict(zip(LENGTHS, values, strict=True)))


def _block_mean(times: FloatArray, values: FloatArray) -> tuple[float, float] | None:
    """Return a mean and its standard deviation from the means of blocks; None for few blocks."""
    block = ((times - times[0]) // _BLOCK_S).astype(int) if len(times) else np.zeros(0, int)
    means = np.array([values[block == k].mean() for k in np.unique(block)])
    if len(means) < 4:
        return None
    return float(values.mean()), float(means.std(ddof=1) / math.sqrt(len(means)))


def _steering_offset(record: Record, not_measured: Sequence[str]) -> list[Fitted]:
    """Return the measured front steering angle of a tractor that drives straight on.

    It is the intercept of the measured angle over the curvature, yaw rate over speed. Side slip is
    in it; on curves to both sides it cancels.
    """
    if "steering_tractor" in not_measured:
        return []
    times, angle = _sensor(record, "steering_tractor_rad")
    state = record[STATE]
    speed = np.interp(times, state.time_s, state["v_mps"])
    yaw_rate = np.interp(times, state.time_s, state["yaw_rate_t_radps"])
    kept = (np.abs(speed) > _MOVING_MPS) & (times > _START_S)
    if kept.sum() < 50:
        return []
    curvature = yaw_rate[kept] / speed[kept]
    slope = np.cov(curvature, angle[kept])[0, 1] / np.var(curvature, ddof=1)
    found = _block_mean(times[kept], np.degrees(angle[kept] - slope * curvature))
    if not found:
        return []
    offset, sd = found
    return [Fitted("front_offset_deg", offset, math.hypot(sd, _OFFSET_SD_DEG))]


def _steering_ratio(record: Record, not_measured: Sequence[str]) -> list[Fitted]:
    """Return the measured front steering angle for a degree of the command in steady motion."""
    if "steering_tractor" in not_measured:
        return []
    times, angle = _sensor(record, "steering_tractor_rad")
    command = _command_at(record, "delta_t_rad_command", times)
    changes = np.abs(np.gradient(command)) if len(command) > 2 else command
    kept = np.isfinite(command) & (changes < math.radians(0.5)) & (times > _START_S)
    if kept.sum() < 50 or np.ptp(command[kept]) < math.radians(4.0):
        return []
    found = _slope("front_ratio", times[kept], command[kept], angle[kept])
    return [replace(item, sd=math.hypot(item.sd, _RATIO_SD)) for item in found]


def _slope(key: str, times: FloatArray, x: FloatArray, y: FloatArray) -> list[Fitted]:
    """Return the slope of y = offset + slope x, with a deviation from the scores of blocks."""
    centred = x - x.mean()
    power = float(centred @ centred)
    slope = float(centred @ y) / power
    residual = y - y.mean() - slope * centred
    block = ((times - times[0]) // _BLOCK_S).astype(int)
    scores = np.array([centred[block == k] @ residual[block == k] for k in np.unique(block)])
    if len(scores) < 4:
        return []
    return [Fitted(key, slope, float(np.sqrt(scores @ scores)) / power)]


def _speed_gain(record: Record, not_measured: Sequence[str]) -> list[Fitted]:
    """Return the speed at hydrostat position 1, from the means of speed and position."""
    if "encoder" in not_measured:
        return []
    times, speed = _sensor(record, "encoder_mps")
    position = _command_at(record, "hp_command", times)
    kept = np.isfinite(position) & (np.abs(speed) > _MOVING_MPS) & (times > _START_S)
    found = _block_mean(times[kept], speed[kept] / np.where(position[kept], position[kept], np.nan))
    if not found or not math.isfinite(found[0]):
        return []
    places = ("plant.vehicle.speed_gain_mps", "controller.vehicle.speed_gain_mps")
    gain, sd = found
    return [Fitted("speed_gain_mps", gain, math.hypot(sd, _GAIN_SD * gain), places)]


def _noise(record: Record, not_measured: Sequence[str]) -> list[Fitted]:
    """Return the white noise of the sensors, from third differences of their samples.

    Third differences of white noise have 20 times its variance; those of a motion that lasts longer
    than a few samples are small. Noise that is correlated over more than a few samples, as that of
    receivers under trees, is not seen.
    """
    fitted = []
    for key, sensor, fields, unit in (
        ("gnss_white_sd_m", "gnss_tractor", ("gnss_tractor_x_m", "gnss_tractor_y_m"), 1.0),
        ("hitch_white_sd_deg", "hitch", ("hitch_rad",), math.degrees(1.0)),
        ("encoder_white_sd_mps", "encoder", ("encoder_mps",), 1.0),
    ):
        if sensor in not_measured:
            continue
        squares = []
        for field in fields:
            _, values = _sensor(record, field)
            squares.append(np.diff(values, 3) ** 2 / 20.0)
        all_squares = np.concatenate(squares) if squares else np.zeros(0)
        if len(all_squares) < 50:
            continue
        # squares of neighbours share samples: a fifth of them counts
        variance = float(np.median(all_squares) / 0.4549)
        sd = unit * math.sqrt(variance)
        fitted.append(Fitted(key, sd, sd * math.sqrt(1.36 / (0.2 * len(all_squares)))))
    return fitted


def _wheel_slip(record: Record, not_measured: Sequence[str]) -> list[Fitted]:
    """Return the mean slip of the rear wheels, 1 - ground speed / rim speed, by distances."""
    if "encoder" in not_measured:
        return []
    times, rim = _sensor(record, "encoder_mps")
    at_s, x_m = _sensor(record, "gnss_tractor_x_m")
    _, y_m = _sensor(record, "gnss_tractor_y_m")
    if len(at_s) < 20:
        return []
    rolled = np.concatenate([[0.0], np.cumsum(0.5 * (rim[1:] + rim[:-1]) * np.diff(times))])
    block_s = np.arange(max(at_s[0], times[0], _START_S), min(at_s[-1], times[-1]), 1.0)
    east = np.diff(np.interp(block_s, at_s, x_m))
    north = np.diff(np.interp(block_s, at_s, y_m))
    ground = np.hypot(east, north)
    wheel = np.abs(np.diff(np.interp(block_s, times, rolled)))
    kept = wheel > _MOVING_MPS
    if kept.sum() < 20:
        return []
    # chords of curves are shorter than their arcs by (turned angle)^2 / 24
    state = record[STATE]
    heading = np.interp(block_s, state.time_s, np.unwrap(state["psi_t_rad"]))
    ground = ground * (1.0 + np.diff(heading) ** 2 / 24.0)
    found = _block_mean(block_s[1:][kept], ground[kept] / wheel[kept])
    if not found:
        return []
    rolling, sd = found
    slip_pct = 100.0 * (1.0 - rolling)
    return [Fitted("wheel_slip_pct", slip_pct, math.hypot(100.0 * sd, _SLIP_SD_PCT))]


def _sensor(record: Record, field: str) -> tuple[FloatArray, FloatArray]:
    """Return times and values of the samples of a sensor."""
    table = record[MEASUREMENT]
    name = field.rsplit("_", 2)[0] if field.startswith("gnss") else field.rsplit("_", 1)[0]
    values = table[field]
    times = table[f"{name}_time_s"]
    kept = np.isfinite(values) & np.isfinite(times)
    times, first = np.unique(times[kept], return_index=True)
    return times, values[kept][first]


def _command_at(record: Record, field: str, times: FloatArray) -> FloatArray:
    """Return the command in force at times, NaN before the first."""
    table = record[CONTROL]
    if not len(table):
        return np.full(len(times), np.nan)
    row = np.searchsorted(table.time_s, times, side="right") - 1
    return np.where(row >= 0, table[field][np.maximum(row, 0)], np.nan)
