"""Records of an articulated law: constants, gains along the reference, memory from tick to tick."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from ..types import FloatArray, Input, State
from ..vehicle import Vehicle

STATES: Final = len(State)
INPUTS: Final = len(Input)
OUTPUTS: Final = 4
"""Position errors of a tick, see `ttempc.mpc.articulated_error.Output`."""
ERRORS: Final = 16
"""Entries of the error on which the MPC acts, see `ttempc.mpc.articulated_error.REFERENCE_ERROR`"""

NOMINAL: Final = 0
"""The MPC alone."""
ONE_STEP: Final = 1
"""MPC, and a robust action or a monitor on the residual of one step of its model."""
TUBE_MPC: Final = 2
"""MPC on the nominal state of a tube, and an ancillary gain."""

OUTSIDE: Final = 1
HELD: Final = 2
BACKUP: Final = 3
WORDS: Final = (
    "",
    "outside its tube: nominal state restarted at the estimate",
    "QP {}: previous feedback held",
    "QP {}: last plan kept by the ancillary gain",
)
"""Why another law than the controller's own acted, by `TICK.law`; {} is the solver's status."""

LAW: Final = np.dtype(
    [
        ("kind", "f8"),  # `NOMINAL`, `ONE_STEP`, `TUBE_MPC`
        ("wheelbase", "f8"),  # [m]
        ("time_constant", "f8"),  # of the drive [s]
        ("disturbances", "f8"),  # 1 where the MPC uses the estimated ones, else 0
        ("saturation", "f8", INPUTS),  # k_s of the robust law; 0: no action
        ("forgetting", "f8"),  # of its autocorrelation, per period
        # Errors above which the MPC does not see them in reverse; 0 forwards
        ("largest_along_m", "f8"),  # of the tractor
        ("largest_across_m", "f8"),  # of the trailer
    ]
)
"""Constants of an articulated law; 0 what it lacks."""

GAIN_SCHEDULE: Final = np.dtype(
    [
        ("gains", "f8", (INPUTS, STATES)),  # of the robust law, divided by its saturation
        ("ancillary", "f8", (INPUTS, STATES)),  # K of the backup plan
        ("half_widths", "f8", STATES + 2),  # of the report, see `TubeReport`
    ]
)
"""Gains at a tick of the reference."""


class Law(NamedTuple):
    """Arrays of an articulated law along a reference of N ticks, with tables of T rows."""

    constants: FloatArray  # record `LAW`
    reference: FloatArray  # state of the reference (N, 7)
    feedforward: FloatArray  # inputs u_r of the reference (N, 3)
    schedule: FloatArray  # records `GAIN_SCHEDULE`, (T, 51)
    faces: FloatArray  # of the tube (T, f, 7), or of the set of disturbances (1, f, 7); (0, 0, 7)
    reserve: FloatArray  # of the inputs, for the ancillary gain at stage j, (Np, T, 3); (0, 0, 3)


MEMORY: Final = np.dtype(
    [
        # of the robust law, see `ttempc.laws.robust_action.correlated_share`, of each input
        ("last_signal", "f8", INPUTS),
        ("product", "f8", INPUTS),
        ("power", "f8", INPUTS),
        ("cut_along", "f8"),  # what the MPC does not see of the error of this tick [m]
        ("cut_across", "f8"),
        ("last_tick", "f8"),  # of a step, -2 before the first
        ("error", "f8", ERRORS),  # on which the MPC acted then
        ("foreseen", "f8", STATES),  # what the plan expected beside the model in that period
        ("feedback", "f8", INPUTS),  # u_b
        ("previous", "f8", INPUTS),  # u_e of the period before it
        ("action", "f8", INPUTS),  # u_m of this tick
        ("total", "f8", INPUTS),  # u_e of this tick, from both
        ("nominal", "f8", STATES),  # zbar of this tick
        ("deviation", "f8", STATES),  # of the estimate from it
        ("next_nominal", "f8", STATES),  # zbar of the coming tick
        ("fallback", "f8"),  # index of `WORDS`
        ("plan_tick", "f8"),  # of the backup plan, -2: none
        ("followed_tick", "f8"),  # last tick at which that plan was followed
        ("plan_error", "f8", ERRORS),  # its error and inputs there
        ("plan_input", "f8", INPUTS),
        ("table_offset", "f8"),  # ticks of the reference beyond the tables, see `ArticulatedLaw`
    ]
)
"""Memory of an articulated law from tick to tick; ticks are rows of the tables."""

TUBE_REPORT: Final = np.dtype(
    [
        ("inside", "f8"),
        ("margin", "f8"),
        ("nominal", "f8", STATES + 2),
        ("half_width", "f8", STATES + 2),
    ]
)
"""Record `TICK.tube`, see `TubeReport`."""

MODELLING_ERROR: Final = STATES
"""First column of the modelling error in `TICK.tracking`; the body error comes before it."""


def new_memory() -> FloatArray:
    """Return the memory before the first tick."""
    memory = np.zeros(MEMORY.itemsize // 8)
    fields = memory.view(MEMORY)[0]
    for name in ("last_tick", "plan_tick", "followed_tick"):
        fields[name] = -2.0
    return memory


def law_of(
    kind: int,
    reference: FloatArray,
    feedforward: FloatArray,
    vehicle: Vehicle,
    rows: int,
    **fields: FloatArray | float,
) -> Law:
    """Return the law of a kind along `reference` (N + 1, 7) and `feedforward` (N, 3).

    The tables have `rows` rows; `fields` are those of `Law`, `LAW` and `GAIN_SCHEDULE` that it has.
    """
    faces = np.asarray(fields.pop("faces", np.zeros((0, 0, STATES))))
    reserve = np.asarray(fields.pop("reserve", np.zeros((0, 0, INPUTS))))
    constants = np.zeros(LAW.itemsize // 8)
    schedule = np.zeros((rows, GAIN_SCHEDULE.itemsize // 8))
    fields |= {
        "kind": kind,
        "wheelbase": vehicle.wheelbase,
        "time_constant": vehicle.speed_time_constant,
    }
    for name, values in fields.items():
        is_constant = name in (LAW.names or ())
        target = constants.view(LAW)[0] if is_constant else schedule.view(GAIN_SCHEDULE)[:, 0]
        target[name] = values
    return Law(
        constants=constants,
        reference=np.ascontiguousarray(reference[: len(feedforward)]),
        feedforward=np.ascontiguousarray(feedforward),
        schedule=schedule,
        faces=faces,
        reserve=reserve,
    )
