"""Synthetic logs: all data of a run, written without a simulation."""

import numpy as np
from proving_ground.testbed.log.writer import LogWriter
from proving_ground.testbed.messages.scenery import Scenery
from proving_ground.testbed.recording.channels import (
    CHANNELS,
    MEASUREMENT,
    MEASUREMENT_COLUMNS,
    PREDICTED_PATH_TOPIC,
    REFERENCE_PATH_TOPIC,
    STATE,
)
from proving_ground.testbed.recording.record import Event

from tests.testbed.truths import moments, truth
from ttempc.types import Sensor

PERIOD_S = 0.04
METADATA = {"scenario": "made up", "seed": "7", "ttempc": "0.1.0"}
ATTACHMENTS = {"scenario.toml": 'name = "made up"\n', "model.xml": "<mujoco/>"}
BODIES = ("tractor", "trailer")


def writer(path, **other) -> LogWriter:
    given = {"metadata": METADATA, "attachments": ATTACHMENTS, "scenery": Scenery(BODIES), **other}
    return LogWriter(path, **given)


def feed(sink, duration_s=22.0) -> None:
    """Write all data of a run to a sink, with every kind of double."""
    rng = np.random.default_rng(3)
    sink.path(REFERENCE_PATH_TOPIC, 0.0, np.array([[0.0, 0.0], [0.0, 0.2], [0.0, 0.4]]))
    sink.event(Event(0.0, "info", "start"))
    now = 0.0
    for k in range(round(duration_s / PERIOD_S)):
        for channel in CHANNELS:
            values = rng.normal(size=len(channel.fields))
            first = 0
            if channel is MEASUREMENT:  # a fix must be a finite position at a time of the run
                first = MEASUREMENT_COLUMNS[Sensor.GNSS_TRAILER].stop
                values[[columns.stop - 1 for columns in MEASUREMENT_COLUMNS.values()]] = 0.5 * now
            elif channel is STATE:  # a pose must be finite
                first = STATE.fields.index("psi_d_rad")
                values[:first], values[0], values[2] = 0.0, now, 0.3
            special = (np.nan, -0.0, np.inf, 5e-324)[: len(values) - first]
            values[first : first + len(special)] = special
            sink.row(channel, now, values.tolist())
        bodies = {"body_xyz": rng.normal(size=(2, 3)), "body_quat": rng.normal(size=(2, 4))}
        sink.scenes(moments(truth(time_s=now, **bodies)))
        if k % 5 == 0:
            sink.path(PREDICTED_PATH_TOPIC, now, rng.normal(size=(15, 2)))
        now += PERIOD_S  # adds up rounding errors, as simulated time does
    sink.event(Event(round(now, 9), "error", "roll-over – über Kopf"))
