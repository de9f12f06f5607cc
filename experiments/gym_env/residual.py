"""Residual on a controller: its command plus an action, within the vehicle's limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ttempc.reference.reference import Reference
from ttempc.types import (
    Command,
    Controller,
    ControlStep,
    Estimate,
    FloatArray,
    Resuming,
    SpaceBased,
    WarmingUp,
)
from ttempc.vehicle import CommandLimits

Residual = Callable[[Estimate, int, FloatArray], FloatArray]
"""Returns an action (3,) in [-1, 1] from the estimate, the tick and the last command (3,)."""


def half_range(limits: CommandLimits) -> FloatArray:
    """Return half the range of every command, (3,)."""
    return 0.5 * (limits.upper - limits.lower)


class ResidualController:
    """Adds a share of the commands' range to the command of another controller.

    An action of 0 leaves every bit of the other controller's commands.

    `residual` chooses the action, one beyond [-1, 1] is cut; `share`: of half the range of a
    command that an action of 1 adds.
    """

    def __init__(
        self,
        inner: Controller,
        residual: Residual,
        share: float,
        reference: Reference,
        period_s: float,
    ) -> None:
        self.inner, self._residual = inner, residual
        self._limits = CommandLimits.of(reference.vehicle, period_s)
        self._scale = share * half_range(self._limits)
        self._sent = self._limits.clamp(reference.at(0.0).inputs)
        self.space_based = isinstance(inner, SpaceBased) and inner.space_based

    def warm_up(self) -> None:
        """Warm the other controller up, see `WarmingUp`."""
        if isinstance(self.inner, WarmingUp):
            self.inner.warm_up()

    def resume(self, previous: object) -> None:
        """Continue after a controller for other model parameters, see `Resuming`."""
        if isinstance(previous, ResidualController):
            self._sent = previous._sent
            if isinstance(self.inner, Resuming):
                self.inner.resume(previous.inner)

    def step(self, estimate: Estimate, k: int) -> ControlStep:
        """Return the command for the period that starts at tick `k`.

        The residual is booked under the robust action.
        """
        step = self.inner.step(estimate, k)
        if isinstance(step, Command):
            step = ControlStep(step)
        action = np.clip(self._residual(estimate, k, self._sent), -1.0, 1.0)
        residual = self._scale * action
        total = step.command.as_array() + residual
        self._sent, changed = self._limits.apply(total, self._sent)
        diagnostics = replace(
            step.diagnostics,
            robust=step.diagnostics.robust + residual,
            limited=step.diagnostics.limited | changed,
        )
        return ControlStep(Command(*self._sent.tolist()), diagnostics)
