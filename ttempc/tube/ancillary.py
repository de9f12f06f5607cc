"""Ancillary gain of the vehicle's tube: an LQR along the reference with searched weights.

The search finds weights whose tube is narrow across the track and leaves the inputs their reserve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InvalidTube
from ..limits import CommandLimits
from ..types import FloatArray, Input
from .disturbance_set import DisturbanceSet
from .gain import feedback_gains, search_tube
from .tube import TrackingSystem, Tube

_CROSS = (1, 3)  # cross-track errors among the outputs x_t, y_t, x_i, y_i
_EVALUATIONS = 700  # of each simplex, at most
_START = (0.1, 2.5, 0.05, 2.5, 0.01, 0.01, 0.01, 0.01, 0.01, 0.3, 1.5, 0.9)  # weights
_HYDROSTAT_SHARE = 0.8  # largest share of the hydrostat's margin that the tube may take
# Largest share of the change in a period that the tube may take; the feedforward takes the rest
# where curves begin.
_RATE_SHARE = 0.9
_PENALTY = 3.0  # [m] for exceeding a margin by 100 %
_SECONDARY = 0.02  # weight of the other half widths beside the largest cross-track one


@dataclass(frozen=True, slots=True)
class AncillaryWeights:
    """Diagonals of the quadratic cost that the ancillary gain minimises.

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
        """Return all weights in the order of the fields, (12,)."""
        return np.array([*self.outputs, *self.states, *self.inputs])

    @classmethod
    def of(cls, flat: FloatArray) -> AncillaryWeights:
        """Return the weights from `flat` (12,), the reverse of `AncillaryWeights.flat`."""
        values = [float(value) for value in flat]
        return cls(tuple(values[:4]), tuple(values[4:9]), tuple(values[9:]))  # pyright: ignore


def gain_schedule(
    a: FloatArray, b: FloatArray, c: FloatArray, weights: AncillaryWeights
) -> FloatArray:
    """Return K (T, m, n) of u = K z at every tick, by the Riccati recursion.

    The last stage is repeated indefinitely.

    Args:
        a: A (T, n, n) of the minimal state.
        b: B (T, n, m).
        c: C (T, p, n).
        weights: of the cost.

    Raises:
        InvalidTube: no gain stabilises the last stage.
    """
    outputs, states = np.array(weights.outputs), np.diag([0.0, 0.0, *weights.states])
    cost = c.transpose(0, 2, 1) @ (outputs[:, None] * c) + states  # (T, n, n)
    try:
        return feedback_gains(a, b, cost, np.array(weights.inputs))
    except InvalidTube as reason:
        raise InvalidTube(f"no ancillary gain minimises {weights}: {reason}") from None


@dataclass(frozen=True)
class InputMargin:
    """Distances of the feedforward from the limits of the inputs."""

    amplitudes: FloatArray  # (T, m) to the nearer limit
    step: FloatArray  # (m,) largest change in a period

    @classmethod
    def of(cls, feedforward: FloatArray, limits: CommandLimits) -> InputMargin:
        """Return the margin between `feedforward` (T, m) and `limits`."""
        return cls(np.minimum(limits.upper - feedforward, feedforward - limits.lower), limits.step)


def search_weights(
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    disturbance: DisturbanceSet,
    margin: InputMargin,
    reserve: FloatArray,
    start: AncillaryWeights | None = None,
) -> AncillaryWeights:
    """Return weights whose tube is narrow across the track, at T stationary motions.

    `search_tube` minimises the largest cross-track half width of the two axle points. The other
    half widths enter with a small weight. Penalties keep free the `reserve` of each input, a fifth
    of the hydrostat's margin, and a tenth of every change in a period.

    Args:
        a: A (T, n, n), one motion each.
        b: B (T, n, m).
        c: C (T, p, n).
        disturbance: that acts in every step.
        margin: of the inputs, for T motions.
        reserve: amplitude to leave free (m,).
        start: first weights; by default those of the shipped search.

    Raises:
        InvalidTube: no weights give a tube.
    """
    amplitudes = margin.amplitudes - reserve
    amplitudes[:, Input.HP] *= _HYDROSTAT_SHARE
    amplitudes = np.maximum(amplitudes, 1e-3)

    def system_of(flat: FloatArray) -> TrackingSystem:
        weights = AncillaryWeights.of(flat)
        motions = [slice(k, k + 1) for k in range(len(a))]
        gains = [gain_schedule(a[motion], b[motion], c[motion], weights) for motion in motions]
        return TrackingSystem(a, b, c, np.concatenate(gains), np.arange(len(a)))

    def cost(candidate: Tube) -> float:
        outputs = candidate.outputs
        cross = outputs[:, _CROSS]
        amplitude = np.maximum(candidate.inputs / amplitudes - 1.0, 0.0).sum()
        rate = np.maximum(candidate.rates / (_RATE_SHARE * margin.step) - 1.0, 0.0).sum()
        others = _SECONDARY * cross.sum() + _SECONDARY * outputs.max()
        return float(cross.max() + _PENALTY * (amplitude + rate) + others)

    first = np.array(_START) if start is None else start.flat
    return AncillaryWeights.of(search_tube(system_of, cost, disturbance, first, _EVALUATIONS))
