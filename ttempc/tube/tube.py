"""Reachable tubes of a disturbed linear system around its nominal state.

The deviation m of a system from its nominal state obeys m(k+1) = A_K(k) m(k) + w(k), A_K = A + B K.
For one matrix A_K, Rakovic, Kerrigan, Kouramas and Mayne (2005) give an invariant outer
approximation of the minimal robust positively invariant (RPI) set: the sum of the first terms of
A_K^i W, scaled by 1 / (1 - alpha) where the next term lies in alpha W. Here A_K changes along a
reference and W bounds windows of N steps. With V_k, the set of m(k) that the last N steps reach
from 0, the same argument gives

    S_k = (1 - alpha)^-1 [ V_k + Phi(k, k-N) V_{k-N} + ... + Phi(k, k-(J-1)N) V_{k-(J-1)N} ],

    Phi(k+N, k) S_k + V_{k+N}  is inside  S_{k+N}   if   Phi(k, k-JN) V_{k-JN}  is inside  alpha W,

because V contains W. The first stage is taken to hold before the first tick. With N = 1 the sets
are robust positively invariant. With longer windows they hold every m(k) that is reached from 0.
From another point of S_k, m(k+N) lies in S_{k+N}, and the ticks between need not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidTube
from ..types import FloatArray
from .disturbance_set import DisturbanceSet
from .sets import SupportSet

_MOST_STEPS = 1500  # five minutes; a slower system has no useful tube
_EXPLODED = 1e6  # alpha above which the series counts as divergent


@dataclass(frozen=True)
class TrackingSystem:
    """Error dynamics along a reference, closed by a gain at every tick.

    z(k+1) = A_k z(k) + B_k u(k), u = K_k z, outputs C_k z. `before` is the index of the stage that
    precedes each: k - 1, or k itself where every stage is a stationary motion.
    """

    a: FloatArray  # (T, n, n)
    b: FloatArray  # (T, n, m)
    c: FloatArray  # (T, p, n)
    gains: FloatArray  # (T, m, n)
    before: NDArray[np.intp]  # (T,)

    @cached_property
    def closed(self) -> FloatArray:
        """Return A_K = A + B K, (T, n, n)."""
        return self.a + self.b @ self.gains


@dataclass(frozen=True)
class Certificate:
    """Numbers that prove the inclusion of a tube, see the module."""

    # The first term left out lies in alpha W. Each half width exceeds that of the sum of
    # all terms, for N = 1 the minimal RPI set, by at most a share alpha.
    alpha: float
    terms: int  # J
    window: int  # N [steps]


@dataclass(frozen=True)
class Tube:
    """Half widths, at every tick, of the set S_k that contains the deviation; symmetric about 0."""

    system: TrackingSystem
    disturbance: DisturbanceSet
    certificate: Certificate
    states: FloatArray  # (T, n)
    outputs: FloatArray  # (T, p)
    inputs: FloatArray  # (T, m) of K m
    rates: FloatArray  # (T, m) of the change of K m from the tick before

    def at(self, k: int) -> SupportSet:
        """Return S_k."""
        return SupportSet(self.system.a.shape[1], lambda rows: self._support(k, rows))

    def last_window(self, k: int) -> SupportSet:
        """Return V_k, the deviations that the last N steps reach from 0."""
        return SupportSet(
            self.system.a.shape[1], lambda rows: self._terms(k, rows, terms=1).sum(axis=0)
        )

    def transition(self, k: int, steps: int) -> FloatArray:
        """Return Phi(k, k - steps), (n, n)."""
        phi, tick = np.eye(self.system.a.shape[1]), k
        for _ in range(steps):
            tick = self.system.before[tick]
            phi = phi @ self.system.closed[tick]
        return phi

    def worst_case(self, k: int, direction: FloatArray) -> FloatArray:
        """Return disturbances up to tick `k` that reach far along `direction`, (J N, n).

        Oldest first. Every sliding window of them lies in the disturbance set, see
        `DisturbanceSet.worst`. From m = 0 they lead to direction'm(k) <= (1 - alpha) h(direction),
        with equality for windows of one step. The sets of longer windows are wider than what
        sliding windows reach, because their terms fill windows side by side.
        """
        steps = self.certificate.terms * self.certificate.window
        row, tick = direction, k
        coefficients = np.zeros((steps, len(direction)))
        for step in range(steps):
            coefficients[step] = row
            tick = self.system.before[tick]
            row = row @ self.system.closed[tick]
        return self.disturbance.worst(coefficients)[::-1]

    def _support(self, k: int, rows: FloatArray) -> FloatArray:
        terms = self._terms(k, rows, self.certificate.terms)
        return terms.sum(axis=0) / (1.0 - self.certificate.alpha)

    def _terms(self, k: int, rows: FloatArray, terms: int) -> FloatArray:
        """Return the contribution of each of the last windows to h of `rows` (r, n), (terms, r)."""
        added, tick = [], k
        for _ in range(terms):
            energy = np.zeros_like(rows)
            for _ in range(self.certificate.window):
                energy += (rows @ self.disturbance.axes) ** 2
                tick = self.system.before[tick]
                rows = rows @ self.system.closed[tick]
            added.append(self.disturbance.reach(energy))
        return np.array(added)


def invariant_tube(
    system: TrackingSystem, disturbance: DisturbanceSet, tolerance: float = 0.02
) -> Tube:
    """Return the tube of `system` under `disturbance`, all ticks at once.

    Args:
        system: the error dynamics with their gains.
        disturbance: acts on the state in every step.
        tolerance: largest alpha, the share by which the tube may be too wide.

    Raises:
        InvalidTube: A + B K does not contract; with the modulus of its largest eigenvalue.
    """
    ticks, n = system.a.shape[:2]
    gains, closed, axes = system.gains, system.closed, disturbance.axes
    m, p = gains.shape[1], system.c.shape[1]
    faces, inner = disturbance.faces
    unit = np.tile(np.eye(n), (ticks, 1, 1))
    # Rows on m(k): states, outputs, inputs, rates, and the faces of W for alpha.
    rows = np.concatenate([unit, system.c, gains, gains, np.tile(faces, (ticks, 1, 1))], axis=1)
    rates, face = slice(n + p + m, n + p + 2 * m), slice(n + p + 2 * m, None)
    total, energy = np.zeros(rows.shape[:2]), np.zeros(rows.shape)
    tick, step, alpha = np.arange(ticks), 0, np.inf
    for step in range(_MOST_STEPS):
        energy += (rows @ axes) ** 2
        tick = system.before[tick]
        rows = rows @ closed[tick]
        if step == 0:  # in K(k) m(k) - K(k-1) m(k-1), w(k-1) acts through the first term alone
            rows[:, rates] -= gains[tick]
        if (step + 1) % disturbance.window:
            continue
        added = disturbance.reach(energy)
        alpha = float(added[:, face].max()) / inner
        if alpha <= tolerance or not alpha < _EXPLODED:
            break
        total += added
        energy = np.zeros_like(energy)
    if not alpha <= tolerance:
        growth = float(np.abs(np.linalg.eigvals(closed)).max())
        raise InvalidTube(
            f"A + B K does not contract: {step + 1} steps leave {alpha:.3g} times a disturbance, "
            f"the largest eigenvalue has the modulus {growth:.4f}"
        )
    half = total / (1.0 - alpha)
    return Tube(
        system,
        disturbance,
        Certificate(alpha, step // disturbance.window, disturbance.window),
        states=half[:, :n],
        outputs=half[:, n : n + p],
        inputs=half[:, n + p : n + p + m],
        rates=half[:, rates],
    )
