"""Memory of a guidance between two ticks, as one tree."""

from __future__ import annotations

import copy
from dataclasses import dataclass

from ..detectors.monitors import MonitorsMemory
from ..types import FloatArray
from .supervisor import SupervisorMemory


@dataclass(frozen=True, slots=True)
class GuidanceState:
    """All that a guidance carries from one tick to the next.

    `Guidance.state` shares its arrays with the guidance: it changes with every tick. A copy stays,
    and `Guidance.restore` takes a drive back to it, or branches another drive off:

        >>> from ttempc import Guidance, Vehicle, figure_eight
        >>> guidance = Guidance(Vehicle(), figure_eight())
        >>> estimate = guidance.update(0.0, [])
        >>> before = guidance.state.copy()
        >>> first = guidance.step()
        >>> guidance.restore(before)
        >>> guidance.step() == first
        True

    What was learnt of the vehicle is no part of it.
    """

    tick: int
    """Number of the next control tick."""
    reference_tick: int
    """Tick of the reference at that tick."""
    origin_s: float | None
    """Time stamp of the first update [s], None before it."""
    updated_s: float
    """Time of the last update, from the first one [s]."""
    steps_since_update: int
    """Number of steps since the last update."""
    sent: FloatArray
    """Last command (3,), NaN before the first one."""
    estimate: FloatArray
    """Record `ttempc.layout.ESTIMATE` of the last update."""
    innovations: FloatArray
    """Rows (n, `ttempc.layout.INNOVATION`) of the last update."""
    alarms: FloatArray
    """Rows (n, `ttempc.layout.ALARM`) of the last update."""
    estimator: object
    """Memory of the estimator, see `Estimator.memory`."""
    detectors: MonitorsMemory
    """Record of the built-in detectors, and those of a user."""
    supervisor: SupervisorMemory
    """Record of the guard, of the last tick, and the commands under way."""
    controller: object
    """Memory of the controller, see `Controller.memory`."""
    foresight: tuple[FloatArray, ...] | None = None
    """Memory of the foresight, see `Foresight.memory`; None without one."""

    def copy(self) -> GuidanceState:
        """Return a state that shares nothing with the guidance."""
        return copy.deepcopy(self)
