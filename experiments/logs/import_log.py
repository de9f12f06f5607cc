"""Import of a foreign record: a log of this project with samples, states, estimates and pictures.

States are the record's own, not the truth: positions as the receiver gave them, angles as the
sensors did. What the record lacks is computed from the track by the vehicle's lengths; an event of
the log says what. The reference is the line that was to be driven, where it is given; its point is
the one nearest to the vehicle, between its points, so that the error across is right and that along
is 0.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from ttempc.layout import estimate_row as record_of_estimate
from ttempc.reference.path import Projection
from ttempc.types import Command, FloatArray, Input, Measurement, Sensor
from ttempc.vehicle import Vehicle

from ...testbed.atomic_write import partial_path
from ...testbed.geodesy import MapFrame
from ...testbed.ground.ground import GROUND_FILE
from ...testbed.ground.soil import SoilMap
from ...testbed.ground.terrain import Terrain
from ...testbed.log.writer import LogWriter, refuse_existing_log
from ...testbed.recording import channels as ch
from ...testbed.recording.provenance import versions
from ...testbed.recording.record import IMPORTED_KEY, NOT_MEASURED_KEY, Event
from ...testbed.simulation.plant import Plant
from ...testbed.truth import TRUTH_SIZE, TruthBlock
from ...testbed.vehicle.vehicle import vehicle_text
from ..errors import InvalidScenario, UnreadableFile
from ..formats.field import FieldSettings
from ..formats.mapping import FormatMap
from ..formats.read import read_foreign
from ..formats.table import PLACE_COLUMNS, Table
from ..run.assembly import model_vehicle
from ..run.run_log import BEGINS, ENDS
from ..run.user_code import named_estimator
from ..scenario.controller import TRUTH
from ..scenario.path import Mission
from ..scenario.scenario import Scenario, ScenarioFile, dump
from .recorded_motion import RecordedMotion, recorded_motion, samples_of, tractor_points
from .replay import SAMPLE_ORDER

RECORDED: Final = "recorded"
"""Name of the controller of an imported log."""

_PERIOD_S: Final = 0.2
_GROUND_STEP_M: Final = 0.25
_MARGIN_M: Final = 12.0  # of ground about the record
_PATH_STEP_M: Final = 0.2
_DELIVERED_S: Final = 1e-6  # as in a replay

# Of samples of one time, those of the IMU come first, as in a replay.
_RANK: Final = {sensor: rank for rank, sensor in enumerate(SAMPLE_ORDER)}

# Samples of a record: sensor and the columns of its components.
_SENSORS: Final = {
    Sensor.STEERING_TRACTOR: "steering_rad",
    Sensor.STEERING_TRAILER: "trailer_steering_rad",
    Sensor.HITCH: "hitch_rad",
    Sensor.ENCODER: "wheel_speed_mps",
}


@dataclass(frozen=True, slots=True)
class Imported:
    """Outcome of an import."""

    file: Path
    lines: tuple[str, ...]  # for the console: what was read, assumed and left out


def default_scenario(vehicle: str, mapping: FormatMap, name: str) -> Scenario:
    """Return the scenario of a record for which none is given: level ground, no line."""
    content: dict[str, Any] = {
        "description": f"Record {name}",
        "terrain": {"iso_class": "flat"},
        "path": {"kind": "straight"},
        "sensors": {"preset": "field"},
        "plant": {"vehicle": {"file": vehicle}},
        "field": {
            key: value
            for key, value in (
                ("origin_deg", mapping.field.origin_deg),
                ("origin_m", mapping.field.origin_m),
                ("utm", mapping.field.utm),
            )
            if value
        },
    }
    return ScenarioFile(Path.cwd() / "recorded.toml", content).scenario()


def import_log(
    source: Path,
    out: Path,
    mapping: FormatMap,
    scenario: Scenario | None = None,
    *,
    name: str = RECORDED,
    vehicle: str = "kayacan2016",
    line: str = "",
    span_s: tuple[float, float] = (-math.inf, math.inf),
) -> Imported:
    """Write a foreign record as a log.

    Args:
        source: file of the record, or folder of a bag.
        out: log to write; must not exist.
        mapping: what the file does not say of itself.
        scenario: vehicle, noise and line of the record; by default level ground without a line.
        name: of the scenario.
        vehicle: name or file of the vehicle where there is no scenario.
        line: name or number of the track, where the file has several.
        span_s: part of the record, from its beginning [s].

    Raises:
        UnreadableFile: the record cannot be read, or has too little for a log.
        LogError: the log exists, or cannot be written.
    """
    # The record is still there: what a killed import has left is worth nothing.
    partial_path(out).unlink(missing_ok=True)
    refuse_existing_log(out)
    mission = scenario.mission() if scenario else None
    scenario = scenario or default_scenario(vehicle, mapping, source.name)
    if mapping.wheel_radius_m is None:
        radius_m = scenario.vehicles().plant.rear_wheel.radius_m
        mapping = replace(mapping, wheel_radius_m=radius_m)
    content = read_foreign(source, mapping)
    try:
        table = _part(content.table(line), span_s)
        field = mapping.field
        if mission and (table.coordinates == "degrees" or field.utm):
            field = FieldSettings(origin_deg=mission.frame.origin_deg, utm=field.utm)
        columns, frame, notes = _placed(table, field, mapping)
        motion = _motion(columns, scenario, mapping)
        samples = recorded_samples(motion, columns, mapping)
    except (UnreadableFile, InvalidScenario) as error:
        raise UnreadableFile(f"{source}: {error}") from None
    notes = (*content.notes, *notes, *_remarks(motion, mapping, mission))
    metadata = {
        "scenario": name,
        "controller": RECORDED,
        "seed": "0",
        "mismatch": "not known",
        IMPORTED_KEY: f"{source.name}, {content.kind}",
        NOT_MEASURED_KEY: ", ".join(motion.computed) or "none",
        **frame.metadata,
        **versions(),
    }
    parts = _Content(motion, samples, columns, frame, mission, metadata, notes)
    _write(out, scenario, parts)
    length_m = float(np.hypot(np.diff(motion.x_t), np.diff(motion.y_t)).sum())
    first = f"{content.kind}: {len(table)} rows, {motion.time_s[-1]:.1f} s, {length_m:.1f} m driven"
    return Imported(out, (first, *notes))


def _part(table: Table, span_s: tuple[float, float]) -> Table:
    """Return the rows within a span, their times from 0.

    Raises:
        UnreadableFile: the rows have no times.
    """
    if "time_s" not in table.columns:
        raise UnreadableFile(
            "has no times: it is a line (path.file), not a record; a table of columns needs one "
            "named time"
        )
    times = table.columns["time_s"]
    known = np.isfinite(times)
    if known.sum() < 3:
        raise UnreadableFile(f"has {known.sum()} rows with a time, a record needs 3 or more")
    times = times - times[known].min()
    kept = known & (times >= span_s[0]) & (times <= span_s[1])
    if kept.sum() < 3:
        raise UnreadableFile(f"has {kept.sum()} rows between these times, must be 3 or more")
    columns = {name: values[kept] for name, values in table.columns.items()}
    columns["time_s"] = times[kept] - times[kept].min()
    order = np.argsort(columns["time_s"], kind="stable")
    columns = {name: values[order] for name, values in columns.items()}
    return replace(table, columns=columns)


def _placed(
    table: Table, field: FieldSettings, mapping: FormatMap
) -> tuple[dict[str, FloatArray], MapFrame, tuple[str, ...]]:
    """Return the columns with x_m, y_m of both bodies in the map frame, that frame, and notes.

    Raises:
        UnreadableFile: there are too few positions.
    """
    columns = dict(table.columns)
    places = table.places()
    known = np.isfinite(places).all(axis=1)
    if known.sum() < 3:
        raise UnreadableFile(f"has {known.sum()} positions, a record needs 3 or more")
    points = np.full(places.shape, np.nan)
    points[known], frame, notes = field.place(table.coordinates, places[known])
    columns["x_m"], columns["y_m"] = points.T
    on_earth = table.coordinates == "degrees" or bool(field.utm)
    first = PLACE_COLUMNS[table.coordinates][0]
    if f"trailer_{first}" in table.columns:
        trailer_places = table.places("trailer_")
        kept = np.isfinite(trailer_places).all(axis=1)
        trailer = np.full(places.shape, np.nan)
        if on_earth:
            same = FieldSettings(origin_deg=frame.origin_deg, utm=field.utm)
            trailer[kept] = same.place(table.coordinates, trailer_places[kept])[0]
        else:
            trailer[kept] = trailer_places[kept] + (points[known][0] - places[known][0])
        columns["trailer_x_m"], columns["trailer_y_m"] = trailer.T
    if "pose_x_m" not in columns or not on_earth:
        return columns, frame, notes
    given = bool(field.origin_deg or field.origin_m)
    return _with_poses(columns, frame, notes, mapping, origin_given=given)


def _with_poses(
    columns: dict[str, FloatArray],
    frame: MapFrame,
    notes: tuple[str, ...],
    mapping: FormatMap,
    *,
    origin_given: bool,
) -> tuple[dict[str, FloatArray], MapFrame, tuple[str, ...]]:
    """Return columns and frame of a record with fixes and poses of one program.

    Where no origin is given, that of the poses becomes the map's: the median of fix minus pose.
    Poses that differ from the fixes by more than a translation are dropped.
    """
    names = ("pose_x_m", "pose_y_m")
    samples = [samples_of(columns, name) for name in names]
    times = columns["time_s"]
    known = np.isfinite(columns["x_m"])
    poses = [np.interp(times[known], *sample) for sample in samples if sample]
    if len(poses) != len(names):
        return columns, frame, notes
    fixes = np.column_stack([columns["x_m"], columns["y_m"]])[known]
    offset = fixes - np.column_stack(poses)
    middle = np.median(offset, axis=0)
    apart_m = float(np.median(np.hypot(*(offset - middle).T)))
    reach_m = math.hypot(*(mapping.antenna_m or (2.0, 0.0, 0.0))[:2])
    if apart_m > reach_m or (origin_given and np.hypot(*middle) > reach_m):
        kept = {name: values for name, values in columns.items() if "pose" not in name}
        note = "odometry is left out: its frame is not east, north about the origin of the fixes"
        return kept, frame, (*notes, note)
    if origin_given:
        return columns, frame, notes
    latitude, longitude = frame.degrees(middle).tolist()
    moved = MapFrame((latitude, longitude))
    for body in ("", "trailer_"):
        if f"{body}x_m" in columns:
            places = np.column_stack([columns[f"{body}x_m"], columns[f"{body}y_m"]])
            columns[f"{body}x_m"], columns[f"{body}y_m"] = moved.points(*frame.degrees(places).T).T
    note = f"field: origin of the poses at {latitude:.7f}, {longitude:.7f} deg, by the fixes"
    return columns, moved, (note,)


def _motion(
    columns: Mapping[str, FloatArray], scenario: Scenario, mapping: FormatMap
) -> RecordedMotion:
    """Return the motion; poses of odometry are those of the tractor point."""
    of_pose = "pose_x_m" in columns
    prefix = "pose_" if of_pose else ""
    points = np.column_stack([columns[f"{prefix}x_m"], columns[f"{prefix}y_m"]])
    trailer_points = None
    if f"trailer_{prefix}x_m" in columns:
        names = [f"trailer_{prefix}{axis}_m" for axis in "xy"]
        trailer_points = np.column_stack([columns[name] for name in names])
    antenna = np.array(mapping.antenna_m or (0.0, 0.0, 0.0))
    point = "axle" if of_pose else mapping.point
    model = scenario.vehicles().model
    return recorded_motion(columns, points, trailer_points, model, point, antenna)


def _remarks(
    motion: RecordedMotion, mapping: FormatMap, mission: Mission | None
) -> tuple[str, ...]:
    """Return what is not measured and what is assumed, in sentences."""
    lines = []
    if motion.computed:
        lines.append(
            f"not measured: {', '.join(motion.computed)}; computed from the track by the vehicle's "
            "lengths, so that these say nothing of the machine"
        )
    where = {
        "antenna": "the antenna, "
        + (
            "{:g} m ahead, {:g} m left of".format(*mapping.antenna_m)
            if mapping.antenna_m
            else "taken to be above"
        )
        + " the rear axle (antenna_m, point in a map)",
        "axle": "the centre of the rear axle",
        "implement": "the implement",
    }
    lines.append(f"logged point: {where[mapping.point]}")
    if mission is None:
        lines.append("no line is given: errors are not known; a scenario with path.file gives it")
    return tuple(lines)


@dataclass(frozen=True, slots=True, eq=False)
class _Content:
    """What an imported log has."""

    motion: RecordedMotion
    samples: list[Measurement]
    columns: Mapping[str, FloatArray]
    frame: MapFrame
    mission: Mission | None  # None where no line is given
    metadata: Mapping[str, str]
    notes: tuple[str, ...]


def _write(out: Path, scenario: Scenario, content: _Content) -> None:
    """Write the log; poses of the bodies are those of the vehicle on level ground."""
    motion = content.motion
    metadata = content.metadata
    terrain = _ground(motion)
    plant = Plant(scenario.vehicles().plant, terrain, SoilMap(600.0))
    scenery = replace(plant.scenery, frame=content.frame)
    state, poses = _states(plant, motion)
    line = _line(motion, content.mission)
    reference = _references(motion, line if content.mission else None)
    attachments = {
        "scenario.toml": dump(scenario),
        "vehicle.toml": vehicle_text(scenario.plant.vehicle.file),
        "model.xml": plant.mjcf,
        GROUND_FILE: plant.ground.to_npz(),
    }
    end_s = float(motion.time_s[-1])
    log = LogWriter(out, metadata=metadata, attachments=attachments, scenery=scenery)
    with log:
        title = f"{metadata['scenario']}, {metadata[IMPORTED_KEY]}"
        log.event(Event(0.0, "info", f"{BEGINS}{title}"))
        for note in content.notes:
            log.event(Event(0.0, "warning" if "not measured" in note else "info", note))
        log.path(ch.REFERENCE_PATH_TOPIC, 0.0, line)
        rows = np.zeros((len(poses), TRUTH_SIZE))
        rows[:, 0] = motion.time_s
        log.scenes(TruthBlock(rows, poses, np.zeros((len(poses), 0))))
        log.rows(ch.STATE, motion.time_s, state)
        log.rows(ch.REFERENCE, motion.time_s, reference)
        tyres = np.zeros((len(state), len(ch.TYRES.fields)))
        log.rows(ch.TYRES, motion.time_s, tyres)
        for time_s, row in _sample_rows(content.samples):
            log.row(ch.MEASUREMENT, time_s, row)
        for time_s, estimate, control in _estimates(scenario, content, end_s):
            log.row(ch.ESTIMATE, time_s, estimate)
            log.row(ch.CONTROL, time_s, control)
        log.event(Event(end_s, "info", f"{ENDS}completed after {end_s:.1f} s"))


def _ground(motion: RecordedMotion) -> Terrain:
    """Return level ground under the record, of a few points however large it is."""
    x_m = np.concatenate([motion.x_t, motion.x_i])
    y_m = np.concatenate([motion.y_t, motion.y_i])
    low = np.array([x_m.min(), y_m.min()]) - _MARGIN_M
    size = np.array([x_m.max(), y_m.max()]) + _MARGIN_M - low
    step = max(_GROUND_STEP_M, float(size.max()) / 400.0)
    columns, rows = (math.ceil(side / step) + 1 for side in size)
    return Terrain(np.zeros((rows, columns)), step, (float(low[0]), float(low[1])))


def _states(plant: Plant, motion: RecordedMotion) -> tuple[FloatArray, FloatArray]:
    """Return rows of `STATE` and the poses of all bodies, (n, bodies, 7)."""
    plant.reset(float(motion.x_t[0]), float(motion.y_t[0]), float(motion.psi_t[0]), 0.0)
    model = plant.model
    data = plant.data
    standing = data.qpos.copy()
    place = {
        name: int(model.joint(name).qposadr[0])
        for name in ("steer", "knuckle_left", "knuckle_right", "rj1_yaw", "rj2_yaw")
    }

    # Poses of all bodies: the joints are set, the rest follows
    poses = np.empty((len(motion.time_s), model.nbody, 7))
    for k in range(len(motion.time_s)):
        half = 0.5 * float(motion.psi_t[k])
        data.qpos[:] = standing
        data.qpos[:2] = motion.x_t[k], motion.y_t[k]
        data.qpos[3:7] = math.cos(half), 0.0, 0.0, math.sin(half)
        for name in ("steer", "knuckle_left", "knuckle_right"):
            data.qpos[place[name]] = motion.delta_t[k]
        data.qpos[place["rj1_yaw"]] = motion.beta[k]
        data.qpos[place["rj2_yaw"]] = motion.delta_i[k]
        mujoco.mj_kinematics(model, data)
        poses[k, :, :3] = data.xpos
        poses[k, :, 3:] = data.xquat

    columns = dict.fromkeys(ch.STATE.fields, np.zeros(len(motion.time_s)))
    columns |= {
        "x_t_m": motion.x_t,
        "y_t_m": motion.y_t,
        "psi_t_rad": _wrapped(motion.psi_t),
        "x_i_m": motion.x_i,
        "y_i_m": motion.y_i,
        "psi_i_rad": _wrapped(motion.psi_i),
        "z_t_m": np.full(len(motion.time_s), float(standing[2])),
        "psi_d_rad": _wrapped(motion.psi_d),
        "beta_rad": motion.beta,
        "delta_t_rad": motion.delta_t,
        "delta_i_rad": motion.delta_i,
        "v_mps": motion.speed,
        "v_rim_mps": motion.speed,
        "yaw_rate_t_radps": motion.yaw_rate,
        "yaw_rate_i_radps": np.gradient(motion.psi_i, motion.time_s),
    }
    return np.column_stack([columns[name] for name in ch.STATE.fields]), poses


def _wrapped(angles: FloatArray) -> FloatArray:
    return np.remainder(angles + math.pi, math.tau) - math.pi


def _line(motion: RecordedMotion, mission: Mission | None) -> FloatArray:
    """Return the points of the line that was to be driven, else those of the track."""
    if mission is None:
        return np.column_stack([motion.x_t, motion.y_t])
    return mission.path.pose(np.arange(0.0, mission.path.lap_m, _PATH_STEP_M))[:, :2]


def _references(motion: RecordedMotion, line: FloatArray | None) -> FloatArray:
    """Return rows of `REFERENCE`: the points of the line nearest to both axle points.

    Without a line they are NaN.
    """
    columns = dict.fromkeys(ch.REFERENCE.fields, np.full(len(motion.time_s), np.nan))
    if line is not None:
        heading = np.unwrap(np.arctan2(*np.diff(line, axis=0).T[::-1]))
        curvature = np.gradient(heading) / _PATH_STEP_M
        bodies = (("t", motion.x_t, motion.y_t), ("i", motion.x_i, motion.y_i))
        for letter, x_m, y_m in bodies:
            projection = Projection(line)
            place = np.array([projection.place(*at) for at in zip(x_m, y_m, strict=True)])
            piece = np.minimum(place.astype(int), len(line) - 2)
            part = (place - piece)[:, None]
            nearest = (1.0 - part) * line[piece] + part * line[piece + 1]
            columns[f"x_{letter}_m"], columns[f"y_{letter}_m"] = nearest.T
            columns[f"psi_{letter}_rad"] = _wrapped(heading[piece])
            if letter == "t":
                columns["curvature_per_m"] = curvature[piece]
    return np.column_stack([columns[name] for name in ch.REFERENCE.fields])


def recorded_samples(
    motion: RecordedMotion, columns: Mapping[str, FloatArray], mapping: FormatMap
) -> list[Measurement]:
    """Return the samples of all sensors in the order of their times.

    Positions of an antenna are moved to the axle point by the heading. A sensor that the record
    lacks has samples of the computed motion at the times of the grid, so that the filter can start.
    """
    samples = _positions(Sensor.GNSS_TRACTOR, motion, columns, mapping)
    samples += _positions(Sensor.GNSS_TRAILER, motion, columns, mapping)
    computed = {
        Sensor.STEERING_TRACTOR: motion.delta_t,
        Sensor.STEERING_TRAILER: motion.delta_i,
        Sensor.HITCH: motion.beta,
        Sensor.ENCODER: motion.speed,
    }
    for sensor, on_grid in computed.items():
        times, values = samples_of(columns, _SENSORS[sensor]) or (motion.time_s, on_grid)
        pairs = zip(times.tolist(), values.tolist(), strict=True)
        samples += [Measurement(time_s, sensor, (value,)) for time_s, value in pairs]
    if found := samples_of(columns, "yaw_rate_radps"):
        times, rates = found
        roll = _at(columns, "roll_rad", times)
        pitch = _at(columns, "pitch_rad", times)
        rows = zip(times.tolist(), rates.tolist(), roll.tolist(), pitch.tolist(), strict=True)
        samples += [Measurement(t, Sensor.IMU_TRACTOR, tuple(value)) for t, *value in rows]
    return sorted(samples, key=lambda sample: (sample.time_s, _RANK[sample.sensor]))


def _positions(
    sensor: Sensor,
    motion: RecordedMotion,
    columns: Mapping[str, FloatArray],
    mapping: FormatMap,
) -> list[Measurement]:
    """Return the samples of the receiver of a body, see `recorded_samples`."""
    of_tractor = sensor == Sensor.GNSS_TRACTOR
    prefix = "" if of_tractor else "trailer_"
    if f"{prefix}x_m" in columns:
        places = np.column_stack([columns[f"{prefix}x_m"], columns[f"{prefix}y_m"]])
        known = np.isfinite(places).all(axis=1)
        times = columns["time_s"][known]
        places = places[known]
        if of_tractor and mapping.point == "antenna" and mapping.antenna_m:
            yaw = np.interp(times, motion.time_s, motion.psi_t)
            places = tractor_points(places, yaw, np.array(mapping.antenna_m))
    else:
        times = motion.time_s
        points = (motion.x_t, motion.y_t) if of_tractor else (motion.x_i, motion.y_i)
        places = np.column_stack(points)
    status = _at(columns, f"{prefix}status", times)
    rows = zip(times.tolist(), places.tolist(), status.tolist(), strict=True)
    return [Measurement(time_s, sensor, (x, y), int(kind)) for time_s, (x, y), kind in rows]


def _at(columns: Mapping[str, FloatArray], name: str, times: FloatArray) -> FloatArray:
    """Return a column at times, the newest sample of each; 0 where it is not recorded."""
    found = samples_of(columns, name)
    if found is None:
        return np.zeros(len(times))
    at_s, values = found
    return values[np.maximum(np.searchsorted(at_s, times, side="right") - 1, 0)]


def _sample_rows(samples: list[Measurement]) -> list[tuple[float, FloatArray]]:
    """Return times and rows of `MEASUREMENT`, one for each time."""
    rows: list[tuple[float, FloatArray]] = []
    for sample in samples:
        columns = ch.MEASUREMENT_COLUMNS[sample.sensor]
        if not rows or rows[-1][0] != sample.time_s or np.isfinite(rows[-1][1][columns]).any():
            rows.append((sample.time_s, np.full(len(ch.MEASUREMENT.fields), np.nan)))
        status = (float(sample.status),) if sample.sensor.startswith("gnss") else ()
        rows[-1][1][columns] = (*sample.value, *status, sample.time_s)
    return rows


def _commands(columns: Mapping[str, FloatArray], times: FloatArray, vehicle: Vehicle) -> FloatArray:
    """Return the recorded commands at some times, (n, 3), NaN where there is none."""
    commands = np.full((len(times), len(Input)), np.nan)
    if samples_of(columns, "steering_command_rad"):
        commands[:, Input.DELTA_T] = _at(columns, "steering_command_rad", times)
    if samples_of(columns, "trailer_steering_command_rad"):
        commands[:, Input.DELTA_I] = _at(columns, "trailer_steering_command_rad", times)
    if samples_of(columns, "hydrostat_command"):
        commands[:, Input.HP] = _at(columns, "hydrostat_command", times)
    elif samples_of(columns, "speed_command_mps"):
        gear = -1.0 if vehicle.reverse else 1.0
        hp = _at(columns, "speed_command_mps", times) / vehicle.speed_gain
        commands[:, Input.HP] = np.clip(hp, min(0.0, gear), max(0.0, gear))
    return commands


def _control_row(command: FloatArray, vehicle: Vehicle) -> FloatArray:
    """Return a row of `CONTROL` with a command (3,) and the bounds of the vehicle, else NaN."""
    row = np.full(len(ch.CONTROL.fields), np.nan)
    for number, name in enumerate(("delta_t_rad", "delta_i_rad", "hp")):  # as `Input`
        row[ch.CONTROL.fields.index(f"{name}_command")] = command[number]
        row[ch.CONTROL.fields.index(f"{name}_min")] = vehicle.input_min[number]
        row[ch.CONTROL.fields.index(f"{name}_max")] = vehicle.input_max[number]
    return row


def _estimates(
    scenario: Scenario, content: _Content, end_s: float
) -> list[tuple[float, FloatArray, FloatArray]]:
    """Return time, row of `ESTIMATE` and row of `CONTROL` of every control tick.

    Commands are those of the record; unknown ones are NaN, and the filter holds the angles.
    """
    samples = content.samples
    columns = content.columns
    settings = scenario.controller
    if settings.estimator == TRUTH:
        raise UnreadableFile(f"controller.estimator: {TRUTH} needs a plant; choose another")
    vehicle = model_vehicle(scenario.mission(), scenario, scenario.vehicles())
    estimator = named_estimator(
        settings.estimator, vehicle, settings.noise.sensor_noise(scenario.sensors)
    )
    ticks = math.floor(end_s / _PERIOD_S + 1e-6) + 1
    times = _PERIOD_S * np.arange(ticks, dtype=np.float64)
    commands = _commands(columns, times, vehicle)

    rows = []
    command: Command | None = None
    begin = 0
    for time_s, values in zip(times.tolist(), commands, strict=True):
        end = begin
        while end < len(samples) and samples[end].time_s <= time_s + _DELIVERED_S:
            end += 1
        estimate = estimator.update(time_s, samples[begin:end], command)
        begin = end
        control = _control_row(values, vehicle)
        command = Command(*values.tolist())
        rows.append((time_s, ch.estimate_row(record_of_estimate(estimate)), control))
    return rows
