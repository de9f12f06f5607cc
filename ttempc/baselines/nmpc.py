"""Nonlinear MPC with the linear MPC's horizon, weights, bounds and information.

Centralised, decentralised and distributed after Kayacan, Peschel and Kayacan (2016),
"Centralized, decentralized and distributed nonlinear model predictive control of a
tractor-trailer system: a comparative study", American Control Conference, pp. 4403-4408.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..laws.articulated_mpc import TUNING
from ..laws.tracking_controller import Actions, TrackingController, around_exact_feedforward
from ..limits import CommandLimits
from ..mpc.articulated_error import lasting_disturbance, map_gains, remaining_bounds
from ..mpc.prediction import rotation
from ..mpc.qp import FirstInputs, HorizonTuning, StageBounds, move_bounds
from ..reference.reference import Reference, ReferenceSample
from ..types import Estimate, FloatArray, Input, SolverReport, State
from ..vehicle import Vehicle
from .nmpc_model import TRACTOR, TRAILER, WHOLE, Subsystem
from .nmpc_solver import GaussNewton, HorizonSolver, Task

_M = len(Input)

SolverFactory = Callable[[Reference, Subsystem, HorizonTuning, float], HorizonSolver]


class NonlinearFeedback:
    """Receding horizons of one NMPC or of several that share the vehicle.

    Every NMPC starts from its own plan of the tick before, shifted. To an NMPC the inputs of the
    others are known: as they plan them (`exchange`, the plans of the tick before, shifted), or
    held as they were last sent.

    Where a QP gives no result that counts the previous input is held; where an NMPC does not
    converge its last plan is driven. Both are said in `Actions.fallback`.
    """

    def __init__(
        self,
        grid: ReferenceSample,
        reference: Reference,
        feedforward: FloatArray,
        period_s: float,
        tuning: HorizonTuning,
        subsystems: Sequence[Subsystem],
        *,
        exchange: bool,
        solver: SolverFactory,
    ) -> None:
        self._tuning = tuning
        self._exchange = exchange
        self._feedforward = feedforward  # u_r (N, 3)
        self._poses = np.hstack(
            [grid.state[:, :3], grid.trailer_xy, grid.state[:, State.PSI_I, None]]
        )
        self._vehicle = reference.vehicle
        middle = reference.at((np.arange(len(feedforward)) + 0.5) * period_s)
        self._turning = map_gains(middle, reference.vehicle)  # (N, 5, 4)
        limits = CommandLimits.of(reference.vehicle, period_s)
        left = remaining_bounds(feedforward, limits)
        bounds = move_bounds(tuning, period_s, len(feedforward), left)
        self._parts = [
            _Part(
                subsystem,
                solver(reference, subsystem, tuning, period_s),
                bounds.at(slice(None), _columns(subsystem, tuning.moves)),
                FirstInputs.of(bounds.at(slice(None), np.array(subsystem.inputs))),
            )
            for subsystem in subsystems
        ]
        to_map = np.zeros((len(grid.time_s), 4, 4))
        to_map[:, :2, :2] = rotation(grid.state[:, State.PSI_T])
        to_map[:, 2:, 2:] = rotation(grid.state[:, State.PSI_I])
        self._to_map = to_map
        self._points = np.hstack([grid.state[:, :2], grid.trailer_xy])
        self._steps = np.zeros((tuning.moves, _M))  # the last plan, Delta u_e

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return the actions of tick `k`."""
        horizon, moves = self._tuning.horizon, self._tuning.moves
        feedforward = self._feedforward[k : k + horizon]
        ends = slice(k + 1, k + 1 + horizon)
        before = self._feedforward[max(k - 1, 0)] - sent  # u_e(k-1)
        guess = np.vstack([self._steps[1:], np.zeros(_M)])
        if self._exchange:
            planned = before + np.cumsum(guess, axis=0)  # (Nc, 3)
            inputs_e = planned[np.minimum(np.arange(horizon), moves - 1)]
        else:
            inputs_e = feedforward - sent  # u = u_r - u_e stays as it is
        staying, turning = lasting_disturbance(estimate, self._vehicle)
        disturbance = staying + self._turning[k : k + horizon] @ turning  # (Np, 5)
        feedback, steps = before.copy(), np.zeros_like(guess)
        errors = np.zeros((horizon, 4))
        plans = []
        for part in self._parts:
            own = list(part.subsystem.inputs)
            task = Task(
                state=estimate.state,
                disturbance=disturbance,
                poses=self._poses[ends],
                feedforward=feedforward,
                inputs_e=inputs_e,
                previous=part.first.within_reach(k, before[own]),
                bounds=part.bounds.at(k),
            )
            plan = part.solver.minimise(task, guess[:, own].reshape(-1))
            plans.append(plan)
            errors[:, list(part.subsystem.outputs)] = plan.errors
            if plan.steps is not None:
                steps[:, own] = plan.steps.reshape(moves, -1)
            feedback[own] = part.first.within(k, task.previous + steps[0, own])
        self._steps = steps
        along = (self._to_map[ends] @ errors[:, :, None])[:, :, 0]
        return Actions(
            feedback=-feedback,
            robust=np.zeros(_M),
            predicted_path=self._points[ends] - along,
            solver=_joined([plan.report for plan in plans]),
            fallback="; ".join(plan.trouble for plan in plans if plan.trouble),
        )

    def prepare(self, k: int) -> None:
        """Warm up for tick `k`, see `ttempc.types.Preparing`."""
        for part in self._parts:
            part.solver.prepare()


@dataclass(frozen=True, slots=True)
class _Part:
    """One NMPC of those that share the vehicle."""

    subsystem: Subsystem
    solver: HorizonSolver
    bounds: StageBounds  # of its own inputs at every tick, (ticks, m Nc)
    first: FirstInputs


def _columns(subsystem: Subsystem, moves: int) -> NDArray[np.intp]:
    """Return where the subsystem's own inputs stand among the steps of all inputs, (m Nc,)."""
    return (_M * np.arange(moves)[:, None] + np.array(subsystem.inputs)).reshape(-1)


def _joined(reports: Sequence[SolverReport]) -> SolverReport:
    """Return one report for all NMPCs of a tick: the sum of their work, the worst of the rest."""
    worst = next((report for report in reports if not report.accepted), reports[0])
    return replace(
        worst,
        iterations=sum(report.iterations for report in reports),
        solve_time_s=sum(report.solve_time_s for report in reports),
        primal_residual=max(report.primal_residual for report in reports),
        dual_residual=max(report.dual_residual for report in reports),
    )


def nmpc_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    tuning: HorizonTuning = TUNING,
    subsystems: Sequence[Subsystem] = (WHOLE,),
    *,
    exchange: bool = False,
    solver: SolverFactory = GaussNewton,
) -> TrackingController:
    """Compose the exact feedforward and the NMPCs of `subsystems`.

    Raises:
        MissingPackage: CasADi is not installed.
    """

    def law(grid: ReferenceSample, feedforward: FloatArray) -> NonlinearFeedback:
        return NonlinearFeedback(
            grid,
            reference,
            feedforward,
            period_s,
            tuning,
            subsystems,
            exchange=exchange,
            solver=solver,
        )

    return around_exact_feedforward(vehicle, reference, period_s, tuning.horizon, law)


nmpc_rti_controller = partial(nmpc_controller, solver=partial(GaussNewton, iterations=1))
nmpc_decentralised_controller = partial(nmpc_controller, subsystems=(TRACTOR, TRAILER))
nmpc_distributed_controller = partial(nmpc_decentralised_controller, exchange=True)
