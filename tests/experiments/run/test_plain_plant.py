"""The plants of two scenarios move alike by compiled steps, MuJoCo's own, and kernels of Python."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

# 400 physics steps: in Python each takes some 5 ms. For the same reason the first process hands its
# settled vehicle over: settling takes some 1,500 steps more.
TICKS = 4
STOPS = 5

DRIVE = """
import json, pickle, sys
from pathlib import Path
import numpy as np
from proving_ground import load
from proving_ground.experiments.run.assembly import assemble
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.wheels.tyre_kernel import wheel_step
from ttempc import Command

name, ticks, stops, settled = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
if settled.exists():
    start = pickle.loads(settled.read_bytes())
    Plant.reset = lambda plant, *pose: plant.restore(start)
# The commands are the reference's; a law that prepares much would only cost time in Python.
assembly = assemble(load(name, ["controller.name=pid"])[1], 9445)
plant = assembly.plant
if not settled.exists():
    settled.write_bytes(pickle.dumps(plant.snapshot()))

period_s = assembly.guidance.period_s
stride = round(period_s / plant.timestep_s) // stops
blocks = []
for tick in range(ticks):
    command = Command(*assembly.guidance.reference.at(tick * period_s).inputs)
    truths = plant.drive(command, stops, stride)
    blocks.append(np.hstack([part.reshape(stops, -1) for part in truths]))
kinds = [type(plant._steps).__name__, type(wheel_step).__name__]
json.dump([*kinds, np.concatenate(blocks).tolist()], sys.stdout)
"""


def drive(name, settled, **environment):
    """Return the kinds of steps and of kernels, and the truths of the first ticks."""
    path = os.pathsep.join(filter(None, sys.path))
    process = subprocess.run(
        [sys.executable, "-W", "error", "-c", DRIVE, name, str(TICKS), str(STOPS), str(settled)],
        env={**os.environ, "PYTHONPATH": path, **environment},
        check=True,
        capture_output=True,
        text=True,
    )
    steps, kernels, rows = json.loads(process.stdout)
    return steps, kernels, np.array(rows)


@pytest.mark.parametrize("name", ["grass", "cultivate"])
def test_plain_steps_and_plain_kernels_move_a_plant_as_compiled_ones_do(name, tmp_path):
    settled = tmp_path / "settled"
    steps, kernels, compiled = drive(name, settled)
    assert steps == "CompiledSteps"
    assert len(compiled) == TICKS * STOPS

    steps, kernels, by_mujoco = drive(name, settled, TTEMPC_PLAIN="1")
    assert (steps, kernels) == ("PlainSteps", "Kernel")
    np.testing.assert_allclose(by_mujoco, compiled, rtol=1e-9, atol=1e-9)

    steps, kernels, in_python = drive(name, settled, NUMBA_DISABLE_JIT="1")
    assert (steps, kernels) == ("PlainSteps", "function")
    np.testing.assert_allclose(in_python, compiled, rtol=1e-9, atol=1e-9)
