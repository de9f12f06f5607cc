"""Commands as they act on the vehicle, each input after its own dead time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..types import FloatArray, Input
from ..vehicle import Vehicle
from .prediction_kernel import SAME_TIME_S

HeldCommands = list[tuple[float, FloatArray | None]]
"""End time [s] and value (3,) of each of the commands held one after the other; the first one was
held before, too. NaN where an input's command is not known; None where none is."""


def after_dead_times(
    sent: Sequence[tuple[float, FloatArray | None]], vehicle: Vehicle
) -> HeldCommands:
    """Return what acts on `vehicle` until the end of the newest of the commands `sent`."""
    dead_times = vehicle.dead_times
    if not sent or not dead_times.any():
        return list(sent)
    ends_s = np.array([end_s for end_s, _ in sent])
    unknown = np.full(len(Input), np.nan)
    values = np.array([unknown if command is None else command for _, command in sent])
    changes_s = np.unique(np.append(ends_s[:, None] + dead_times, ends_s[-1]))
    changes_s = changes_s[changes_s <= ends_s[-1]]
    # What acts just before a change was sent a dead time earlier.
    index = np.searchsorted(ends_s, changes_s[:, None] - dead_times - SAME_TIME_S)
    acting = values[index, range(len(Input))]
    return list(zip(changes_s.tolist(), acting, strict=True))


def acting_command(
    command: FloatArray | None, valves: FloatArray, rim: float, vehicle: Vehicle
) -> FloatArray:
    """Return `command` (3,) with what steadies the vehicle in the place of entries that are NaN.

    Where no command is known (NaN; None for all three), steering and speed are taken as constant:
    at the set points `valves` (2,) [rad] and the speed `rim` [m/s].
    """
    steady = np.array([*valves, rim / vehicle.speed_gain])
    return steady if command is None else np.where(np.isnan(command), steady, command)
