"""Observation of a policy, and a residual of it on the command of a controller."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.guidance.own_parts import HasStep, as_controller
from ttempc.laws.tracking_controller import TrackingController, View
from ttempc.layout import TICK
from ttempc.models.kinematics import Error, estimated_error
from ttempc.reference.reference import Reference
from ttempc.types import (
    Command,
    Controller,
    ControlStep,
    Diagnostics,
    Estimate,
    FloatArray,
    Input,
    State,
)
from ttempc.vehicle import CommandLimits

from ....testbed.recording.channels import TRACKING

_AHEAD_S: Final = (1.0, 2.0, 3.0)  # of the curvatures; assumed: the vehicle is 3.4 s long at 1 m/s
ESTIMATE_NAMES: Final = (
    *TRACKING.fields[: len(Error)],
    "delta_t_rad",
    "delta_i_rad",
    "v_mps",
    "beta_rad",
    "slip_t_rad",
    "slip_i_rad",
    "steering_rad",
    "drive_mps2",
    "wheel_slip",
    "curvature_per_m",
    *(f"curvature_in_{ahead:g}_s_per_m" for ahead in _AHEAD_S),
    "delta_t_reference_rad",
    "delta_i_reference_rad",
    "hp_reference",
    "delta_t_command_rad",
    "delta_i_command_rad",
    "hp_command",
)
"""Entries of an observation: estimate, reference at a tick and ahead of it, last command."""

# By the unit at the end of a name: a modulus that no vehicle reaches, and one that few exceed, by
# which an entry is divided where it is scaled; both assumed.
_BOUNDS: Final = {
    "per_m": (10.0, 0.2),
    "rad": (2.0 * math.pi, math.pi),
    "mps": (20.0, 5.0),
    "mps2": (20.0, 1.0),
    "e_m": (1e4, 2.0),  # scale of an error
}
_NO_UNIT: Final = (10.0, 1.0)


def bounds(names: Sequence[str]) -> FloatArray:
    """Return bound and scale of each named entry of an observation, (2, n), in its unit."""
    words = (name.split("_") for name in names)
    ends = (("_".join(word[-2:]), word[-1]) for word in words)
    return np.array([_BOUNDS.get(two, _BOUNDS.get(one, _NO_UNIT)) for two, one in ends]).T


class EstimateObserver:
    """Observation of what a controller sees, in `ESTIMATE_NAMES`; errors in the bodies' frames.

    Entries are cut to `bounds`; one that is not finite is 0.
    """

    def __init__(self, reference: Reference, period_s: float) -> None:
        self._bounds = bounds(ESTIMATE_NAMES)[0]
        self._grid = reference.on_grid(period_s)
        self._last = len(self._grid.time_s) - 1
        ahead = np.array([0, *(round(time_s / period_s) for time_s in _AHEAD_S)])
        places = np.minimum(np.arange(self._last + 1)[:, None] + ahead, self._last)
        self._entries = np.column_stack([self._grid.curvature[places], self._grid.inputs])  # (N, 7)

    def observe(self, estimate: Estimate, k: int, sent: FloatArray) -> NDArray[np.float32]:
        """Return the observation at tick `k` after the command `sent` (3,), (n,)."""
        k = min(k, self._last)
        error = estimated_error(estimate, self._grid, k)
        state = estimate.state[State.DELTA_T :]
        hitch = [estimate.hitch_angle]
        reference = self._entries[k]
        entries = np.concatenate([error, state, hitch, estimate.disturbance, reference, sent])
        finite = np.where(np.isfinite(entries), entries, 0.0)
        return np.minimum(np.maximum(finite, -self._bounds), self._bounds).astype(np.float32)


Residual = Callable[[Estimate, int, FloatArray], FloatArray]
"""Returns an action (3,) in [-1, 1] from the estimate, the tick and the last command (3,)."""


def half_range(limits: CommandLimits) -> FloatArray:
    """Return half the range of every command, (3,)."""
    return 0.5 * (limits.upper - limits.lower)


def add_residual(
    inner: HasStep, residual: Residual, share: float, reference: Reference, period_s: float
) -> Controller:
    """Return a controller that adds a share of the range to the commands of another one.

    An action of 0 leaves every bit of the other's commands.

    Args:
        inner: the other controller.
        residual: chooses the action; entries beyond [-1, 1] are cut, one that is no number is 0.
        share: of half the range of a command that an action of 1 adds.
        reference: that of the controller.
        period_s: of control.
    """
    limits = CommandLimits.of(reference.vehicle, period_s)
    scale = share * half_range(limits)

    def added(estimate: Estimate, k: int, sent: FloatArray) -> FloatArray:
        action = np.minimum(np.maximum(residual(estimate, k, sent), -1.0), 1.0)
        return scale * np.where(np.isnan(action), 0.0, action)

    if isinstance(inner, TrackingController):
        return _Within(inner, added)
    return _Around(as_controller(inner), added, limits, limits.clamp(reference.at(0.0).inputs))


class _Within(TrackingController):
    """Adds to the actions of a controller of the library, before the guidance limits them."""

    def __init__(self, inner: TrackingController, added: Residual) -> None:
        vars(self).update(vars(inner))
        self._inner = inner
        self._added = added
        self._last = np.zeros(len(Input))

    def warm_up(self) -> None:
        """Warm the other controller up; nothing is asked for an action."""
        self._inner.warm_up()

    def resume(self, previous: object) -> None:
        """Continue after a controller for other model parameters, see `Controller.resume`."""
        super().resume(previous)
        if isinstance(previous, _Within):
            self._last = previous._last

    def act(
        self, row: FloatArray, view: View, k: int, sent: FloatArray, tick: FloatArray
    ) -> Diagnostics | None:
        """Do as the other one on what was sent without the residual, and book that as robust."""
        told = super().act(row, view, k, sent - self._last, tick)
        self._last = self._added(view(), k, sent)
        tick.view(TICK)[0]["control"][:, 2] += self._last
        return told


class _Around(Controller):
    """Adds to the commands of a user's controller."""

    def __init__(
        self, inner: Controller, added: Residual, limits: CommandLimits, sent: FloatArray
    ) -> None:
        self._inner = inner
        self._added = added
        self._limits = limits
        self._sent = sent
        self.space_based = inner.space_based

    def step(self, estimate: Estimate, k: int) -> ControlStep:
        """Return the command for the period that starts at tick `k`."""
        step = self._inner.step(estimate, k)
        if isinstance(step, Command):
            step = ControlStep(step)
        residual = self._added(estimate, k, self._sent)
        self._sent, changed = self._limits.apply(step.command.as_array() + residual, self._sent)
        told = step.diagnostics
        told = replace(told, robust=told.robust + residual, limited=told.limited | changed)
        return ControlStep(Command(*self._sent.tolist()), told)
