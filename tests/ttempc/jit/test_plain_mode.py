"""With `NUMBA_DISABLE_JIT=1` a debugger stops in every kernel, and the numbers agree."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import types

import numpy as np

CONTROLLERS = ("ttempc", "paper", "nmpc-rti", "lqr", "pid")
DRIVE = """
import json, sys
import numpy as np
from ttempc import Guidance, GuidanceSettings, Vehicle, figure_eight
from ttempc.estimation.filter.predict import predict
from ttempc.types import Measurement, Sensor

IMUS = (Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER)

def drive(controller):
    settings = GuidanceSettings(learn=False)
    path = figure_eight(laps=1)
    guidance = Guidance(Vehicle(), path, controller=controller, settings=settings)
    rng = np.random.default_rng(9444)
    commands = []
    for tick in range(10):
        time_s = 0.2 * tick
        truth = guidance.reference.at(time_s)
        tractor, trailer = truth.state[:2], truth.trailer_xy
        angles = (truth.state[4], truth.state[5], float(truth.hitch_angle))
        kinds = (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH)
        samples = [
            Measurement(time_s, Sensor.GNSS_TRACTOR, tuple(tractor + rng.normal(0.0, 0.03, 2))),
            Measurement(time_s, Sensor.GNSS_TRAILER, tuple(trailer + rng.normal(0.0, 0.03, 2))),
            Measurement(time_s, Sensor.ENCODER, (truth.state[6] + rng.normal(0.0, 0.1),)),
        ]
        attitude = (0.0, rng.normal(0.0, 0.03), 0.02)
        samples += [Measurement(time_s, kind, attitude) for kind in IMUS]
        for kind, angle in zip(kinds, angles):
            samples.append(Measurement(time_s, kind, (angle + rng.normal(0.0, 0.01),)))
        guidance.update(time_s, samples)
        commands.append(guidance.step().as_array().tolist())
    return commands

json.dump([type(predict).__name__, {name: drive(name) for name in sys.argv[1:]}], sys.stdout)
"""


def drives(*, plain):
    """Return the type of a kernel and the commands of ten ticks by controller, in a process."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    if plain:
        environment["NUMBA_DISABLE_JIT"] = "1"
    process = subprocess.run(
        [sys.executable, "-W", "error", "-c", DRIVE, *CONTROLLERS],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    return json.loads(process.stdout)


def test_plain_python_gives_the_commands_of_the_kernels():
    _, compiled = drives(plain=False)
    kind, plain = drives(plain=True)

    assert kind == types.FunctionType.__name__
    for name in CONTROLLERS:
        np.testing.assert_allclose(plain[name], compiled[name], rtol=0.0, atol=1e-9, err_msg=name)
