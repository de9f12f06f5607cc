"""Parts of the articulated MPC as small objects: soft bounds, damped approach, parts of the law.

A `SoftBound` gives rows and bounds to the QP, a `LawPart` gives fields to `law_of`. Each looks at
the `ErrorModel` along the reference and at nothing else of the controller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Protocol

import numpy as np

from ..models.linear import riccati_gains
from ..mpc.articulated_error import (
    Output,
    corridor_bounds,
    damped,
    error_dynamics,
    hitch_bounds,
)
from ..mpc.lmpc import HorizonTuning, OutputBounds
from ..reference.corridor import Corridor
from ..reference.reference import Reference, ReferenceSample
from ..tube.reference_tube import GrowingTube, TubeDesign, report_rows
from ..types import FloatArray, Input, State
from ..vehicle import Vehicle
from .options import ROUNDING, speed_factor
from .tracking_controller import ExactCourse

# Time after which a plan can move a point across its path: the steering's lag, and its first effect
# through the heading. Nearer stages would ask for nothing but slack. Assumed.
_RESPONSE_S: Final = 0.8
# In reverse: heading of the damped approach from farther away, which limits the trailer's error
# across the path on which the MPC acts, and the limit along it; tuned on entries
_CAPTURE: Final = math.radians(25.0)
_AHEAD_M: Final = 0.3
# In reverse: weight of the tractor's damped error, which else swings the bodies; tuned on entries
_TRACTOR_WEIGHT: Final = 0.55


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Linear error model along a reference of N ticks, see `error_dynamics`."""

    reference: Reference
    period_s: float
    grid: ReferenceSample  # of the whole reference
    feedforward: FloatArray  # u_r (N, 3)
    a: FloatArray  # A (N, 16, 16)
    b: FloatArray  # B (N, 16, 3)
    c: FloatArray  # C (N + 1, 4, 16)

    @classmethod
    def along(cls, course: ExactCourse, ticks: int) -> ErrorModel:
        """Return the model of the first `ticks` of a reference."""
        feedforward = course.feedforward[:ticks]
        a, b, c = error_dynamics(course.reference, course.period_s, len(feedforward))
        return cls(course.reference, course.period_s, course.grid, feedforward, a, b, c)

    @property
    def vehicle(self) -> Vehicle:
        """Vehicle of the reference."""
        return self.reference.vehicle

    @property
    def changing_a(self) -> FloatArray:
        """Rows of A that change the state (N, 7, 16), a copy: all of A is much larger."""
        return self.a[:, : len(State)].copy()

    @property
    def changing_b(self) -> FloatArray:
        """The same rows of B, (N, 7, 3)."""
        return self.b[:, : len(State)].copy()


class SoftBound(Protocol):
    """Bounds on outputs of the predicted error."""

    def bounds(self, model: ErrorModel, tuning: HorizonTuning) -> OutputBounds:
        """Return rows and bounds along the reference."""
        ...


@dataclass(frozen=True, slots=True)
class HitchBound:
    """The hitch angle stays within `limit` [rad], less what a tube lets it deviate by."""

    limit: float
    tube: GrowingTube | None

    def bounds(self, model: ErrorModel, tuning: HorizonTuning) -> OutputBounds:
        """Return rows and bounds along the reference, see `hitch_bounds`."""
        spread = np.zeros(tuning.horizon + 1)  # by stage
        if self.tube:
            spread[:-1] = self.tube.hitch
            spread[-1] = self.tube.hitch[-1]
        front = tuning.input_bound[Input.DELTA_T]
        return hitch_bounds(
            model.grid, model.vehicle, self.limit, spread, front, model.a, model.period_s
        )


@dataclass(frozen=True, slots=True)
class CorridorBound:
    """Both axle points and the tool stay in a corridor, from the stage on that a plan can move."""

    corridor: Corridor

    def bounds(self, model: ErrorModel, tuning: HorizonTuning) -> OutputBounds:
        """Return rows and bounds along the reference, see `corridor_bounds`."""
        first = math.ceil(_RESPONSE_S / model.period_s - ROUNDING)
        return corridor_bounds(self.corridor, model.grid, model.c, first, tuning.horizon)


@dataclass(frozen=True, slots=True)
class DampedApproach:
    """The cost weighs y + tau y' while the line is acquired, see `damped`."""

    damping_s: float  # tau

    def outputs(self, model: ErrorModel) -> FloatArray:
        """Return the outputs of that cost (N + 1, 4, 16)."""
        outputs = damped(model.a, model.c, model.period_s, self.damping_s)
        if model.vehicle.reverse:
            outputs[:, Output.TRACTOR_ACROSS] *= _TRACTOR_WEIGHT
        return outputs


class LawPart(Protocol):
    """A part of the law of a tick, by its constants and tables."""

    needs_residual: ClassVar[bool]  # whether it looks at the residual of one step

    def fields(self, model: ErrorModel) -> dict[str, FloatArray | float]:
        """Return fields of `Law`, `LAW` and `GAIN_SCHEDULE`."""
        ...


@dataclass(frozen=True, slots=True)
class Disturbances:
    """The MPC uses the disturbances that the filter estimates, or takes them for 0."""

    used: bool
    needs_residual: ClassVar[bool] = False

    def fields(self, model: ErrorModel) -> dict[str, FloatArray | float]:
        """Return the factor of the disturbances."""
        return {"disturbances": float(self.used)}


@dataclass(frozen=True, slots=True)
class CutInReverse:
    """The MPC sees the error up to that from which the damped approach asks for 25 deg."""

    damping_s: float
    needs_residual: ClassVar[bool] = False

    def fields(self, model: ErrorModel) -> dict[str, FloatArray | float]:
        """Return the largest errors along and across the path [m]."""
        across = self.damping_s * model.reference.speed.top_speed * math.sin(_CAPTURE)
        return {"largest_along_m": _AHEAD_M, "largest_across_m": across}


@dataclass(frozen=True, slots=True)
class RobustAction:
    """Saturated action on the autocorrelated part of the residual, see `robust_gains`.

    The residual is that of a single step, in which at speed the lags of tyres and dead times come
    first: the gains on both steerings fade by the square of `speed_factor`, to 1/16 at 2 m/s.
    """

    saturation: tuple[float, float, float]
    input_weight: tuple[float, float, float]
    memory_s: float
    needs_residual: ClassVar[bool] = True

    def fields(self, model: ErrorModel) -> dict[str, FloatArray | float]:
        """Return saturation, gains in units of it, and the factor of forgetting."""
        gains = robust_gains(model.a, model.b, model.c, self.input_weight)
        top_speed = model.reference.speed.top_speed
        gains[:, : Input.HP] /= speed_factor(model.vehicle, top_speed) ** 2
        saturation = np.array(self.saturation)
        return {
            "saturation": saturation,
            "gains": gains / saturation[:, None],
            "forgetting": math.exp(-model.period_s / self.memory_s),
        }


@dataclass(frozen=True, slots=True)
class BackupPlan:
    """The last plan and the ancillary gain of a growing tube act where a QP has no solution."""

    tube: GrowingTube
    needs_residual: ClassVar[bool] = False

    def fields(self, model: ErrorModel) -> dict[str, FloatArray | float]:
        """Return gain, and its reserve of the inputs."""
        return {"ancillary": self.tube.gains, "reserve": self.tube.reserve}


@dataclass(frozen=True, slots=True)
class StepMonitor:
    """Report whether the residual of each step lies in the set of single steps of a design."""

    design: TubeDesign
    needs_residual: ClassVar[bool] = True

    def fields(self, model: ErrorModel) -> dict[str, FloatArray | float]:
        """Return faces of the set, and half widths of the true error about the nominal one."""
        rows = report_rows(model.c[:-1, :, : len(State)])
        flat = rows.reshape(-1, len(State))
        disturbance = self.design.disturbance
        width = disturbance.support(flat) + self.design.estimate_error.support(flat)
        return {
            "faces": np.ascontiguousarray(disturbance.faces)[None],
            "half_widths": width.reshape(rows.shape[:2]),
        }


def robust_gains(
    a: FloatArray, b: FloatArray, c: FloatArray, input_weight: tuple[float, float, float]
) -> FloatArray:
    """Return K (N, 3, 7) of u_m = k_s tanh(r K z_m / k_s), z_m = z_e - zbar_e, entry by entry.

    K is the LQ gain on the articulated error model along the reference, actuator lags included.
    zbar_e is predicted from the previous error and the input that was sent, so that z_m is the
    residual of one step. The MPC corrects it, for it has happened; the robust action acts on its
    autocorrelated part, r K z_m, with the lag-one autocorrelation

        r = sum f^j w(k-j) w(k-j-1) / sum f^j (w(k-j)^2 + w(k-j-1)^2) / 2,   w = K z_m,

    within [0, 1] and with f = exp(-period / `memory_s`). A, B and C are of `error_dynamics`.

    Raises:
        InvalidTuning: no gain stabilises the last stage.
    """
    n = len(State)
    outputs = c[:-1, :, :n]
    cost = outputs.transpose(0, 2, 1) @ outputs
    return riccati_gains(a[:, :n, :n], b[:, :n], cost, np.array(input_weight))
