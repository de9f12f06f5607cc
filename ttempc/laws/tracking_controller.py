"""The frame of every tracking controller: feedforward, a feedback law, the vehicle's limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..limits import CommandLimits
from ..reference.feedforward import exact_feedforward
from ..reference.reference import Reference, ReferenceSample
from ..types import (
    Command,
    ControlStep,
    Diagnostics,
    Estimate,
    FloatArray,
    Input,
    SolverReport,
    TubeReport,
)
from ..vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class Actions:
    """The actions of one tick, (3,) each: delta_t, lambda (or delta_i, they differ by beta), hp."""

    feedback: FloatArray  # -u_b
    robust: FloatArray  # u_m
    modelling_error: FloatArray | None = None  # (4,) z_m [m]
    predicted_path: FloatArray | None = None  # (Np, 4) [m], map frame
    solver: SolverReport | None = None
    fallback: str = ""
    tube: TubeReport | None = None


class FeedbackLaw(Protocol):
    """Turns an estimate into feedback and robust action."""

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return the actions of tick `k`; `sent` is the command of the period before, (3,)."""
        ...

    def prepare(self, k: int) -> None:
        """Warm up for tick `k`, see `ttempc.types.Preparing`."""
        ...


class NoFeedback:
    """The feedback law that does nothing."""

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return no feedback and no robust action."""
        return Actions(np.zeros(3), np.zeros(3))

    def prepare(self, k: int) -> None:
        """Do nothing: there is nothing to warm up."""


class TrackingController:
    """Feedforward along a precomputed reference, a feedback law, and the vehicle's limits.

    Feedforward and actions speak of lambda = beta + delta_i; sent is delta_i = lambda - beta, with
    the estimated hitch angle beta where `measured_hitch`, else with the reference's.

    The vehicle is taken to start on the reference with its inputs. Beyond the reference's end the
    last tick's reference is tracked. Estimates must be finite: `ttempc.guidance.supervisor` keeps
    others away.
    """

    def __init__(
        self,
        grid: ReferenceSample,
        feedforward: FloatArray,
        feedback: FeedbackLaw,
        limits: CommandLimits,
        *,
        measured_hitch: bool,
    ) -> None:
        self._hitch_angle = grid.hitch_angle
        self._feedforward = feedforward  # (ticks, 3) delta_t, lambda, hp
        self._feedback = feedback
        self._limits = limits
        self._measured_hitch = measured_hitch
        self._previous = limits.clamp(grid.inputs[0])

    def prepare(self, k: int) -> None:
        """Warm up for tick `k`, see `ttempc.types.Preparing`."""
        k = min(k, len(self._feedforward) - 1)
        self._limits.apply(self._feedforward[k], self._previous)
        self._feedback.prepare(k)

    def step(self, estimate: Estimate, k: int) -> ControlStep:
        """Return the command for the period that starts at tick `k`."""
        k = min(k, len(self._feedforward) - 1)
        actions = self._feedback.step(k, estimate, self._previous)
        feedforward = self._feedforward[k].copy()
        beta = estimate.hitch_angle if self._measured_hitch else self._hitch_angle[k]
        feedforward[Input.DELTA_I] -= beta  # delta^i = lambda - beta
        total = feedforward + actions.feedback + actions.robust
        command, limited = self._limits.apply(total, self._previous)
        self._previous = command
        return ControlStep(
            Command(*command.tolist()),
            Diagnostics(
                feedforward=feedforward,
                feedback=actions.feedback,
                robust=actions.robust,
                limited=limited,
                modelling_error=actions.modelling_error,
                predicted_path=actions.predicted_path,
                solver=actions.solver,
                fallback=actions.fallback,
                tube=actions.tube,
            ),
        )


def around_exact_feedforward(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    beyond: int,
    law: Callable[[ReferenceSample, FloatArray], FeedbackLaw],
) -> TrackingController:
    """Compose the exact feedforward with the feedback law that `law` makes for it.

    `law` gets the reference at N + 1 ticks, to the end and `beyond` ticks further, and the
    feedforward (delta_t, delta_i, hp) of the N periods between them, (N, 3).
    """
    grid = reference.on_grid(period_s, beyond=beyond)
    feedforward = exact_feedforward(reference, len(grid.time_s) - 1, period_s)
    ticks = len(grid.time_s) - beyond
    as_lambda = feedforward[:ticks].copy()
    as_lambda[:, Input.DELTA_I] += grid.hitch_angle[:ticks]
    limits = CommandLimits.of(vehicle, period_s)
    feedback = law(grid, feedforward)
    return TrackingController(grid, as_lambda, feedback, limits, measured_hitch=False)
