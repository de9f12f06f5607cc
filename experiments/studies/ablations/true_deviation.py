"""Tube of the true deviation by three routes, and what the linear model leaves out at its edge.

    python -m experiments.studies.ablations.true_deviation [LAPS]
                                                   (default: 6 laps of `grass`, seeds from 1001)

`ttempc-tube` adds the set of estimation errors to the tube of the estimate's deviation, although
the residuals of the estimate contain the filter's answer to these errors already. The deviation
d = z - zbar of the true error from the nominal one obeys, with the estimation error e = z - zhat
and the residual w_t of the true error,

    d(k+1) = (A + B K) d(k) + w_t(k) - B K e(k),

so that the residual w_t - B K e alone gives a tube of d: the output-feedback form of Mayne,
Rakovic, Findeisen and Allgoewer (2006) with e in the disturbance. Each route has the same gain K,
fitted laps, windows and coverage.

The remainder of the linear model is the difference between the exact step and A d + B K d at random
corners of the box around the widest tube, largest in absolute value by component. The tube is valid
where model and plant differ by it once it is a set of single steps of its own, which widens the
tube by the last row. The steering follows its command here without a limit of its rate, because the
tightened inputs keep to that limit.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.integrate import solve_ivp

from ttempc.models.kinematics import articulated, wrap_angle
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.reference.reference import Reference
from ttempc.tube.reference_tube import report_rows, tracking_system
from ttempc.tube.sets import DisturbanceSet, fit_set
from ttempc.tube.tube import TrackingSystem, invariant_tube
from ttempc.types import FloatArray, State

from ...results.containment import QUANTITIES
from ...seeds import FITTING
from ...tubes.fit import COVERAGE, WINDOW_STEPS, FitRun, fit_tube
from ..batch import run_tasks
from ..containment import CASES, fit_lap

LAPS: Final = 6
CASE: Final = "grass-soil"
CORNERS: Final = 30  # at each of the ticks
EVERY: Final = 40  # ticks
FLOOR: Final = 0.01  # of the half width of W, below which no component of the remainder is taken
_N: Final = len(State)
_SHOWN: Final = ("y_t_e_m", "x_t_e_m", "y_i_e_m", "x_i_e_m")
_WIDE: Final = 100.0  # [rad/s], a steering rate that limits nothing


def half_widths(system: TrackingSystem, disturbance: DisturbanceSet) -> FloatArray:
    """Return the half widths of the tube in all `QUANTITIES`, (T, 9)."""
    tube = invariant_tube(system, disturbance)
    return np.concatenate([tube.states, tube.outputs[:, 2:]], axis=1)


def true_residuals(run: FitRun, system: TrackingSystem) -> FloatArray:
    """Return w_t - B K e of a run, (n, 7)."""
    tick = run.errors.tick[:-1].astype(int)
    action = (system.b @ system.gains)[tick]
    return run.residuals.true - np.einsum("kij,kj->ki", action, run.errors.estimation[:-1])


def exact_step(
    reference: Reference, period_s: float, tick: int, error: FloatArray, u_e: FloatArray
) -> FloatArray:
    """Return z_e after a period from z_e (7,) under u_e (3,), by the exact model without limits."""
    unlimited = replace(reference.vehicle, steering_rate_t=_WIDE, steering_rate_i=_WIDE)
    ends = reference.at(np.array([tick, tick + 1]) * period_s)
    inputs = reference.at(np.array([(tick + 0.5) * period_s])).inputs[0]

    def after(start: FloatArray, held: FloatArray) -> FloatArray:
        motion = solve_ivp(
            lambda _, state: articulated(state, held, unlimited),
            (0.0, period_s),
            start,
            rtol=1e-8,
            atol=1e-10,
        )
        return motion.y[:, -1]

    start = ends.state[0] - _turned(error, ends.state[0, State.PSI_T])
    # The reference itself takes an exact step, so that its own curvature is no remainder.
    difference = after(ends.state[0], inputs) - after(start, inputs - u_e)
    for yaw in (State.PSI_T, State.PSI_I):
        difference[yaw] = wrap_angle(difference[yaw])
    return _turned(difference, -ends.state[1, State.PSI_T])


def remainder(
    reference: Reference,
    period_s: float,
    system: TrackingSystem,
    widths: FloatArray,
    generator: np.random.Generator,
) -> FloatArray:
    """Return the largest difference between the exact and the linear step, (7,).

    Args:
        reference: along which the model is linearised.
        period_s: of a step [s].
        system: linear model with its gain.
        widths: half widths of the box whose corners are taken, (T, 7).
        generator: of the corners.
    """
    largest = np.zeros(_N)
    for tick in range(0, len(widths) - 1, EVERY):
        for _ in range(CORNERS):
            error = widths[tick] * generator.choice([-1.0, 1.0], _N)
            u_e = system.gains[tick] @ error
            linear = system.a[tick] @ error + system.b[tick] @ u_e
            exact = exact_step(reference, period_s, tick, error, u_e)
            largest = np.maximum(largest, np.abs(exact - linear))
    return largest


def _turned(error: FloatArray, angle: float) -> FloatArray:
    """Return an error with its position turned by an angle [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, *rest = error
    return np.array([cos * x - sin * y, sin * x + cos * y, *rest])


def main(laps: int = LAPS) -> None:
    """Print the table of half widths and the remainder."""
    runs = list(run_tasks(fit_lap_of_case, FITTING[:laps]))
    design = fit_tube(runs).file.design()
    reference = runs[0].reference
    ticks = int(reference.duration_s / design.period_s)
    system = tracking_system(*error_dynamics(reference, design.period_s, ticks), design.weights)
    rows = report_rows(system.c)
    of_estimate = design.estimate_error.support(rows.reshape(-1, _N)).reshape(rows.shape[:2])
    residuals = [true_residuals(run, system) for run in runs]
    shipped = half_widths(system, design.disturbance)
    routes = {"deviation of the estimate, plus estimation errors": shipped + of_estimate}
    for shape in ("box", "zonotope"):
        disturbance = fit_set(residuals, COVERAGE, WINDOW_STEPS, shape)
        routes[f"deviation of the true state, {shape}"] = half_widths(system, disturbance)
    generator = np.random.default_rng(laps)
    left_out = remainder(reference, design.period_s, system, shipped[:, :_N], generator)
    least = FLOOR * design.disturbance.support(np.eye(_N))
    routes["for the remainder at its edge, beside any of them"] = half_widths(
        system, DisturbanceSet(np.diag(np.maximum(left_out, least)), 1, "box")
    )
    print("| tube | tractor across, along [m] | trailer across, along [m] |\n|---|---|---|")
    for label, widths in routes.items():
        y_t, x_t, y_i, x_i = (widths[:, QUANTITIES.index(name)].max() for name in _SHOWN)
        print(f"| {label} | {y_t:.3f}, {x_t:.3f} | {y_i:.3f}, {x_i:.3f} |")
    x, y, psi_t, psi_i = 1e3 * left_out[:4]
    print(
        f"\nRemainder of a step: {x:.1f} mm along, {y:.1f} mm across, {psi_t:.1f} and "
        f"{psi_i:.1f} mrad of yaw of tractor and trailer."
    )


def fit_lap_of_case(seed: int) -> FitRun:
    """Drive a lap that the tube is fitted to."""
    return fit_lap(CASES[CASE], seed)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
