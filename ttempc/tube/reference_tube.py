"""Tube along a reference, and the bounds that it leaves to the nominal input."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from ..errors import InvalidTube
from ..limits import CommandLimits
from ..mpc.articulated_error import error_dynamics, remaining_bounds
from ..mpc.qp import StageBounds
from ..reference.feedforward import exact_feedforward
from ..reference.reference import Reference
from ..types import FloatArray, Input, State
from ..vehicle import Vehicle
from .ancillary import AncillaryWeights, gain_schedule
from .disturbance_set import DisturbanceSet
from .tube import TrackingSystem, Tube, invariant_tube

_N = len(State)
_DEGREES = math.degrees(1.0)


@dataclass(frozen=True)
class TubeDesign:
    """Data of a tube, valid along any reference of its vehicle."""

    vehicle: Vehicle
    period_s: float
    disturbance: DisturbanceSet  # of a step: error of the estimate less its prediction
    estimate_error: DisturbanceSet  # true error less the estimated one
    weights: AncillaryWeights  # of the ancillary gain

    def differing(self, vehicle: Vehicle, period_s: float) -> str:
        """Return the values that differ from the design's, as a text; empty where none does."""
        pairs = [("period_s", self.period_s, period_s)]
        for item in fields(Vehicle):
            pairs.append((item.name, getattr(self.vehicle, item.name), getattr(vehicle, item.name)))
        return ", ".join(
            f"{name} {designed:.6g} (here {given:.6g})"
            for name, designed, given in pairs
            if not math.isclose(designed, given, rel_tol=1e-6, abs_tol=1e-12)
        )

    def require(self, vehicle: Vehicle, period_s: float) -> None:
        """Refuse a vehicle or control period other than the design's.

        Raises:
            InvalidTube: with the values that differ.
        """
        if differing := self.differing(vehicle, period_s):
            raise InvalidTube(f"the tube was made for another vehicle: {differing}")


@dataclass(frozen=True)
class ReferenceTube:
    """The tube of a design at T control ticks of a reference."""

    vehicle: Vehicle
    a: FloatArray  # (T, 16, 16) error dynamics with disturbances, see `error_dynamics`
    b: FloatArray  # (T, 16, 3)
    c: FloatArray  # (T + 1, 4, 16)
    feedforward: FloatArray  # (T, 3) u_r
    tube: Tube  # of the deviation of the estimated error from the nominal one
    half_widths: FloatArray  # (T, 9) of the true error's deviation, rows as in `report_rows`
    bounds: StageBounds  # of the nominal input u_e = u_r - u

    @classmethod
    def along(cls, design: TubeDesign, reference: Reference, ticks: int) -> ReferenceTube:
        """Return the tube of `design` at the first `ticks` of the reference.

        Raises:
            InvalidTube: the design is for another vehicle, the tube does not contract, or it needs
                more of an input than the limits leave; with the numbers.
        """
        period_s = design.period_s
        design.require(reference.vehicle, period_s)
        feedforward = exact_feedforward(reference, ticks, period_s)
        a, b, c = error_dynamics(reference, period_s, ticks)
        system = tracking_system(a, b, c, design.weights)
        tube = invariant_tube(system, design.disturbance)
        rows = report_rows(system.c)
        of_estimate = design.estimate_error.support(rows.reshape(-1, _N)).reshape(rows.shape[:2])
        _require_motion(reference, tube, period_s)
        bounds = remaining_bounds(feedforward, CommandLimits.of(reference.vehicle, period_s))
        return cls(
            vehicle=reference.vehicle,
            a=a,
            b=b,
            c=c,
            feedforward=feedforward,
            tube=tube,
            half_widths=np.concatenate([tube.states, tube.outputs[:, 2:]], axis=1) + of_estimate,
            bounds=tightened(bounds, tube.inputs, tube.rates, period_s),
        )

    @property
    def free_share(self) -> FloatArray:
        """Return the share of each input's range that feedforward and tube leave free, (T, 3).

        The range is from the middle to a stop for a steering angle, and from 0 to 1 for the
        hydrostat. Free is the distance from feedforward plus tube to the nearer limit.
        """
        low, high = self.vehicle.input_min, self.vehicle.input_max
        margin = np.minimum(high - self.feedforward, self.feedforward - low)
        return (margin - self.tube.inputs) / high


def tracking_system(
    a: FloatArray, b: FloatArray, c: FloatArray, weights: AncillaryWeights
) -> TrackingSystem:
    """Return the closed error dynamics of the minimal state, without disturbances.

    Args:
        a: A (T, 16, 16) of `error_dynamics`.
        b: B (T, 16, 3).
        c: C (T + 1, 4, 16).
        weights: of the ancillary gain that closes the loop.

    Raises:
        InvalidTube: no gain minimises the cost of `weights`.
    """
    a, b, c = a[:, :_N, :_N], b[:, :_N], c[: len(a), :, :_N]
    return TrackingSystem.along(a, b, gain_schedule(a, b, c, weights), c)


def report_rows(outputs: FloatArray) -> FloatArray:
    """Return the matrices from an error z_e (7,) to the nine entries of a `TubeReport`, (T, 9, 7).

    `outputs` are C (T, 4, 7) of the error dynamics; the first two of them are states.
    """
    unit = np.tile(np.eye(_N), (len(outputs), 1, 1))
    return np.concatenate([unit, outputs[:, 2:]], axis=1)


def tightened(
    bounds: StageBounds, inputs: FloatArray, rates: FloatArray, period_s: float
) -> StageBounds:
    """Return the Pontryagin difference of `bounds` and the input set of a tube, (T, m) each.

    Args:
        bounds: on the whole input, (T, m) each.
        inputs: half widths of the tube in the inputs, (T, m).
        rates: half widths of the tube in the change of the inputs in a period, (T, m).
        period_s: control period [s].

    Raises:
        InvalidTube: the difference is empty in an input or its change; with input, time and both
            half widths.
    """
    difference = StageBounds(
        lower=bounds.lower + inputs,
        upper=bounds.upper - inputs,
        step_lower=bounds.step_lower + rates,
        step_upper=bounds.step_upper - rates,
    )
    _require_width("", difference.lower, difference.upper, inputs, period_s)
    _require_width(
        "change in a period of ", difference.step_lower, difference.step_upper, rates, period_s
    )
    return difference


def _require_width(
    quantity: str, lower: FloatArray, upper: FloatArray, needed: FloatArray, period_s: float
) -> None:
    """Refuse tightened bounds that cross; the message names the worst in relation to `needed`."""
    missing = lower - upper
    if np.all(missing <= 0.0):
        return
    share = np.divide(missing, needed, out=np.full_like(missing, -np.inf), where=needed > 0.0)
    k, item = np.unravel_index(int(np.argmax(share)), share.shape)
    half_width = float(needed[k, item])
    available = half_width - 0.5 * float(missing[k, item])
    scale, unit = (100.0, "%") if item == Input.HP else (_DEGREES, "deg")
    raise InvalidTube(
        f"the tightened set is empty: {k * period_s:.1f} s into the reference the tube takes "
        f"+-{scale * half_width:.2f} {unit} of the {quantity}{Input(int(item)).name.lower()}, "
        f"where +-{scale * available:.2f} {unit} are available"
    )


def _require_motion(reference: Reference, tube: Tube, period_s: float) -> None:
    """Refuse a tube in which the vehicle may stand still, where the model has no course.

    The other states need no constraint of their own: the steering angles and the speed follow
    their commands with a lag of first order, and stay inside the limits that the commands keep.
    """
    speed = np.abs(reference.at(np.arange(len(tube.states)) * period_s).state[:, State.V])
    least = speed - tube.states[:, State.V]
    k = int(np.argmin(least))
    if least[k] <= 0.0:
        raise InvalidTube(
            f"the tightened set is empty: {k * period_s:.1f} s into the reference the tube takes "
            f"+-{tube.states[k, State.V]:.2f} m/s of a speed of {speed[k]:.2f} m/s"
        )
