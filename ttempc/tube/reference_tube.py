"""A tube along a reference: what it takes of inputs and their rates, and what it leaves."""

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
    """What a tube is made from, along any reference of its vehicle."""

    vehicle: Vehicle
    period_s: float
    disturbance: DisturbanceSet  # what a step adds to the error of the estimate beside the model
    estimate_error: DisturbanceSet  # where the true error lies about the estimated one
    weights: AncillaryWeights

    def differing(self, vehicle: Vehicle, period_s: float) -> str:
        """Return in words what differs from what the tube was made for; empty where it fits."""
        pairs = [("period_s", self.period_s, period_s)]
        for item in fields(Vehicle):
            pairs.append((item.name, getattr(self.vehicle, item.name), getattr(vehicle, item.name)))
        return ", ".join(
            f"{name} {made:.6g} (here {here:.6g})"
            for name, made, here in pairs
            if not math.isclose(made, here, rel_tol=1e-6, abs_tol=1e-12)
        )

    def require(self, vehicle: Vehicle, period_s: float) -> None:
        """Refuse another vehicle or control period than the tube was made for.

        Raises:
            InvalidTube: with what differs.
        """
        if differing := self.differing(vehicle, period_s):
            raise InvalidTube(f"the tube was made for another vehicle: {differing}")


@dataclass(frozen=True)
class ReferenceTube:
    """The tube of a design along a reference, a row for each of T control ticks."""

    vehicle: Vehicle
    a: FloatArray  # (T, 16, 16) error dynamics with disturbances, see `error_dynamics`
    b: FloatArray  # (T, 16, 3)
    c: FloatArray  # (T + 1, 4, 16)
    feedforward: FloatArray  # (T, 3) u_r
    tube: Tube  # of the estimate's deviation from the nominal error
    half_widths: FloatArray  # (T, 9) of the true one, of what `seen` gives
    bounds: StageBounds  # of the nominal input u_e = u_r - u

    @classmethod
    def along(cls, design: TubeDesign, reference: Reference, ticks: int) -> ReferenceTube:
        """Return the tube of `design` at the first `ticks` of the reference.

        Raises:
            InvalidTube: it was made for another vehicle, does not contract, or asks for more of
                an input than there is; with the numbers.
        """
        period_s = design.period_s
        design.require(reference.vehicle, period_s)
        feedforward = exact_feedforward(reference, ticks, period_s)
        a, b, c = error_dynamics(reference, period_s, ticks)
        system = tracking_system(a, b, c, design.weights)
        tube = invariant_tube(system, design.disturbance)
        rows = seen(system.c)
        blur = design.estimate_error.support(rows.reshape(-1, _N)).reshape(rows.shape[:2])
        _require_motion(reference, tube, period_s)
        limits = CommandLimits.of(reference.vehicle, period_s)
        return cls(
            *(reference.vehicle, a, b, c, feedforward, tube),
            half_widths=np.concatenate([tube.states, tube.outputs[:, 2:]], axis=1) + blur,
            bounds=tightened(
                remaining_bounds(feedforward, limits), tube.inputs, tube.rates, period_s
            ),
        )

    @property
    def free_share(self) -> FloatArray:
        """Return the share of each input's range that feedforward and tube leave free, (T, 3).

        The range is from the middle to a stop for a steering angle, and from 0 to 1 for the
        hydrostat; free is what lies between feedforward with tube and the nearer stop.
        """
        low, high = self.vehicle.input_min, self.vehicle.input_max
        room = np.minimum(high - self.feedforward, self.feedforward - low)
        return (room - self.tube.inputs) / high


def tracking_system(
    a: FloatArray, b: FloatArray, c: FloatArray, weights: AncillaryWeights
) -> TrackingSystem:
    """Return the errors of the minimal state under the gains of `weights`, without disturbances."""
    a, b, c = a[:, :_N, :_N], b[:, :_N], c[: len(a), :, :_N]
    before = np.maximum(np.arange(len(a)) - 1, 0)
    return TrackingSystem(a, b, c, gain_schedule(a, b, c, weights), before)


def seen(outputs: FloatArray) -> FloatArray:
    """Return what turns an error (7,) into itself and the trailer point's, (T, 9, 7).

    `outputs` (T, 4, 7) are those of the error dynamics; their first two are states.
    """
    unit = np.tile(np.eye(_N), (len(outputs), 1, 1))
    return np.concatenate([unit, outputs[:, 2:]], axis=1)


def tightened(
    bounds: StageBounds, inputs: FloatArray, rates: FloatArray, period_s: float
) -> StageBounds:
    """Return the Pontryagin difference of `bounds` and what a tube takes.

    Args:
        bounds: on the whole input, (T, m) each.
        inputs: half widths that the tube takes of the inputs, (T, m).
        rates: half widths that it takes of their change in a period, (T, m).
        period_s: of the ticks.

    Raises:
        InvalidTube: nothing is left of an input or of its change; which, when, and by how much.
    """
    left = StageBounds(
        bounds.lower + inputs,
        bounds.upper - inputs,
        bounds.step_lower + rates,
        bounds.step_upper - rates,
    )
    _require_width("", left.lower, left.upper, inputs, period_s)
    _require_width("change in a period of ", left.step_lower, left.step_upper, rates, period_s)
    return left


def _require_width(
    what: str, lower: FloatArray, upper: FloatArray, taken: FloatArray, period_s: float
) -> None:
    missing = lower - upper
    if np.all(missing <= 0.0):
        return
    share = np.divide(missing, taken, out=np.full_like(missing, -np.inf), where=taken > 0.0)
    k, item = np.unravel_index(int(np.argmax(share)), share.shape)
    wanted = float(taken[k, item])
    there = wanted - 0.5 * float(lower[k, item] - upper[k, item])
    scale, unit = (100.0, "%") if item == Input.HP else (_DEGREES, "deg")
    raise InvalidTube(
        f"the tightened set is empty: {k * period_s:.1f} s into the reference the tube takes "
        f"+-{scale * wanted:.2f} {unit} of the {what}{Input(int(item)).name.lower()}, where there "
        f"are +-{scale * there:.2f} {unit}"
    )


def _require_motion(reference: Reference, tube: Tube, period_s: float) -> None:
    """Refuse a tube in which the vehicle may stand still: the model has no course there.

    The other states need no constraint of their own: the steering angles and the speed follow
    their commands with a lag of first order, and stay inside the limits that the commands keep.
    """
    speed = np.abs(reference.at(np.arange(len(tube.states)) * period_s).state[:, State.V])
    left = speed - tube.states[:, State.V]
    k = int(np.argmin(left))
    if left[k] <= 0.0:
        raise InvalidTube(
            f"the tightened set is empty: {k * period_s:.1f} s into the reference the tube takes "
            f"+-{tube.states[k, State.V]:.2f} m/s of a speed of {speed[k]:.2f} m/s"
        )
