"""Recovery from an offset beside a straight."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pandas as pd

from ttempc.types import State

from ....testbed.recording.channels import CONTROL
from ....testbed.recording.record import Recorder
from ....testbed.simulation.loop import drive
from ...results.tracking_errors import tracking_errors
from ...run.assembly import assemble
from ...scenario.scenario import load
from ...seeds import report_seeds
from ..study import Case, Row, Study
from ..tables import grouped, label

NEAR_M: Final = 0.10
OFFSETS: Final = ((1.0, 20.0), (-1.0, -20.0), (1.0, -20.0))  # [m] to the left, [deg] turned left


def recover(case: Case, ticks: int = 150) -> Row:
    """Drive a straight line from a lateral offset [m] and a yaw offset of both bodies [deg].

    Args:
        case: its label `offset` is the pair of both, to the left.
        ticks: control periods to drive.

    Returns:
        `travel_m` until both points stay within `NEAR_M` of the path, infinite if they do not;
        `overshoot_m` of the trailer to the other side; `excess`, the largest amount by which a
        command left amplitude or rate, 0 where none did.
    """
    path = f'path={{kind="straight",length_m={ticks / 5.0}}}'
    assembly = assemble(load(case.scenario, (path, *case.overrides))[1], case.seed)
    recorder, (lateral_m, yaw_deg) = Recorder(), case["offset"]
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
    arrived = last < len(errors.time_s)
    sent, vehicle = record[CONTROL], assembly.vehicle
    commands = np.stack([sent[f"{name}_command"] for name in ("delta_t_rad", "delta_i_rad", "hp")])
    most = setup.control_steps * assembly.plant.timestep_s * vehicle.input_rate[:, None]
    low, high = vehicle.input_min[:, None] - commands, commands - vehicle.input_max[:, None]
    beyond = max((np.abs(np.diff(commands)) - most).max(), low.max(), high.max())
    return {
        "travel_m": float(speed * errors.time_s[last]) if arrived else math.inf,
        "overshoot_m": float(max(0.0, (-math.copysign(1.0, lateral_m) * beside[1]).max())),
        "excess": float(max(0.0, beyond)),
    }


def _offset(runs: pd.DataFrame) -> str:
    lateral, yaw = runs["offset"].iloc[0]
    return f"{lateral:+.0f} m, {yaw:+.0f} deg"


STUDIES: Final = (
    Study(
        name="recovery",
        scenarios=("grass", "wet-slope"),
        overrides=(),
        axes={"offset": OFFSETS},
        seeds=report_seeds(2),
        drive=recover,
        table=lambda runs: grouped(
            runs,
            ["scenario", "offset", "seed"],
            {
                "ttempc": label("scenario", "`{}`"),
                "offset": _offset,
                "seed": label("seed"),
                "travel until within 10 cm": label("travel_m", "{:.1f} m"),
                "trailer overshoot": lambda own: f"{100 * own['overshoot_m'].iloc[0]:.0f} cm",
                "limits": lambda own: "kept" if own["excess"].iloc[0] < 1e-9 else "left",
            },
        ),
        checks=(("grass", "ttempc"), ("wet-slope", "ttempc")),
        minutes=0.3,
    ),
)
