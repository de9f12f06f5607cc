"""Table of faults: what each kind acts on, its keys with their ranges, its effect, its refusal.

A new kind is a row of `_TABLE`. Scenario files, their schema, docs and the search read the kinds
from it.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, NamedTuple, Union

import mujoco
import numpy as np
from pydantic import Field

from ttempc.layout import SAMPLE, SampleColumn
from ttempc.sensors import ROW_OF, SensorKind, sensors_of_kind
from ttempc.types import Command, FloatArray, ReceiverStatus, Sensor

from ..actuation.actuators import past_backlash
from ..configuration.config_io import (
    BearingDeg,
    Fraction,
    LengthM,
    NotNegative,
    PlaceM,
    Positive,
    Signed,
    StrengthKpa,
)
from ..ground.features import Ditch, Step
from ..ground.soil import Patch
from ..sensing.sensor_errors import Correlated
from ..sensing.sensor_specification import SensorSpecification
from ..simulation.plant import Plant
from ..truth import WHEELS
from ..vehicle.vehicle import Steering
from ..wheels.tyre import TYRE
from .fault import SAME_TIME_S, Fault, FaultContext, Key, Row, Window, fault_type

Made = Any
"""A fault with the keys of its row; without a static type, since the table makes it."""

_WHEEL_NAMES = Literal[
    "front_left", "front_right", "rear_left", "rear_right", "trailer_left", "trailer_right"
]
_RECEIVER = Key(
    "receiver", Literal["both", "tractor", "trailer"], "Receiver that is concerned.", "both"
)
_SENSOR = Key(
    "sensor", Literal["steering_tractor", "steering_trailer", "hitch"], "Sensor that is concerned."
)
_GROUP = Key(
    "group", Literal["all", "gnss", "angles", "encoder"], "Sensors that are concerned.", "all"
)
_OFFSET = Key("offset_m", Positive, "Length of the offset.")
_DIRECTION = Key(
    "direction_deg", BearingDeg, "Direction of the offset, counter-clockwise from east.", 0.0
)
_SHARE = Key("share", Fraction, "Share of the samples that are outliers, drawn one by one.", 1.0)
_SD = Key("sd_m", Positive, "Standard deviation of the added error of an axis; assumed.", 0.5)
_MEMORY = Key("correlation_time_s", Positive, "Correlation time of that error; assumed.", 20.0)
_SIDE = Key("side", Literal["left", "right"], "Sign of the angle at the stop: left is positive.")
_PART = Annotated[float, Field(gt=0, le=1)]
_BODIES = Literal["tractor", "trailer"]
_IMU = Key("body", Literal["both", "tractor", "trailer"], "Body on which the IMU is.", "both")

# --- samples: between those that a sensor takes and those that the estimator gets -----------------

SampleFilter = Callable[[FloatArray], FloatArray]
"""Turns samples of one sensor in a window into those that arrive in their place, as many for each.

Rows have time, `SensorIndex`, three components, due physics step; the array is the filter's own.
"""

# Columns of such rows
_TIME: Final = SampleColumn.TIME_S
_INDEX: Final = SampleColumn.SENSOR
_VALUE: Final = slice(SampleColumn.FIRST, SAMPLE)
_DUE: Final = SAMPLE

_GNSS: Final = sensors_of_kind(SensorKind.POSITION)
_ANGLES: Final = sensors_of_kind(SensorKind.ANGLE)
_VELOCITIES: Final = sensors_of_kind(SensorKind.VELOCITY)
_RECEIVERS: Final = (*_GNSS, *_VELOCITIES, *sensors_of_kind(SensorKind.RECEIVER))
_IMUS: Final = sensors_of_kind(SensorKind.INERTIAL)
_SETS: Final = {
    "all": (*_RECEIVERS, *_ANGLES, Sensor.ENCODER),
    "gnss": _RECEIVERS,
    "angles": _ANGLES,
    "encoder": (Sensor.ENCODER,),
}


def sensors_of(fault: Made) -> tuple[Sensor, ...]:
    """Return the sensors whose samples a fault changes."""
    if fault.row.on != "samples":
        return ()
    if fault.kind.startswith("gyro"):
        return _of_body(_IMUS, fault.body)
    if hasattr(fault, "sensor"):
        return (Sensor(fault.sensor),)
    if hasattr(fault, "receiver"):
        return _of_body(_CONCERNED.get(fault.kind, _GNSS), fault.receiver)
    fixed = "encoder" if fault.kind.startswith("encoder") else "gnss"
    return _SETS[getattr(fault, "group", fixed)]


_CONCERNED: Final = {
    "gnss_out": _RECEIVERS,
    "gnss_frozen": _RECEIVERS,
    "gnss_late": _RECEIVERS,
    "gnss_held": (*_GNSS, *_VELOCITIES),
    "gnss_warning": sensors_of_kind(SensorKind.RECEIVER),
}
"""Sensors of faults of a receiver that do not act on its positions alone."""


def _of_body(sensors: tuple[Sensor, ...], body: str) -> tuple[Sensor, ...]:
    """Return the sensors of a body, "tractor" or "trailer", or of both."""
    return tuple(sensor for sensor in sensors if body == "both" or sensor.endswith(body))


def refusal(fault: Fault, window: Window, context: FaultContext) -> str:
    """Return why a fault cannot act in a window and scenario; empty where it can."""
    row = fault.row
    if row.refusal and (reason := row.refusal(fault, context)):
        return reason
    if row.on == "bus" and not window.holds_multiple(context.period_s):
        return "no command is sent while it lasts"
    if row.on == "samples" and context.true_state:
        return "no sample is read, since controller.estimator is the truth"
    for sensor in sensors_of(fault):
        if not window.holds_multiple(context.sensors.period_s(sensor)):
            return f"no sample of {sensor} is taken while it lasts"
    return ""


class Sampling(NamedTuple):
    """Circumstances of a fault of one sensor."""

    window: Window
    specification: SensorSpecification
    sensor: Sensor
    timestep: float  # physics step [s]
    rng: np.random.Generator  # of this fault and sensor alone


def _column(column: int, change: Callable[[FloatArray], FloatArray | float]) -> SampleFilter:
    """Return the filter that replaces a column by a function of it."""

    def changed(samples: FloatArray) -> FloatArray:
        samples[:, column] = change(samples[:, column])
        return samples

    return changed


def _added(offset: Callable[[FloatArray], FloatArray]) -> SampleFilter:
    """Return the filter that adds to the first components a function of the times (n,) [s]."""

    def changed(samples: FloatArray) -> FloatArray:
        error = offset(samples[:, _TIME])
        samples[:, 2 : 2 + error.shape[1]] += error
        return samples

    return changed


def _frozen(fault: Made, run: Sampling) -> SampleFilter:
    """Return the filter that repeats the value of its first sample."""
    first: list[FloatArray] = []

    def changed(samples: FloatArray) -> FloatArray:
        first[:] = first or [samples[0, _VALUE].copy()]
        samples[:, _VALUE] = first[0]
        return samples

    return changed


def _vectors(length: FloatArray, direction_deg: FloatArray | float) -> FloatArray:
    """Return vectors of some lengths (n,), (n, 2)."""
    direction = np.radians(direction_deg)
    return np.column_stack([length * np.cos(direction), length * np.sin(direction)])


def _jump(fault: Made, run: Sampling) -> SampleFilter:
    return _added(lambda t: _vectors(np.full(len(t), fault.offset_m), fault.direction_deg))


def _drift(fault: Made, run: Sampling) -> SampleFilter:
    begin = run.window.start_s
    return _added(lambda t: _vectors(fault.rate_mps * (t - begin), fault.direction_deg))


def _stairs(fault: Made, run: Sampling) -> SampleFilter:
    def offset(times_s: FloatArray) -> FloatArray:
        steps = 1.0 + np.floor((times_s - run.window.start_s) / fault.every_s)
        return _vectors(fault.rise_m * steps, fault.direction_deg)

    return _added(offset)


def _sine(fault: Made, run: Sampling) -> SampleFilter:
    rate = math.tau / fault.period_s
    begin = run.window.start_s
    return _added(
        lambda t: _vectors(fault.amplitude_m * np.sin(rate * (t - begin)), fault.direction_deg)
    )


def _accelerating(fault: Made, run: Sampling) -> SampleFilter:
    begin = run.window.start_s
    return _added(
        lambda t: _vectors(0.5 * fault.acceleration_mps2 * (t - begin) ** 2, fault.direction_deg)
    )


def _rotation(fault: Made, run: Sampling) -> SampleFilter:
    """Return the filter that turns positions about the origin of the map."""
    begin = run.window.start_s
    rate = math.radians(fault.rate_degps)

    def changed(samples: FloatArray) -> FloatArray:
        turned = rate * (samples[:, _TIME] - begin)
        x = samples[:, SampleColumn.FIRST].copy()
        y = samples[:, SampleColumn.SECOND].copy()
        samples[:, SampleColumn.FIRST] = np.cos(turned) * x - np.sin(turned) * y
        samples[:, SampleColumn.SECOND] = np.sin(turned) * x + np.cos(turned) * y
        return samples

    return changed


class _Recent:
    """Places of a receiver in the last seconds, from which it knows whether it moves."""

    def __init__(self) -> None:
        self._known: list[tuple[float, FloatArray]] = []

    def speed(self, time_s: float, place: FloatArray) -> float:
        """Return the mean speed of the last two seconds with a new place [m/s]."""
        self._known.append((time_s, place.copy()))
        while time_s - self._known[0][0] > _RECENT_S:
            self._known.pop(0)
        first_s, first = self._known[0]
        if time_s <= first_s:
            return math.inf
        return float(np.linalg.norm(place - first)) / (time_s - first_s)


_RECENT_S: Final = 2.0


def _moving_drift(fault: Made, run: Sampling) -> SampleFilter:
    """Return the filter whose drift grows only while the receiver moves."""
    recent = _Recent()
    state = {"time_s": run.window.start_s, "offset_m": 0.0}

    def changed(samples: FloatArray) -> FloatArray:
        for row in samples:
            place = row[SampleColumn.FIRST : SampleColumn.THIRD]
            moves = recent.speed(float(row[_TIME]), place) > fault.speed_mps
            if moves:
                state["offset_m"] += fault.rate_mps * (row[_TIME] - state["time_s"])
            state["time_s"] = float(row[_TIME])
            place += _vectors(np.array([state["offset_m"]]), fault.direction_deg)[0]
        return samples

    return changed


def _held(fault: Made, run: Sampling) -> SampleFilter:
    """Return the filter of a receiver that holds its position, and a velocity of 0, at rest."""
    recent = _Recent()
    holds: list[FloatArray] = []
    is_velocity = run.sensor in _VELOCITIES

    def changed(samples: FloatArray) -> FloatArray:
        for row in samples:
            value = row[SampleColumn.FIRST : SampleColumn.THIRD]
            if is_velocity:
                if np.linalg.norm(value) < fault.speed_mps:
                    value[:] = 0.0
            elif recent.speed(float(row[_TIME]), value) < fault.speed_mps:
                holds[:] = holds or [value.copy()]
                value[:] = holds[0] + _HELD_NOISE_M * run.rng.standard_normal(2)
            else:
                holds.clear()
        return samples

    return changed


_HELD_NOISE_M: Final = 0.001  # that a receiver leaves on a position that it holds; assumed


def _warning(fault: Made, run: Sampling) -> SampleFilter:
    status = ReceiverStatus(
        dead_reckoning=fault.warning == "dead_reckoning",
        spoofed=fault.warning == "spoofed",
        jammed=fault.warning == "jammed",
        correction_age_s=fault.correction_age_s,
        protection_m=fault.protection_m,
    )

    def changed(samples: FloatArray) -> FloatArray:
        samples[:, _VALUE] = status.value
        return samples

    return changed


def _no_status(fault: Made, context: FaultContext) -> str:
    return "" if context.sensors.gnss_status else "sensors.gnss_status is false"


def _ageing(fault: Made, run: Sampling) -> SampleFilter:
    """Return the filter of samples that arrive ever later, stamped as they arrive."""
    begin = run.window.start_s

    def changed(samples: FloatArray) -> FloatArray:
        share = np.minimum((samples[:, _TIME] - begin) / fault.over_s, 1.0)
        late_s = fault.first_s + share * (fault.last_s - fault.first_s)
        steps = np.round(late_s / run.timestep)
        samples[:, _DUE] += steps
        samples[:, _TIME] += steps * run.timestep
        return samples

    return changed


def _noisier(fault: Made, run: Sampling) -> SampleFilter:
    """Return the filter that multiplies the white noise of a sensor, with more of the same."""
    sd = _white_sd(run.specification, run.sensor)
    added = sd * math.sqrt(fault.factor**2 - 1.0)

    def changed(samples: FloatArray) -> FloatArray:
        size = len(added)
        noise = added * run.rng.standard_normal((len(samples), size))
        samples[:, SampleColumn.FIRST : SampleColumn.FIRST + size] += noise
        return samples

    return changed


def _white_sd(of: SensorSpecification, sensor: Sensor) -> FloatArray:
    """Return the standard deviations that a sensor is said to have, none of a status."""
    match ROW_OF[sensor].kind:
        case SensorKind.POSITION:
            return np.full(2, of.gnss_sd_m)
        case SensorKind.VELOCITY:
            return np.full(2, of.gnss_velocity_sd_mps)
        case SensorKind.INERTIAL | SensorKind.RECEIVER:
            return np.zeros(0)
        case _:
            return np.array([of.plain_sensors[sensor].sd])


def _gyro_ramp(fault: Made, run: Sampling) -> SampleFilter:
    rate = math.radians(fault.rate_degps2)
    begin = run.window.start_s
    return _added(lambda t: rate * (t - begin)[:, None])


def _gyro_swapped(fault: Made, run: Sampling) -> SampleFilter:
    """Return the filter that gives the rate of another axis, which turns by roll or pitch."""
    column = {"roll": SampleColumn.SECOND, "pitch": SampleColumn.THIRD}[fault.axis]
    last: list[FloatArray] = []

    def changed(samples: FloatArray) -> FloatArray:
        for row in samples:
            before = last[0] if last else row
            span_s = row[_TIME] - before[_TIME]
            turned = row[column] - before[column]
            last[:] = [row.copy()]
            row[SampleColumn.FIRST] = turned / span_s if span_s > 0.0 else 0.0
        return samples

    return changed


def _outlier(fault: Made, run: Sampling) -> SampleFilter:
    def offset(times_s: FloatArray) -> FloatArray:
        drawn = [(run.rng.random() < fault.share, run.rng.uniform(0.0, 360.0)) for _ in times_s]
        hit, direction = np.array(drawn, dtype=float).T
        return _vectors(fault.offset_m * hit, direction)

    return _added(offset)


def _float(fault: Made, run: Sampling) -> SampleFilter:
    rng = run.rng
    period_s = 1.0 / run.specification.gnss_rate_hz
    sd = np.full(2, fault.sd_m)
    error = Correlated(sd, 0.0, fault.correlation_time_s, period_s, rng, rng)
    return _added(lambda times_s: error.errors(len(times_s)))


def _angle_drift(fault: Made, run: Sampling) -> SampleFilter:
    rate = math.radians(fault.rate_degps)
    begin = run.window.start_s
    return _added(lambda t: rate * (t - begin)[:, None])


def _noise(fault: Made, run: Sampling) -> SampleFilter:
    sd = math.radians(fault.sd_deg)
    return _added(lambda t: sd * run.rng.standard_normal((len(t), 1)))


def _constant(offset: float) -> SampleFilter:
    return _column(2, lambda value: value + offset)


def _no_imu(fault: Made, context: FaultContext) -> str:
    return "" if context.sensors.imu.on else "there is no IMU, sensors.imu.on is false"


# --- commands and valves: between a command and the servos ----------------------------------------

_VALVES: Final = {"front": 0, "trailer": 1, "hydrostat": 2}


class BusState(NamedTuple):
    """Commands on their way to the valves."""

    arrived: Command  # that reaches the valves
    under_way: tuple[tuple[float, Command], ...] = ()  # times of arrival [s] and later commands


def valve(fault: Fault) -> int:
    """Return the number of a fault's valve: front steering, trailer steering, hydrostat."""
    return _VALVES[fault.kind.split("_")[0]]


def _steering(fault: Fault, context: FaultContext) -> Steering:
    return (context.vehicle.front_steering, context.vehicle.trailer_steering)[valve(fault)]


def _late(fault: Made, bus: BusState, command: Command, now_s: float) -> BusState:
    arrived, under_way = bus
    newest = under_way[-1][1] if under_way else arrived
    if command != newest:
        under_way = (*under_way, (now_s + fault.delay_s, command))
    while under_way and under_way[0][0] <= now_s + SAME_TIME_S:
        arrived = under_way[0][1]
        under_way = under_way[1:]
    return BusState(arrived, under_way)


def _slow(fault: Made, memory: float, target: float, timestep: float, stop: float) -> float:
    most = math.radians(fault.rate_degps) * timestep
    return memory + min(max(target - memory, -most), most)


def _sluggish(fault: Made, memory: float, target: float, timestep: float, stop: float) -> float:
    # exact for a constant target
    return target + (memory - target) * math.exp(-timestep / fault.time_constant_s)


def _not_slower(fault: Made, context: FaultContext) -> str:
    rate = _steering(fault, context).rate_degps
    if fault.rate_degps < rate:
        return ""
    return f"got rate_degps {fault.rate_degps:g}, must be below that of the valve, {rate:g}"


def _too_much_backlash(fault: Made, context: FaultContext) -> str:
    stop = _steering(fault, context).limit_deg
    if fault.backlash_deg < stop:
        return ""
    return f"got backlash_deg {fault.backlash_deg:g}, must be below the stop at {stop:g}"


# --- plant: forces on its bodies, parameters that change while it drives --------------------------
# They act in whole control periods. A force is scaled by the share of the period in which it acts,
# so that its impulse is exact; it is added to `qfrc_applied`, which is 0 before them.

Effect = Callable[[float], None]
"""Sets a fault for the next control period, from the share of the period in which it acts."""

_LARGEST_SHIFT: Final = 0.5  # of a load over the size of the box: its centre stays in the box


def _switched(values: FloatArray, faulty: FloatArray) -> Effect:
    """Return the effect that replaces values of the model in place while the fault acts."""
    healthy = values.copy()

    def effect(share: float) -> None:
        values[:] = faulty if share > 0.0 else healthy

    return effect


def _push(plant: Plant, force: FloatArray, point: FloatArray, body: int) -> None:
    """Add a force [N] at a point [m] of a body, both in the map frame."""
    if force.any():
        target = plant.data.qfrc_applied
        mujoco.mj_applyFT(plant.model, plant.data, force, np.zeros(3), point, body, target)


def _free(fault: Fault, plant: Plant) -> Effect:
    actuator = "steer" if fault.kind.startswith("front") else "trailer_steer"
    limits = plant.model.actuator_forcerange[plant.model.actuator(actuator).id]
    return _switched(limits, np.zeros(2))


def _shift(fault: Made, plant: Plant) -> Effect:
    place = plant.model.body_pos[plant.model.body("load").id]
    return _switched(place, place + np.array([fault.forward_m, fault.left_m, 0.0]))


def _no_shift(fault: Made, context: FaultContext) -> str:
    if not context.vehicle.load.mass_kg:
        return "the trailer is empty, plant.vehicle.load_kg is 0"
    box = context.vehicle.box
    for key, size in (("left_m", box.width_m), ("forward_m", box.length_m)):
        shift = getattr(fault, key)
        most = _LARGEST_SHIFT * size
        if abs(shift) > most:
            return f"got {key} {shift:g}, must be at most {most:g}, half the box"
    return "" if fault.left_m or fault.forward_m else "left_m and forward_m are 0"


def _flat(fault: Made, plant: Plant) -> Effect:
    tyre = plant.wheels.tyre_table[WHEELS.index(fault.wheel)]
    flat = tyre.copy()
    constants = flat.view(TYRE)
    constants["radius"] -= fault.radius_loss_m
    constants["stiffness"] *= fault.stiffness_factor
    return _switched(tyre, flat)


def _not_flat(fault: Made, context: FaultContext) -> str:
    loss = fault.radius_loss_m
    wheel = context.vehicle.wheels[fault.wheel.split("_")[0]]
    if loss > 0.5 * wheel.radius_m:
        most = f"{0.5 * wheel.radius_m:g}, half the radius"
        return f"got radius_loss_m {loss:g}, must be at most {most}"
    return "" if loss or fault.stiffness_factor < 1.0 else "the tyre is as before"


def _gust(fault: Made, plant: Plant) -> Effect:
    direction = math.radians(fault.direction_deg)
    force = fault.force_n * np.array([math.cos(direction), math.sin(direction), 0.0])
    body = plant.model.body(fault.body).id
    return lambda share: _push(plant, share * force, plant.data.xipos[body], body)


def _stone(fault: Made, plant: Plant) -> Effect:
    wheel = plant.model.body(fault.wheel).id
    carrier = "trailer" if fault.wheel.startswith("trailer") else "tractor"
    body = plant.model.body(carrier).id

    def effect(share: float) -> None:
        ahead = plant.data.xmat[body].reshape(3, 3)[:, 0]
        force = -fault.impulse_ns / fault.duration_s * share * ahead
        _push(plant, force, plant.data.xpos[wheel], wheel)

    return effect


# --- ground: surprises across the path, where the reference of the tractor is at the start --------

PathPose = tuple[float, float, float]
"""x, y [m] and heading [rad] of the path at the place of a fault."""


def _patch(fault: Made, pose: PathPose) -> Patch:
    x, y, yaw = pose
    return Patch(
        x_m=x - fault.left_m * math.sin(yaw),
        y_m=y + fault.left_m * math.cos(yaw),
        radius_m=fault.radius_m,
        cone_index_kpa=fault.cone_index_kpa,
    )


def _ditch(fault: Made, pose: PathPose) -> Ditch:
    x, y, yaw = pose
    across_deg = math.degrees(yaw) + 90.0
    size = {"depth_m": fault.depth_m, "width_m": fault.width_m, "length_m": fault.length_m}
    return Ditch(x_m=x, y_m=y, along_deg=across_deg, **size)


def _step(fault: Made, pose: PathPose) -> Step:
    x, y, yaw = pose
    size = {"height_m": fault.height_m, "ramp_m": fault.ramp_m}
    return Step(x_m=x, y_m=y, uphill_deg=math.degrees(yaw), **size)


# --- the table ------------------------------------------------------------------------------------

# fmt: off
_TABLE: Final = (
    Row("gnss_out", "samples", "No samples arrive.", (_RECEIVER,),
        lambda f, run: lambda samples: samples[:0]),
    Row("gnss_frozen", "samples", "The first position is repeated under new stamps.",
        (_RECEIVER,), _frozen),
    Row("gnss_jump", "samples", "All positions are off by a constant vector.",
        (_RECEIVER, _OFFSET, _DIRECTION), _jump),
    Row("gnss_drift", "samples", "An offset of the positions grows at a constant rate.",
        (_RECEIVER, Key("rate_mps", Positive, "Rate at which the offset grows."), _DIRECTION),
        _drift),
    Row("gnss_stairs", "samples", "An offset of the positions grows by steps.",
        (_RECEIVER, Key("rise_m", Positive, "Height of a step."),
         Key("every_s", Positive, "Time from step to step."), _DIRECTION), _stairs),
    Row("gnss_sine", "samples", "An offset of the positions swings.",
        (_RECEIVER, Key("amplitude_m", Positive, "Amplitude."),
         Key("period_s", Positive, "Period."), _DIRECTION), _sine),
    Row("gnss_accelerating", "samples", "An offset of the positions grows faster and faster.",
        (_RECEIVER, Key("acceleration_mps2", Positive, "Acceleration of the offset."), _DIRECTION),
        _accelerating),
    Row("gnss_rotation", "samples", "The positions turn about the origin of the map.",
        (_RECEIVER, Key("rate_degps", Signed, "Rate of the turn.")), _rotation),
    Row("gnss_moving_drift", "samples",
        "An offset of the positions grows at a constant rate while the receiver moves.",
        (_RECEIVER, Key("rate_mps", Positive, "Rate at which the offset grows."), _DIRECTION,
         Key("speed_mps", Positive, "Speed below which it does not; assumed.", 0.06)),
        _moving_drift),
    Row("gnss_held", "samples",
        "A receiver holds its position, and a velocity of 0, while it takes itself for at rest.",
        (_RECEIVER, Key("speed_mps", Positive, "Speed below which it does; assumed.", 0.06)),
        _held),
    Row("gnss_warning", "samples", "A receiver warns in its status.",
        (_RECEIVER,
         Key("warning", Literal["none", "dead_reckoning", "spoofed", "jammed"], "Its warning.",
             "none"),
         Key("correction_age_s", NotNegative, "Age of the corrections; 0: not stated.", 0.0),
         Key("protection_m", NotNegative, "Protection level; 0: not stated.", 0.0)),
        _warning, _no_status),
    Row("gnss_outlier", "samples",
        "Single positions are off by a vector of constant length and random direction.",
        (_RECEIVER, _OFFSET, _SHARE), _outlier),
    Row("gnss_float", "samples",
        "The receivers lose the fixed ambiguities: a correlated error is added.",
        (_RECEIVER, _SD, _MEMORY), _float),
    Row("gnss_late", "samples",
        "Samples arrive later than the scenario's latency has it; their stamps are right.",
        (_RECEIVER, Key("delay_s", Positive, "Further time from sampling to delivery.")),
        lambda f, run: _column(_DUE, lambda due: due + round(f.delay_s / run.timestep))),
    Row("antennas_swapped", "samples",
        "Each receiver's samples come under the name of the other one.",
        (), lambda f, run: _column(_INDEX, lambda index: index + 1.0 - 2.0 * (index % 2.0))),
    Row("angle_stuck", "samples", "An angle sensor repeats its first reading.",
        (_SENSOR,), _frozen),
    Row("angle_bias", "samples", "An angle sensor reads too much by a constant.",
        (_SENSOR, Key("bias_deg", BearingDeg, "What is added to a reading.")),
        lambda f, run: _constant(math.radians(f.bias_deg))),
    Row("angle_drift", "samples", "The error of an angle sensor grows at a constant rate.",
        (_SENSOR, Key("rate_degps", Signed, "Rate at which the error grows.")), _angle_drift),
    Row("angle_noise", "samples", "White noise is added to an angle sensor.",
        (_SENSOR, Key("sd_deg", Positive, "Standard deviation of the added error.")), _noise),
    Row("angle_scaled", "samples", "An angle sensor reads a multiple of the angle.",
        (_SENSOR, Key("factor", Signed, "Factor on a reading.")),
        lambda f, run: _column(2, lambda value: f.factor * value)),
    Row("gyro_bias", "samples", "The yaw rate of an IMU is too large by a constant.",
        (_IMU,
         Key("bias_degps", Signed, "What is added to a yaw rate.")),
        lambda f, run: _constant(math.radians(f.bias_degps)), _no_imu),
    Row("gyro_ramp", "samples", "The error of the yaw rate of an IMU grows at a constant rate.",
        (_IMU, Key("rate_degps2", Signed, "Rate at which the error grows.")), _gyro_ramp, _no_imu),
    Row("gyro_scaled", "samples", "The yaw rate of an IMU is a multiple of the true one.",
        (_IMU, Key("factor", Signed, "Factor on a yaw rate.")),
        lambda f, run: _column(2, lambda value: f.factor * value), _no_imu),
    Row("gyro_swapped", "samples", "An IMU is mounted on its side: its yaw rate is another axis's.",
        (_IMU, Key("axis", Literal["roll", "pitch"], "Axis whose rate it gives.")),
        _gyro_swapped, _no_imu),
    Row("encoder_dead", "samples", "The speed encoder reads 0.",
        (), lambda f, run: _column(2, lambda value: 0.0)),
    Row("encoder_scaled", "samples",
        "The speed encoder reads a multiple of the speed: 2 doubled, -1 reversed.",
        (Key("factor", Signed, "Factor on a reading."),),
        lambda f, run: _column(2, lambda value: f.factor * value)),
    Row("samples_ageing", "samples",
        "Samples arrive later and later, and are stamped as they arrive.",
        (_GROUP, Key("first_s", NotNegative, "Further time from sampling to delivery at first."),
         Key("last_s", Positive, "The same at last."),
         Key("over_s", Positive, "Time in which it grows from one to the other.")), _ageing),
    Row("samples_noisier", "samples", "The white noise of sensors grows.",
        (_GROUP, Key("factor", Annotated[float, Field(gt=1, le=1000)],
                     "Factor on its standard deviation.")), _noisier),
    Row("samples_duplicated", "samples", "Each sample arrives twice.",
        (_GROUP,), lambda f, run: lambda samples: np.repeat(samples, 2, axis=0)),
    Row("stamps_backward", "samples", "Time stamps run backward from the start of the fault.",
        (_GROUP,),
        lambda f, run: _column(_TIME, lambda time_s: 2.0 * run.window.start_s - time_s)),
    Row("stamps_shifted", "samples",
        "Time stamps are wrong by a constant: negative ones are too old.",
        (_GROUP, Key("offset_s", Signed, "What is added to a stamp.")),
        lambda f, run: _column(_TIME, lambda time_s: time_s + f.offset_s)),

    Row("commands_lost", "bus", "Commands do not arrive; the last one before holds.",
        (), lambda f, bus, command, now_s: bus),
    Row("commands_late", "bus",
        "Commands arrive late, as after a missed deadline; those under way at the end are lost.",
        (Key("delay_s", Positive, "Further time from tick to valve."),), _late),
    Row("front_steering_stuck trailer_steering_stuck hydrostat_stuck", "valve",
        "A valve is closed: the axis stays where it is.",
        (), lambda f, memory, target, timestep, stop: memory),
    Row("front_steering_slow trailer_steering_slow", "valve",
        "A steering valve gives less oil: the angle changes at a lower rate.",
        (Key("rate_degps", Positive, "Largest rate; below that of the vehicle."),),
        _slow, _not_slower),
    Row("front_steering_hard_over trailer_steering_hard_over", "valve",
        "A steering valve is fully open to one side: the axis runs to its stop.",
        (_SIDE,), lambda f, memory, target, timestep, stop: stop if f.side == "left" else -stop),
    Row("front_steering_play trailer_steering_play", "valve",
        "A steering linkage is worn: the wheel follows its cylinder with backlash.",
        (Key("backlash_deg", Positive, "Whole angle of the backlash."),),
        lambda f, memory, target, timestep, stop: past_backlash(
            memory, target, math.radians(f.backlash_deg)),
        _too_much_backlash),
    Row("hydrostat_cut", "valve",
        "The position of the hydrostat falls to 0, whatever is commanded.",
        (), lambda f, memory, target, timestep, stop: 0.0),
    Row("hydrostat_sluggish", "valve",
        "The hydrostat follows its command through a further first-order lag.",
        (Key("time_constant_s", Positive, "Time constant of the lag."),), _sluggish),

    Row("front_steering_free trailer_steering_free", "plant",
        "A steering cylinder has lost its oil: no torque holds the angle.", (), _free),
    Row("load_shift", "plant", "The load of the trailer slides.",
        (Key("left_m", PlaceM, "Shift of its centre to the left.", 0.0),
         Key("forward_m", PlaceM, "Shift of its centre to the front.", 0.0)), _shift, _no_shift),
    Row("tyre_flat", "plant", "A tyre loses its air: it is smaller and softer.",
        (Key("wheel", _WHEEL_NAMES, "Wheel that is concerned."),
         Key("radius_loss_m", NotNegative, "Loss of radius; assumed.", 0.05),
         Key("stiffness_factor", _PART, "Factor on the stiffness; assumed.", 0.4)),
        _flat, _not_flat),
    Row("gust", "plant", "A constant horizontal force on the centre of mass of a body.",
        (Key("body", _BODIES, "Body that is pushed.", "trailer"),
         Key("force_n", Positive, "Force."),
         Key("direction_deg", BearingDeg, "Direction of the force, counter-clockwise from east.")),
        _gust),
    Row("stone", "plant", "A wheel hits an obstacle: an impulse to the rear at its centre.",
        (Key("wheel", _WHEEL_NAMES, "Wheel that hits the obstacle."),
         Key("impulse_ns", Positive, "Impulse."),
         Key("duration_s", Positive, "Time over which the impulse is spread; assumed.", 0.1)),
        _stone),

    Row("soil_patch", "ground", "A round patch of soil of another strength.",
        (Key("radius_m", LengthM, "Radius."),
         Key("cone_index_kpa", StrengthKpa, "Cone index inside the patch."),
         Key("left_m", PlaceM, "Distance of its centre to the left of the path.", 0.0)), _patch),
    Row("ditch", "ground", "A ditch across the path.",
        (Key("depth_m", LengthM, "Depth in the middle."),
         Key("width_m", LengthM, "Width at the top, along the path."),
         Key("length_m", NotNegative, "Length across the path; 0: a round hole.", 6.0)), _ditch),
    Row("step", "ground",
        "Ground that is higher behind a line across the path; the line spans the field.",
        (Key("height_m", PlaceM, "Height behind the ramp; negative for a step down."),
         Key("ramp_m", LengthM, "Length of the ramp.")), _step),
)
# fmt: on

_TYPES: Final = tuple(fault_type(row, __name__) for row in _TABLE)
globals().update({table.__name__: table for table in _TYPES})  # pickle finds them by their names

KINDS: Final[dict[str, type[Fault]]] = {
    kind: table for table in _TYPES for kind in table.row.kinds.split()
}
"""Dataclass of each kind of fault."""

if TYPE_CHECKING:
    AnyFault = Fault
else:
    AnyFault = Annotated[Union[_TYPES], Field(discriminator="kind")]  # noqa: UP007
    """A table of `[[faults]]`, chosen by its `kind`."""
