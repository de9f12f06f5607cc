"""Recovery of a controller from a metre and 20 degrees beside its path.

    python -m experiments.studies.ablations.recovery [CONTROLLER]      (default: ttempc)

Places the vehicle beside a straight line, both bodies turned by the same angle. Prints the distance
until both axle points stay within 10 cm, the overshoot of the trailer to the other side, and
whether a command left its limits. docs/ablation.md has the table.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.types import Input, State

from ....testbed.recording.channels import CONTROL
from ....testbed.recording.record import Recorder
from ....testbed.simulation.loop import drive
from ...results.tracking_errors import tracking_errors
from ...run.assembly import assemble
from ...scenario.scenario import load
from ...seeds import report_seeds

NEAR_M: Final = 0.10
OFFSETS: Final = ((1.0, 20.0), (-1.0, -20.0), (1.0, -20.0))  # [m] to the left, [deg] turned left
SCENARIOS: Final = ("grass", "wet-slope")
SEEDS: Final = report_seeds(2)


@dataclass(frozen=True, slots=True)
class Recovery:
    """Figures of a recovery."""

    travel_m: float  # until both points stay within `NEAR_M` of the path; inf if they do not
    overshoot_m: float  # of the trailer to the other side
    excess: float  # largest amount by which a command left amplitude or rate; 0 where none did


def recover(
    scenario: str, controller: str, seed: int, lateral_m: float, yaw_deg: float, ticks: int = 150
) -> Recovery:
    """Drive a straight line from an offset.

    Args:
        scenario: a shipped scenario; its path is replaced.
        controller: its name.
        seed: of terrain and noise.
        lateral_m: offset to the left of the path [m].
        yaw_deg: heading offset of both bodies, to the left [deg].
        ticks: control periods to drive.
    """
    path = f'path={{kind="straight",length_m={ticks / 5.0}}}'
    content = load(scenario, [path, f'controller.name="{controller}"'])[1]
    assembly, recorder = assemble(content, seed), Recorder()
    setup = assembly.setup(recorder)
    start = assembly.reference.at(0.0).state.tolist()
    (x, y, yaw), speed = start[:3], start[State.V]
    x, y = x - lateral_m * math.sin(yaw), y + lateral_m * math.cos(yaw)
    assembly.plant.reset(x, y, yaw + math.radians(yaw_deg), speed)
    drive(setup, ticks)
    record = recorder.record()

    errors = tracking_errors(record)
    beside = np.stack([errors.tractor.cross_m, errors.trailer.cross_m])  # (2, n)
    outside = np.flatnonzero(np.abs(beside).max(axis=0) > NEAR_M)
    last = int(outside[-1]) + 1 if len(outside) else 0
    travel = speed * errors.time_s[last] if last < len(errors.time_s) else math.inf
    sent = record[CONTROL]
    commands = np.stack([sent[f"{name}_command"] for name in ("delta_t_rad", "delta_i_rad", "hp")])
    vehicle, period = assembly.vehicle, setup.control_steps * assembly.plant.timestep_s
    steps = np.abs(np.diff(commands)) - period * vehicle.input_rate[:, None]
    beyond = np.maximum(
        vehicle.input_min[:, None] - commands, commands - vehicle.input_max[:, None]
    )
    assert len(commands) == len(Input)
    return Recovery(
        travel_m=float(travel),
        overshoot_m=float(max(0.0, (-math.copysign(1.0, lateral_m) * beside[1]).max())),
        excess=float(max(0.0, steps.max(), beyond.max())),
    )


def main(controller: str = "ttempc", seeds: tuple[int, ...] = SEEDS) -> None:
    """Drive all offsets and print the table."""
    print(
        f"| {controller} | offset | seed | travel until within 10 cm | trailer overshoot | limits |"
    )
    print("|---" * 6 + "|")
    for scenario in SCENARIOS:
        for lateral, yaw in OFFSETS:
            for seed in seeds:
                recovery = recover(scenario, controller, seed, lateral, yaw)
                print(
                    f"| `{scenario}` | {lateral:+.0f} m, {yaw:+.0f} deg | {seed} | "
                    f"{recovery.travel_m:.1f} m | {100.0 * recovery.overshoot_m:.0f} cm | "
                    f"{'kept' if recovery.excess < 1e-9 else 'left'} |",
                    flush=True,
                )


if __name__ == "__main__":
    main((sys.argv[1:] or ["ttempc"])[0])
