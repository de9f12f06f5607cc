"""Replay of recorded samples and commands through an estimator, without physics."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from ttempc.layout import estimate_row as record_of_estimate
from ttempc.learning.window import RecordedTick
from ttempc.types import Command, Estimate, Estimator, Measurement

from ...testbed.configuration.config_io import parse_toml
from ...testbed.log.reader import read_content, record_of
from ...testbed.recording.channels import (
    CONTROL,
    ESTIMATE,
    MEASUREMENT,
    MEASUREMENT_COLUMNS,
    STATE,
    estimate_row,
)
from ...testbed.recording.record import Record
from ..errors import InvalidReplay
from ..run.assembly import model_vehicle
from ..run.user_code import named_estimator
from ..scenario.controller import TRUTH
from ..scenario.scenario import Scenario, ScenarioFile

_CHANNELS: Final = (STATE, MEASUREMENT, ESTIMATE, CONTROL)
_COMMAND: Final = ("delta_t_rad_command", "delta_i_rad_command", "hp_command")
_SAME_TIME_S: Final = 1e-6
_SCENARIO: Final = "scenario.toml"
# Of samples that come at one moment, those of the IMUs come first, as from `SensorSuite`.
SAMPLE_ORDER: Final = sorted(MEASUREMENT_COLUMNS, key=lambda sensor: not sensor.startswith("imu"))


def read_run(
    log: Path, changes: Mapping[str, Any] = MappingProxyType({})
) -> tuple[Record, Scenario]:
    """Return the record of a logged run, and its scenario with tables that replace its values.

    Raises:
        LogError: no such file, not a log of this project, or of another version of it.
        InvalidReplay: the log does not contain its scenario.
        InvalidScenario: a change is not allowed, or a file of the scenario is missing.
    """
    topics = {channel.topic for channel in _CHANNELS}
    content = read_content(log, topics.__contains__)
    data = content.attachments.get(_SCENARIO)
    if data is None:
        raise InvalidReplay(f"{log}: has no {_SCENARIO}, as a log that was cut before its settings")
    text = data.decode(errors="replace")
    source = ScenarioFile(log, parse_toml(text, InvalidReplay, f"{log}: {_SCENARIO}"))
    return record_of(content, _CHANNELS), source.scenario(changes, "--set")


def estimator_of(scenario: Scenario) -> Estimator:
    """Return the estimator of a scenario as a run makes it.

    Raises:
        InvalidReplay: the estimator is the truth, which needs a plant.
        InvalidController, InvalidVehicle, InvalidPlant: as in a run.
    """
    settings = scenario.controller
    if settings.estimator == TRUTH:
        raise InvalidReplay(
            f"controller.estimator: {TRUTH} needs the plant and cannot be replayed; choose another"
        )
    vehicle = model_vehicle(scenario.mission(), scenario, scenario.vehicles())
    noise = settings.noise.sensor_noise(scenario.sensors)
    return named_estimator(settings.estimator, vehicle, noise)


def ticks(record: Record) -> Iterator[RecordedTick]:
    """Yield what the estimator received at every tick of a recorded run.

    Samples are those that the sensors delivered; changes that a stage of a user made to them
    afterwards are not in a record.

    Raises:
        InvalidReplay: the record has no estimates or a tick without a command.
    """
    times = record[ESTIMATE].time_s
    samples = record[MEASUREMENT]
    commands = record[CONTROL].columns(*_COMMAND)
    headings = record[ESTIMATE].columns("psi_t_rad", "psi_i_rad")
    if not len(times) or len(commands) < len(times) - 1:
        raise InvalidReplay(
            f"record: has {len(times)} estimates and {len(commands)} commands; a replay needs an "
            "estimate and a command at every tick"
        )
    begin = 0
    for k, time_s in enumerate(times.tolist()):
        end = int(np.searchsorted(samples.time_s, time_s + _SAME_TIME_S))
        arrived = [sample for row in samples.values[begin:end].tolist() for sample in _samples(row)]
        command = Command(*commands[k - 1].tolist()) if k else None
        psi_t, psi_i = headings[k].tolist()
        yield RecordedTick(time_s, tuple(arrived), command, (psi_t, psi_i))
        begin = end


def replay(record: Record, estimator: Estimator) -> list[Estimate]:
    """Return the estimates of `estimator` at every tick of a recorded run.

    With the estimator of the run they are those of the run, bit for bit.

    Raises:
        InvalidReplay: as `ticks`.
    """
    return [estimator.update(tick.time_s, tick.samples, tick.command) for tick in ticks(record)]


def same_as_recorded(estimates: Sequence[Estimate], record: Record) -> bool:
    """Return whether estimates equal the record's, bit for bit."""
    again = np.array([estimate_row(record_of_estimate(estimate)) for estimate in estimates])
    return np.array_equal(again, record[ESTIMATE].values, equal_nan=True)


def _samples(row: list[float]) -> Iterator[Measurement]:
    """Yield the samples of a row of `MEASUREMENT`; the last column of each is its time."""
    for sensor in SAMPLE_ORDER:
        *value, time_s = row[MEASUREMENT_COLUMNS[sensor]]
        if not math.isnan(time_s):
            status = value.pop() if sensor.startswith("gnss") else 0.0
            if not math.isfinite(status):
                raise InvalidReplay(f"{MEASUREMENT.topic}: a status of {sensor} is no number")
            yield Measurement(time_s, sensor, tuple(value), int(status))
