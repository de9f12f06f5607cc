"""Frame of every tracking controller: feedforward, feedback law, vehicle limits."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from ..layout import ESTIMATE, TICK, estimate_row, estimate_view, new_tick
from ..models.augmented_state import MAPPED
from ..reference.reference import Reference, ReferenceSample, exact_feedforward
from ..types import (
    Command,
    Controller,
    ControlStep,
    Diagnostics,
    Estimate,
    FloatArray,
    Immutable,
    Input,
    SolverReport,
    State,
)
from ..vehicle import CommandLimits, Vehicle


class DisturbanceAhead(Protocol):
    """Changes of the mapped disturbances that are expected."""

    def ahead(self, k: int, count: int) -> FloatArray:
        """Return the changes from tick k to ticks k, k + 1, ... k + count - 1, (count, 3) [rad]."""
        ...

    def known(self, k: int) -> float:
        """Return the share of the variance of the trailer's side slip at tick k that is known."""
        ...


def known_share(sources: Sequence[DisturbanceAhead], k: int) -> float:
    """Return the largest share that one of the sources knows."""
    return max((source.known(k) for source in sources), default=0.0)


def total_ahead(sources: Sequence[DisturbanceAhead], k: int, count: int) -> FloatArray:
    """Return the sum of the changes that all sources expect, (count, 3) [rad]."""
    total = np.zeros((count, MAPPED))
    for source in sources:
        total += source.ahead(k, count)
    return total


View = Callable[[], Estimate]
"""Makes the view of the record `ESTIMATE` of a tick."""

_WARM_UP_OFFSET_M = 0.01  # an error, so that iterative solvers iterate
_WARM_UP_TICKS = 2  # the second one updates solvers that the first one has set up
# Share of speed and hydrostat position by which a law finds a held back vehicle slower than
# planned. Against the distance that the whole lack would cost both steerings act, though the
# reference waits: in a curve the tractor was 0.27 m off. Chosen on `grass`, seeds 9408, 9941, 9942.
_HELD_BACK = 0.2


class FeedbackLaw:
    """Turns an estimate into feedback and robust action; by itself it has neither, nor memory."""

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        """Return the actions of tick `k`; those on the trailer may be of delta_i or of lambda.

        The estimate is finite; `sent` is the command of the previous period (3,).
        """
        return Diagnostics(feedback=np.zeros(len(Input)), robust=np.zeros(len(Input)))

    def act(
        self, k: int, row: FloatArray, view: View, sent: FloatArray, tick: FloatArray
    ) -> Diagnostics | None:
        """Write the actions of tick `k` into the record `TICK`; return what it does not hold.

        `row` is the record `ESTIMATE`, `view` makes the estimate of it; the rest is as of `step`.
        """
        told = self.step(k, view(), sent)
        write_told(told, tick)
        return told

    expected: Sequence[DisturbanceAhead] = ()  # changes of disturbances that a plan may foresee

    def expect(self, sources: Sequence[DisturbanceAhead]) -> None:
        """Let plans foresee the changes of disturbances that the sources expect."""
        self.expected = sources

    report: SolverReport | None = None  # of the last QP that a solver answered, where `act` is None

    def predicted_path(self, k: int) -> FloatArray | None:
        """Return the predicted path at tick `k`, (Np, 4) [m], None where there is none."""

    def diagnostics(self, k: int, tick: FloatArray) -> Diagnostics:
        """Return the view of the record of tick `k` where `act` has returned None."""
        raise NotImplementedError

    def prepare(self, k: int) -> None:
        """Get ready for tick `k`, see `ttempc.types.Controller.prepare`."""

    def resume(self, previous: object) -> None:
        """Continue after the law for other model parameters; one without memory starts anew."""

    def warm_up(self) -> None:
        """Run, after a step, the code that a later one may need besides; on a copy of the law."""


def write_report(report: SolverReport, tick: FloatArray) -> None:
    """Write the report of a QP into the record `TICK`."""
    solver = tick.view(TICK)[0]["solver"]
    solver["accepted"] = report.accepted
    solver["iterations"] = report.iterations
    solver["primal_residual"] = report.primal_residual
    solver["dual_residual"] = report.dual_residual
    solver["status"] = report.code


def write_told(told: Diagnostics, tick: FloatArray) -> None:
    """Write the numbers of a controller's diagnostics into the record `TICK`."""
    t = tick.view(TICK)[0]
    tube = told.tube
    t["control"][:, :3] = np.column_stack([told.feedforward, told.feedback, told.robust])
    if told.modelling_error is not None:
        t["tracking"][7:] = told.modelling_error
    if tube is not None:
        t["tube"] = (tube.inside, tube.margin, *tube.nominal, *tube.half_width)
    if told.solver is not None:
        write_report(told.solver, tick)
    t["leaves_corridor"] = told.leaves_corridor
    t["law"] = -1.0 if told.fallback else 0.0


def _near(value: float, planned: float) -> float:
    """Return the value that is nearest to `value` among those beside the planned one."""
    most = _HELD_BACK * abs(planned)
    return min(max(value, planned - most), planned + most)


class TrackingController(Controller):
    """Feedforward along a precomputed reference, a feedback law, and the vehicle's limits.

    Feedforward and actions are in terms of lambda = beta + delta_i. The command is
    delta_i = lambda - beta with the hitch angle beta of the reference. With `measured_hitch` it is
    delta_i = lambda + `measured_hitch` * beta with the estimated one: a published controller may
    take beta by another sign than this project (erratum 9).

    The vehicle is assumed to start on the reference with its inputs. Beyond the reference's end the
    reference of the last tick is tracked. Estimates must be finite: `ttempc.guidance.supervisor`
    keeps others away.
    """

    def __init__(
        self,
        grid: ReferenceSample,
        feedforward: FloatArray,
        feedback: FeedbackLaw,
        limits: CommandLimits,
        *,
        measured_hitch: float = 0.0,
        space_based: bool = False,
    ) -> None:
        self.space_based = space_based
        self._grid = grid
        self._feedforward = feedforward.copy()  # delta_i = lambda - beta
        if not measured_hitch:
            self._feedforward[:, Input.DELTA_I] -= grid.hitch_angle[: len(feedforward)]
        self.feedback = feedback
        self._limits = limits
        self._measured_hitch = measured_hitch
        self._previous = limits.clamp(grid.inputs[0])

    def warm_up(self) -> None:
        """Run the code of whole steps once: compilation, solver set-up, caches.

        The steps are those of a copy, on an estimate beside the start of the reference. No later
        result changes. Call it before the first tick.
        """
        controller = copy.deepcopy(self)
        state = self._grid.state[0].copy()
        state[State.Y] += _WARM_UP_OFFSET_M
        estimate = Estimate(
            time_s=0.0,
            state=state,
            covariance=np.zeros((len(State), len(State))),
            trailer_xy=self._grid.trailer_xy[0],
            hitch_angle=float(self._grid.hitch_angle[0]),
        )
        for k in range(_WARM_UP_TICKS):
            controller.prepare(k)
            controller.step(estimate, k)
        controller.feedback.warm_up()

    def resume(self, previous: object) -> None:
        """Continue after a controller for other model parameters, see `Controller.resume`.

        The rate limits start at its last command.
        """
        if isinstance(previous, TrackingController):
            self._previous = previous._previous
            self.feedback.resume(previous.feedback)

    def prepare(self, k: int) -> None:
        self.feedback.prepare(min(k, len(self._feedforward) - 1))

    def act(
        self, row: FloatArray, view: View, k: int, sent: FloatArray, tick: FloatArray
    ) -> Diagnostics | None:
        """Write the actions of tick `k`, without limits; the rest is as of `FeedbackLaw.act`.

        A law sees little of the speed that the guard takes from the vehicle, see `_HELD_BACK`.
        """
        k = min(k, len(self._feedforward) - 1)
        t = tick.view(TICK)[0]
        if t["stopping"] or t["waits"] or t["reason"]:
            row, view, sent = self._held_back(k, row, view, sent)
        told = self.feedback.act(k, row, view, sent, tick)
        control = t["control"]
        control[:, 0] = self._feedforward[k]
        if self._measured_hitch:
            angle = row.view(ESTIMATE)[0]["hitch_angle"]
            control[Input.DELTA_I, 0] += self._measured_hitch * angle
        return told

    def _held_back(
        self, k: int, row: FloatArray, view: View, sent: FloatArray
    ) -> tuple[FloatArray, View, FloatArray]:
        """Return copies of estimate, its view and command near the planned speed of tick `k`."""
        estimate = row.copy()
        state = estimate.view(ESTIMATE)[0]["state"]
        state[State.V] = _near(state[State.V], self._grid.state[k, State.V])
        command = sent.copy()
        planned = self._feedforward[max(k - 1, 0), Input.HP]
        command[Input.HP] = _near(command[Input.HP], planned)
        return estimate, lambda: estimate_view(estimate, view().innovations), command

    def view(self, k: int, tick: FloatArray) -> Diagnostics:
        """Return the view of the record of tick `k` where `act` has returned None."""
        return self.feedback.diagnostics(min(k, len(self._feedforward) - 1), tick)

    def step(self, estimate: Estimate, k: int) -> ControlStep:
        """Return the command for the period that starts at tick `k`, as a `Controller`.

        It is for controllers around this one: the guidance asks `act`, and limits the command.
        """
        tick = new_tick()
        before = self._previous
        told = self.act(estimate_row(estimate), lambda: estimate, k, before, tick)
        control = tick.view(TICK)[0]["control"]
        self._previous, changed = self._limits.apply(control[:, :3].sum(axis=1), before)
        limited = changed | self._limits.holds(self._previous, before)
        told = told or self.view(k, tick)
        diagnostics = replace(told, feedforward=control[:, 0].copy(), limited=limited)
        return ControlStep(Command(*self._previous.tolist()), diagnostics)


class ExactCourse(Immutable):
    """A reference at control ticks, and the inputs of its exact geometry as feedforward.

    `grid` has N + 1 ticks, to the end of the reference and `beyond` further; `feedforward`
    (delta_t, delta_i, hp) those of the N periods between them, (N, 3).
    """

    def __init__(self, reference: Reference, period_s: float, beyond: int = 1) -> None:
        self.reference = reference
        self.vehicle = reference.vehicle
        self.period_s = period_s
        self.grid = reference.on_grid(period_s, beyond=beyond)
        self.feedforward = exact_feedforward(reference, len(self.grid.time_s) - 1, period_s)
        self.limits = CommandLimits.of(self.vehicle, period_s)
        self._ticks = len(self.grid.time_s) - beyond

    def controller(self, law: FeedbackLaw) -> TrackingController:
        """Compose the feedforward and a law with the limits of the vehicle."""
        as_lambda = self.feedforward[: self._ticks].copy()
        as_lambda[:, Input.DELTA_I] += self.grid.hitch_angle[: self._ticks]
        return TrackingController(self.grid, as_lambda, law, self.limits)


def feedforward_controller(
    vehicle: Vehicle, reference: Reference, period_s: float
) -> TrackingController:
    """Compose the exact feedforward alone: what the reference asks for, whatever happens."""
    return ExactCourse(reference, period_s).controller(FeedbackLaw())
