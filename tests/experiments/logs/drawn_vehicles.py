"""Records of vehicles that are drawn within 30 %, as columns at 5 Hz in degrees and km/h.

Receivers have errors as recorded under an open sky, angle sensors an offset and steps of 0.1 deg.
"""

import math

import numpy as np
from proving_ground.experiments.logs.replay import ticks
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.run.user_code import named_estimator
from proving_ground.experiments.scenario.scenario import ScenarioFile
from proving_ground.testbed.geodesy import MapFrame
from proving_ground.testbed.recording.record import Record, Table

from ttempc.models.kinematics import articulated, trailer_point
from ttempc.vehicle import Vehicle

FRAME = MapFrame((44.97, -93.26))
NOMINAL = {
    "wheelbase_m": 1.4,
    "hitch_offset_m": 0.3,
    "drawbar_m": 0.8,
    "trailer_m": 1.3,
    "front_lag_s": 0.15,
    "trailer_lag_s": 0.20,
    "speed_gain_mps": 1.4,
    "speed_time_constant_s": 2.05,
}
MOST_DEAD_TIME_S = 0.2
COMMANDS = {"steering": "delta_t_rad", "trailer_steering": "delta_i_rad"}


def drawn(seed):
    """Return true parameters within 30 % of the nominal ones, and dead times up to 0.2 s."""
    generator = np.random.default_rng(seed)
    true = {key: value * generator.uniform(0.7, 1.3) for key, value in NOMINAL.items()}
    for name in ("front", "trailer"):
        true[f"{name}_dead_time_s"] = round(50.0 * generator.uniform(0.0, MOST_DEAD_TIME_S)) / 50.0
    return true


def scenario_of(true=None):
    """Return a lap on grass with the sensors of the field; the plant has the true parameters."""
    content = {
        "path": {"kind": "figure-eight", "laps": 1},
        "sensors": {"preset": "field"},
        "field": {"origin_deg": list(FRAME.origin_deg)},
        "controller": {"name": "pid"},
    }
    if true:
        plant = {key: true[key] for key in NOMINAL if key.startswith(("hitch", "draw", "speed"))}
        plant["trailer_m"] = true["trailer_m"]
        plant["parts"] = {
            "tractor": {"wheelbase_m": true["wheelbase_m"]},
            "hitch": {"yaw_limit_deg": 50.0},  # of a short hitch the drawbar meets the wheels
            "front_steering": {"lag_s": true["front_lag_s"]},
            "trailer_steering": {"lag_s": true["trailer_lag_s"]},
        }
        content["plant"] = {"vehicle": plant}
        content["actuators"] = {
            name: {"dead_time_s": true[f"{name}_dead_time_s"]} for name in ("front", "trailer")
        }
    return content


def record_of(folder, true, seed):
    """Return the record of a run."""
    source = ScenarioFile(folder / "drawn.toml", scenario_of(true))
    summary, record = simulate("drawn", source.scenario(), seed)
    return summary, record


def write_csv(file, record):
    """Write a record as columns: a row for each position of the tractor's receiver."""
    table = record["/measurement"]
    times, first = np.unique(table["gnss_tractor_time_s"], return_index=True)
    first = first[np.isfinite(times)]
    times = times[np.isfinite(times)]
    columns = {"time_s": times}
    for body, sensor in (("", "gnss_tractor"), ("trailer_", "gnss_trailer")):
        points = _newest(table, sensor, ("x_m", "y_m"), times)
        latitude, longitude = FRAME.degrees(points).T
        columns[f"{body}latitude_deg"] = latitude
        columns[f"{body}longitude_deg"] = longitude
        columns[f"{body}status"] = _newest(table, sensor, ("status",), times)[:, 0]
    for name, sensor in (
        ("steering", "steering_tractor"),
        ("trailer_steering", "steering_trailer"),
        ("hitch", "hitch"),
    ):
        columns[f"{name}_deg"] = np.degrees(_newest(table, sensor, ("rad",), times)[:, 0])
    columns["wheel_speed_kmh"] = 3.6 * _newest(table, "encoder", ("mps",), times)[:, 0]
    imu = _newest(table, "imu_tractor", ("yaw_rate_radps", "roll_rad", "pitch_rad"), times)
    for name, values in zip(("yaw_rate_degps", "roll_deg", "pitch_deg"), imu.T, strict=True):
        columns[name] = np.degrees(values)
    control = record["/control"]
    row = np.maximum(np.searchsorted(control.time_s, times + 1e-6, side="right") - 1, 0)
    for name, channel in COMMANDS.items():
        columns[f"{name}_command_deg"] = np.degrees(control[f"{channel}_command"][row])
    columns["hydrostat_command"] = control["hp_command"][row]
    rows = np.column_stack(list(columns.values()))
    np.savetxt(file, rows, "%.10f", ",", header=",".join(columns), comments="")
    return file


def _newest(table, sensor, parts, times):
    """Return the newest sample of a sensor at times, by the time at which it was taken."""
    taken = table[f"{sensor}_time_s"]
    known = np.flatnonzero(np.isfinite(taken))
    known = known[np.argsort(taken[known], kind="stable")]
    row = known[np.maximum(np.searchsorted(taken[known], times + 1e-6, side="right") - 1, 0)]
    return np.column_stack([table[f"{sensor}_{part}"][row] for part in parts])


def true_slip_pct(record):
    """Return the mean slip of the rear wheels by distances, after the start."""
    state = record["/state"]
    kept = state.time_s > 8.0
    return 100.0 * (1.0 - state["v_mps"][kept].sum() / state["v_rim_mps"][kept].sum())


def offset_deg(record):
    """Return the mean of the measured front steering angle less the true one."""
    table, state = record["/measurement"], record["/state"]
    taken = table["steering_tractor_time_s"]
    kept = np.isfinite(taken)
    true = np.interp(taken[kept], state.time_s, state["delta_t_rad"])
    return math.degrees(float(np.mean(table["steering_tractor_rad"][kept] - true)))


def true_vehicle(true):
    """Return the model with the true parameters."""
    fields = {
        "wheelbase": "wheelbase_m",
        "hitch_offset": "hitch_offset_m",
        "drawbar_length": "drawbar_m",
        "trailer_length": "trailer_m",
        "steering_lag_t": "front_lag_s",
        "steering_lag_i": "trailer_lag_s",
        "speed_gain": "speed_gain_mps",
        "speed_time_constant": "speed_time_constant_s",
        "dead_time_t": "front_dead_time_s",
        "dead_time_i": "trailer_dead_time_s",
    }
    return Vehicle(**{field: true[key] for field, key in fields.items()})


def part(record, end_s):
    """Return the record up to a time."""
    tables = {}
    for topic, table in record.tables.items():
        kept = table.time_s <= end_s
        tables[topic] = Table(table.channel, table.time_s[kept], table.values[kept])
    return Record(tables, record.events, record.metadata)


def prediction_rms(record, vehicle, scenario, begin_s, ahead=10):
    """Return the rms distance of both positions from those predicted 2 s before [m].

    The filter with `vehicle` gives the state; its model is integrated with the recorded commands.
    """
    noise = scenario.controller.noise.sensor_noise(scenario.sensors)
    recorded = list(ticks(record))
    estimator = named_estimator("ekf", vehicle, noise)
    commands = record["/control"].columns(
        "delta_t_rad_command", "delta_i_rad_command", "hp_command"
    )
    table = record["/measurement"]
    squares = []
    for k, tick in enumerate(recorded):
        estimate = estimator.update(tick.time_s, tick.samples, tick.command)
        if tick.time_s < begin_s or k % 5 or k + ahead >= len(recorded):
            continue
        state = estimate.state.copy()
        disturbance = np.array(estimate.disturbance)
        for step in range(8 * ahead):
            now_s = tick.time_s + 0.025 * step
            row = np.floor((now_s - vehicle.dead_times) / 0.2 + 1e-6).astype(int)
            inputs = commands[np.clip(row, 0, len(commands) - 1), range(3)]
            middle = state + 0.0125 * articulated(state, inputs, vehicle, disturbance)
            state = state + 0.025 * articulated(middle, inputs, vehicle, disturbance)
        at_s = tick.time_s + 0.2 * ahead
        for sensor, point in (
            ("gnss_tractor", state[:2]),
            ("gnss_trailer", trailer_point(state, vehicle)),
        ):
            taken = table[f"{sensor}_time_s"]
            rows = np.flatnonzero(np.abs(taken - at_s) < 0.01)
            if len(rows):
                measured = table.columns(f"{sensor}_x_m", f"{sensor}_y_m")[rows[0]]
                squares.append(float(np.sum((point - measured) ** 2)))
    return math.sqrt(np.mean(squares))
