"""A sensor that does not exist yet, a radar over ground, takes additions to three files only."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]

ADDITIONS = {
    "ttempc/sensors.py": {
        "\n\nclass SensorIndex(IntEnum)": """\
    RADAR = "radar"  # (v,) [m/s], speed over ground
""",
        "\n\nclass SensorKind(IntEnum)": """\
    RADAR = 12
""",
        ')\n"""Every sensor, in the order': """\
    SensorRow(
        SensorIndex.RADAR,
        SensorKind.SPEED,
        Body.TRACTOR,
        components=("mps",),
        noise=OTHERS,
        needed_at_start=False,
    ),
""",
    },
    "ttempc/models/measurement.py": {
        '    }\n)\n"""Sensors for which `measure` has': """\
        SensorIndex.RADAR,
""",
        # Without the wheel slip on a slope, which the drive below does not have
        "    return 0\n": """\
    if sensor == SensorIndex.RADAR:
        ratio = 1.0 - x[AugmentedState.WHEEL]
        reading[0] = x[AugmentedState.WHEEL_SPEED] * ratio
        jacobian[0, AugmentedState.WHEEL_SPEED] = ratio
        jacobian[0, AugmentedState.WHEEL] = -x[AugmentedState.WHEEL_SPEED]
        return 1
""",
    },
    "testbed/sensing/sensor_specification.py": {
        "\n    def __post_init__": """\
    radar_on: bool = False
    \"\"\"Whether a radar measures the speed over ground.\"\"\"
    radar_rate_hz: RateHz = 25.0
    \"\"\"Sampling rate of the radar.\"\"\"
    radar_sd_mps: NotNegative = 0.02
    \"\"\"Standard deviation of the radar's speed.\"\"\"
""",
        "        return sensors\n": """\
        if self.radar_on:
            sensors[Sensor.RADAR] = PlainSensor(
                "speed", self.radar_rate_hz, self.radar_sd_mps, latency_s=0.0, resolution=0.0
            )
""",
    },
}
"""Of each file: a text that it has once, and what is added before it."""

DRIVE = """
import json, sys
import numpy as np
from proving_ground.experiments.scenario.controller import NoiseSettings
from proving_ground.testbed.recording.channels import MEASUREMENT
from proving_ground.testbed.sensing.sensor_specification import SensorSpecification
from proving_ground.testbed.sensing.sensors import SensorSuite
from tests.testbed.truths import moments, truth
from ttempc import Guidance, GuidanceSettings, Vehicle
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.layout import InnovationColumn
from ttempc.reference.path import straight
from ttempc.sensors import SensorIndex
from ttempc.types import State

VEHICLE = Vehicle()
LENGTH = VEHICLE.hitch_offset + VEHICLE.drawbar_length + VEHICLE.trailer_length
RIM, SPEED = 1.2, 1.0  # a sixth of wheel slip

def block(first, count):
    times = 0.04 * np.arange(first, first + count)
    return moments(*(
        truth(time_s=t, tractor={"x": SPEED * t}, trailer={"x": SPEED * t - LENGTH},
              speed=SPEED, wheel_speed=RIM)
        for t in times
    )).rows

def drive(radar):
    specification = SensorSpecification(radar_on=radar)
    noise = NoiseSettings().sensor_noise(specification)
    suite = SensorSuite(specification, 0.002, 3, np.zeros((2, 3)))
    ekf, squares, no_command = ExtendedKalmanFilter(VEHICLE, noise), [], np.full(3, np.nan)
    rows, _ = suite.sample(block(0, 1), 0, 20)
    settings = GuidanceSettings(sensor_noise=noise, learn=False)
    guidance = Guidance(VEHICLE, straight(30.0), settings=settings)
    for tick in range(15):
        estimate, innovations = ekf.observe(0.2 * tick, rows, no_command)
        radars = innovations[innovations[:, InnovationColumn.SENSOR] == SensorIndex.RADAR]
        squares += radars[:, InnovationColumn.NORMALISED_SQUARED].tolist()
        if radar and tick < 3:  # detectors and supervisor meet the sensor too
            guidance.update(0.2 * tick, rows)
            guidance.step()
        rows, _ = suite.sample(block(5 * tick + 1, 5), 20 * (5 * tick + 1), 20)
    view = ekf.update(0.2 * 15, rows, None)
    return {
        "squares": squares,
        "error": abs(view.state[State.V] - SPEED),
        "sd": view.covariance[State.V, State.V] ** 0.5,
        "noise": [list(pair) for pair in noise.others],
        "sensors": sorted({str(item.sensor) for item in view.innovations}),
    }

json.dump({
    "with": drive(True),
    "without": drive(False),
    "columns": [name for name in MEASUREMENT.fields if name.startswith("radar")],
}, sys.stdout)
"""


def with_radar(tree: Path) -> None:
    """Write the packages with the additions into a folder."""
    for package in ("ttempc", "testbed", "experiments", "mjcf", "packaging"):
        unwanted = shutil.ignore_patterns("__pycache__", "*.mcap", "*.png", "*.npz")
        shutil.copytree(ROOT / package, tree / package, ignore=unwanted)
    for name, changes in ADDITIONS.items():
        text = (tree / name).read_text(encoding="utf-8")
        for before, addition in changes.items():
            assert text.count(before) == 1, (name, before)
            text = text.replace(before, addition + before)
        (tree / name).write_text(text, encoding="utf-8")


def driven(tree: Path) -> dict:
    """Return what a process with the packages of a folder prints, kernels as Python."""
    folders = (tree / "packaging", tree, ROOT)
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(map(str, folders)),
        "NUMBA_DISABLE_JIT": "1",
    }
    process = subprocess.run(
        [sys.executable, "-c", DRIVE],
        cwd=tree,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    return json.loads(process.stdout)


def test_a_radar_needs_three_files_and_tells_the_speed_over_ground(tmp_path):
    assert len(ADDITIONS) <= 3
    with_radar(tmp_path)
    result = driven(tmp_path)
    radar, without = result["with"], result["without"]

    assert result["columns"] == ["radar_mps", "radar_time_s"]
    assert radar["noise"] == [["radar", 0.02]]
    assert "radar" in radar["sensors"]
    assert "radar" not in without["sensors"]
    # 75 samples of a chi-square with one degree of freedom: mean 1, standard deviation 0.16; the
    # first ones find the slip of the wheels.
    settled = radar["squares"][20:]
    assert 0.4 < sum(settled) / len(settled) < 1.6
    assert radar["sd"] < 0.9 * without["sd"]
    assert radar["error"] < 4.0 * radar["sd"]


@pytest.mark.parametrize("name", ADDITIONS)
def test_the_additions_stand_where_the_guide_says(name):
    """CONTRIBUTING names these files for a new sensor."""
    (row,) = (
        line
        for line in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("| sensor |")
    )
    assert name in row
