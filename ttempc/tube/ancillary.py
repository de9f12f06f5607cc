"""The ancillary gain of a tube: Riccati along the reference, its weights searched for a tight tube.

A quadratic cost knows nothing of a tube, but its weights span gains that stabilise; among them the
search takes those whose tube is narrow across the track and leaves the inputs the room asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from ..errors import InvalidTube, InvalidTuning
from ..limits import CommandLimits
from ..mpc.riccati import riccati_gains
from ..types import FloatArray, Input
from .disturbance_set import DisturbanceSet
from .tube import TrackingSystem, Tube, invariant_tube

_CROSS = (1, 3)  # cross-track errors among the outputs x_t, y_t, x_i, y_i
_COARSE = 0.2  # alpha of the tubes of the search: five times as fast, 20 % too wide everywhere
_SLOWEST = 0.98  # a gain whose slowest mode remembers ten seconds leaves no narrow tube
_EVALUATIONS = 700
_START = (0.1, 2.5, 0.05, 2.5, 0.01, 0.01, 0.01, 0.01, 0.01, 0.3, 1.5, 0.9)  # of the weights
_HYDROSTAT_SHARE = 0.8  # of its room that a tube may take
_RATE_SHARE = 0.9  # of the change in a period; where curves begin the feedforward takes the rest
_PENALTY = 3.0  # [m] for a room overdrawn by its whole
_FIRST_SIMPLEX = 1.0  # of the logarithms


@dataclass(frozen=True, slots=True)
class AncillaryWeights:
    """Diagonals of the quadratic cost of which the ancillary gain is the minimiser.

    Raises:
        InvalidTube: a weight is not finite or not above 0.
    """

    outputs: tuple[float, float, float, float]  # x, y of tractor and trailer in their frames
    states: tuple[float, float, float, float, float]  # psi_t, psi_i, delta_t, delta_i, v
    inputs: tuple[float, float, float]  # delta_t, delta_i, hp

    def __post_init__(self) -> None:
        flat = self.flat
        if len(flat) != len(_START) or not (np.isfinite(flat).all() and (flat > 0.0).all()):
            raise InvalidTube(f"weights: got {flat.tolist()}, must be {len(_START)} above 0")

    @property
    def flat(self) -> FloatArray:
        """Return all of them in their order, (12,)."""
        return np.array([*self.outputs, *self.states, *self.inputs])

    @classmethod
    def of(cls, flat: FloatArray) -> AncillaryWeights:
        """Return the weights of which `flat` (12,) are all in their order."""
        values = [float(value) for value in flat]
        return cls(tuple(values[:4]), tuple(values[4:9]), tuple(values[9:]))  # pyright: ignore


def gain_schedule(
    a: FloatArray, b: FloatArray, c: FloatArray, weights: AncillaryWeights
) -> FloatArray:
    """Return K (T, m, n) of u = K z at every tick, by the Riccati recursion from the last one.

    A (T, n, n), B (T, n, m), C (T, p, n). The road of the last tick is taken to go on.

    Raises:
        InvalidTube: on that road no gain minimises the cost.
    """
    outputs, inner = np.array(weights.outputs), np.diag([0.0, 0.0, *weights.states])
    cost = c.transpose(0, 2, 1) @ (outputs[:, None] * c) + inner  # (T, n, n)
    try:
        return -riccati_gains(a, b, cost, np.array(weights.inputs))
    except InvalidTuning as reason:
        raise InvalidTube(f"no ancillary gain minimises {weights}: {reason}") from None


@dataclass(frozen=True)
class InputRoom:
    """How far a tube may reach into the inputs at each tick."""

    amplitudes: FloatArray  # (T, m) from the feedforward to the nearer limit
    step: FloatArray  # (m,) largest change in a period

    @classmethod
    def of(cls, feedforward: FloatArray, limits: CommandLimits) -> InputRoom:
        """Return what the limits leave beside the `feedforward` (T, m)."""
        return cls(np.minimum(limits.upper - feedforward, feedforward - limits.lower), limits.step)


def search_weights(
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    disturbance: DisturbanceSet,
    room: InputRoom,
    reserve: FloatArray,
    start: AncillaryWeights | None = None,
) -> AncillaryWeights:
    """Return weights of which the tube is narrow across the track, on T roads that never change.

    Minimised is the larger cross-track half width of the two axle points, with a little of the
    others, while of the steering the `reserve` (m,) stays free, and of the hydrostat's room and
    of every change in a period a fifth; by Nelder and Mead's simplex over the logarithms.

    Raises:
        InvalidTube: no weights give a tube.
    """
    amplitudes = room.amplitudes - reserve
    amplitudes[:, Input.HP] *= _HYDROSTAT_SHARE
    amplitudes = np.maximum(amplitudes, 1e-3)

    def tube(flat: FloatArray) -> Tube | None:
        try:
            weights = AncillaryWeights.of(np.exp(flat))
            gains = np.concatenate(
                [
                    gain_schedule(a[road], b[road], c[road], weights)
                    for road in (slice(k, k + 1) for k in range(len(a)))
                ]
            )
            system = TrackingSystem(a, b, c, gains, np.arange(len(a)))
            if np.abs(np.linalg.eigvals(system.closed)).max() > _SLOWEST:
                return None
            return invariant_tube(system, disturbance, _COARSE)
        except InvalidTube:
            return None

    def cost(flat: FloatArray) -> float:
        found = tube(flat)
        if found is None:
            return 1e3
        cross = found.outputs[:, _CROSS].max(axis=1)
        overdrawn = np.maximum(found.inputs / amplitudes - 1.0, 0.0).sum()
        hurried = np.maximum(found.rates / (_RATE_SHARE * room.step) - 1.0, 0.0).sum()
        little = 0.02 * found.outputs[:, _CROSS].sum() + 0.02 * found.outputs.max()
        return float(cross.max() + _PENALTY * (overdrawn + hurried) + little)

    at = np.log(_START if start is None else start.flat)
    for _ in range(2):  # the second simplex starts anew from where the first one got stuck
        simplex = np.vstack([at, at + _FIRST_SIMPLEX * np.eye(len(at))])
        options = {"maxfev": _EVALUATIONS, "adaptive": True, "initial_simplex": simplex}
        at = minimize(cost, at, method="Nelder-Mead", options=options).x
    if tube(at) is None:
        raise InvalidTube("no weights of the ancillary gain were found that give a tube")
    return AncillaryWeights.of(np.exp(at))
