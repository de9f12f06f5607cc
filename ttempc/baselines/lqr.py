"""Linear-quadratic regulator on the model and outputs of the linear MPC: `lqr`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple

import numpy as np

from ..errors import check_choice, check_positive, check_vector
from ..laws.near_stop import weight_factors
from ..laws.options import steering_step_factors
from ..laws.tracking_controller import (
    ExactCourse,
    FeedbackLaw,
    TrackingController,
    total_ahead,
)
from ..models.augmented_state import MAPPED
from ..models.linear import preview_gains, riccati_gains
from ..mpc.articulated_error import error_dynamics, error_state
from ..reference.reference import GUIDED, Guided, Reference, guided
from ..tuning import SearchRange
from ..types import Diagnostics, Estimate, FloatArray, Input, State
from ..vehicle import Vehicle

_M = len(Input)

_OUTPUTS = 4  # x, y of tractor and trailer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..laws.tracking_controller import DisturbanceAhead

# The gain does not depend on what lies farther ahead: a dozen vehicle lengths at 1 m/s.
_BEYOND_S = 30.0
_PREVIEW_S: Final = 4.0  # over which expected disturbances act; the horizon of the MPCs


@dataclass(frozen=True)
class LqrOptions:
    """Options of `lqr`.

    The hydrostat's steps weigh more than in the MPC. With a weight of 0.02 the LQR, which has no
    bounds, runs into the rates of the valves from an offset of some decimetres and cycles there by
    metres. Those of both steerings grow with the speed as in the MPC, see
    `steering_step_factors`. The weights are the best of 33 sets on the benchmark's trials, on
    tuning seeds.
    """

    search_space: ClassVar[tuple[SearchRange, ...]] = (
        SearchRange("output_weight", 0.5, 12.0, entry=3),
        SearchRange("step_weight", 0.02, 1.0, entry=0),
        SearchRange("step_weight", 0.01, 0.5, entry=1),
        SearchRange("step_weight", 0.04, 1.0, entry=2),
    )

    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 2.5)  # [1/m^2]
    # [1/rad^2], [1/rad^2], for a hydrostat position as a fraction
    step_weight: tuple[float, ...] = (0.2, 0.03, 0.3)
    # Swing of a steering that weighs as much as its steps: these weigh more by the factor
    # 1 + (swing / s)^2, s the largest step of the valve, as bounds do after Bryson and Ho (1975),
    # "Applied optimal control", section 5.2. An LQR knows no bound, and slow valves jack-knife it
    swing_deg: float = 4.0
    # By which steps of the steering weigh more in reverse, where they swing the hitch out at once
    reverse_factor: float = 6.0
    # Largest heading at which the tractor approaches its path from beside [deg]: a cross-track
    # error counts up to that which asks for it
    capture_deg: float = 24.0
    guided: Guided = "tool"  # the point behind that keeps to its line; without a tool the axle

    def __post_init__(self) -> None:
        check_vector("output_weight", self.output_weight, _OUTPUTS, zero=True)
        check_vector("step_weight", self.step_weight, _M)
        check_positive("capture_deg", self.capture_deg)
        check_positive("swing_deg", self.swing_deg, zero=True)
        check_positive("reverse_factor", self.reverse_factor)
        check_choice("guided", self.guided, GUIDED)


class StepProblem(NamedTuple):
    """Linear-quadratic problem of the steps of the inputs, see `step_problem`."""

    a: FloatArray  # (N, n + m, n + m)
    b: FloatArray  # (N, n + m, m)
    cost: FloatArray  # of the states (N + 1, n + m, n + m)
    step_weight: FloatArray  # (m,)

    def gains(self) -> FloatArray:
        """Return the gains K (N, m, n + m) of the steps Delta u_k = -K_k (z_k, u_{k-1})."""
        return riccati_gains(self.a, self.b, self.cost[:-1], self.step_weight, self.cost[-1])

    def preview(self, gains: FloatArray, by_disturbance: FloatArray, stages: int) -> FloatArray:
        """Return the gains (N, stages, m, q) of what `by_disturbance` (N, n, q) adds to z."""
        count, _, inputs = self.b.shape
        held = np.zeros((count, inputs, by_disturbance.shape[2]))
        return preview_gains(
            self.a,
            self.b,
            gains,
            self.cost[:-1],
            self.step_weight,
            self.cost[-1],
            np.concatenate([by_disturbance, held], axis=1),
            stages,
        )


def step_problem(
    a: FloatArray, b: FloatArray, c: FloatArray, output_weight: FloatArray, step_weight: FloatArray
) -> StepProblem:
    """Return the problem of the steps Delta u in state space.

    The steps minimise sum y_k' Q y_k + sum Delta u_k' R Delta u_k over all N stages of

        z_{k+1} = A_k z_k + B_k u_k,    y_k = C_k z_k,    u_k = u_{k-1} + Delta u_k,

    with A (N, n, n), B (N, n, m), C (N + 1, p, n) and the diagonal weights Q (p,), of all
    ticks or of each (N + 1, p), and R (m,). The
    regulator's state is (z_k, u_{k-1}) and its terminal cost C_N' Q C_N.
    """
    count, n, m = b.shape
    augmented = np.zeros((count, n + m, n + m))  # of (z_k, u_{k-1})
    augmented[:, :n, :n] = a
    augmented[:, :n, n:] = b
    augmented[:, n:, n:] = np.eye(m)
    by_step = augmented[:, :, n:]  # a step acts as the previous input does
    cost = np.zeros((count + 1, n + m, n + m))
    weighted = c * np.broadcast_to(output_weight, c.shape[:2])[:, :, None]
    cost[:, :n, :n] = c.transpose(0, 2, 1) @ weighted
    return StepProblem(augmented, by_step, cost, step_weight)


class LqrFeedback(FeedbackLaw):
    """Time-varying state feedback on the error and the estimated disturbances.

    The previous input is the one that was sent, so that what the limits cut off does not wind up.
    """

    def __init__(self, course: ExactCourse, options: LqrOptions) -> None:
        a, b, c = error_dynamics(course.reference, course.period_s, len(course.feedforward))
        steps = np.array(options.step_weight)
        largest = course.vehicle.input_rate[: Input.HP] * course.period_s
        steps[: Input.HP] *= 1.0 + (math.radians(options.swing_deg) / largest) ** 2
        steps[: Input.HP] *= steering_step_factors(course.vehicle, course.reference.speed.top_speed)
        if course.vehicle.reverse:
            steps[: Input.HP] *= options.reverse_factor
        factors = weight_factors(course.reference, len(c), course.period_s)
        problem = step_problem(a, b, c, factors * np.array(options.output_weight), steps)
        self._gains = problem.gains()  # (N, 3, 19)
        self._problem = problem
        self._by_slips = a[:, :, len(State) : len(State) + MAPPED].copy()
        self._by_slips[:, len(State) :] = 0.0  # a change ahead does not last
        self._preview = np.zeros((0, 0, _M, MAPPED))  # (N, stages, 3, 3) of what is expected
        heading = self._gains[:, 0, State.PSI_T] + self._gains[:, 0, State.PSI_I]
        slope = np.abs(heading / self._gains[:, 0, State.Y])
        self._capture = math.radians(options.capture_deg) * slope  # (N,) [m]
        self._course = course

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        course = self._course
        state = error_state(course.grid.state[k], estimate, course.vehicle)
        limit = self._capture[k]
        state[State.Y] = min(max(state[State.Y], -limit), limit)
        previous = course.feedforward[max(k - 1, 0)] - sent  # u_e(k-1)
        u_e = previous - self._gains[k] @ np.concatenate([state, previous])
        if self.expected:
            u_e -= self._ahead(k)
        return Diagnostics(feedback=-u_e, robust=np.zeros(_M))

    def expect(self, sources: Sequence[DisturbanceAhead]) -> None:
        FeedbackLaw.expect(self, sources)
        if sources:
            stages = math.ceil(_PREVIEW_S / self._course.period_s)
            self._preview = self._problem.preview(self._gains, self._by_slips, stages)

    def _ahead(self, k: int) -> FloatArray:
        """Return the step of u_e (3,) against the disturbances that are expected from tick k on."""
        gains = self._preview[k]
        ahead = total_ahead(self.expected, k, len(gains))
        return np.einsum("jmq,jq->m", gains, ahead)


def lqr_controller(
    vehicle: Vehicle, reference: Reference, period_s: float, options: LqrOptions = LqrOptions()
) -> TrackingController:
    """Compose the exact feedforward and the LQR of the articulated error model."""
    beyond = math.ceil(_BEYOND_S / period_s)
    course = ExactCourse(guided(reference, options.guided), period_s, beyond)
    return course.controller(LqrFeedback(course, options))
