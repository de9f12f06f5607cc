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

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from ..errors import InvalidTube, InvalidTuning
from ..models.linear import riccati_gains
from ..types import FloatArray
from .sets import DisturbanceSet, SupportSet

_EXPLODED = 1e6  # alpha above which the series counts as divergent


@dataclass(frozen=True)
class TrackingSystem:
    """Linear dynamics in n dimensions, closed by a gain at every tick.

    z(k+1) = A_k z(k) + B_k u(k), u = K_k z, outputs C_k z. `before` is the index of the stage that
    precedes each: k - 1, or k itself where every stage is a stationary motion.

    Raises:
        InvalidTube: the shapes do not fit, or a value is not finite.
    """

    a: FloatArray  # (T, n, n)
    b: FloatArray  # (T, n, m)
    c: FloatArray  # (T, p, n)
    gains: FloatArray  # (T, m, n)
    before: NDArray[np.intp]  # (T,)

    def __post_init__(self) -> None:
        matrices = (self.a, self.b, self.c, self.gains)
        shapes = [matrix.shape for matrix in matrices]
        if [len(shape) for shape in shapes] != [3] * 4 or self.before.ndim != 1:
            raise InvalidTube(f"A, B, C, K: got {shapes}, must be a stack of matrices each")
        (ticks, n), m, p = self.a.shape[:2], self.b.shape[2], self.c.shape[1]
        expected = [(ticks, n, n), (ticks, n, m), (ticks, p, n), (ticks, m, n)]
        if shapes != expected or self.before.shape != (ticks,):
            raise InvalidTube(
                f"A, B, C, K, before: got {[*shapes, self.before.shape]}, must be "
                f"{[*expected, (ticks,)]}"
            )
        if not all(np.isfinite(matrix).all() for matrix in matrices):
            raise InvalidTube("A, B, C, K: must be finite")

    @classmethod
    def along(
        cls, a: FloatArray, b: FloatArray, gains: FloatArray, c: FloatArray | None = None
    ) -> TrackingSystem:
        """Return a time-varying system of T ticks, whose first stage holds before the first tick.

        T = 1 is a time-invariant system. Without C it has no outputs.
        """
        c = np.zeros((len(a), 0, a.shape[-1])) if c is None else c
        return cls(a, b, c, gains, np.maximum(np.arange(len(a)) - 1, 0))

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
        return SupportSet(
            self.system.a.shape[1], lambda rows: self._support(np.array([k]), rows[None])[0]
        )

    def support(self, rows: FloatArray) -> FloatArray:
        """Return the support function of every S_k, (T, r) in the directions `rows` (T, r, n)."""
        return self._support(np.arange(len(self.states)), rows)

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

    def _support(self, ticks: NDArray[np.intp], rows: FloatArray) -> FloatArray:
        steps = self.certificate.terms * self.certificate.window
        reached, _ = _reached(self.system, self.disturbance, ticks, rows, steps)
        return reached / (1.0 - self.certificate.alpha)


def reach_backwards(
    system: TrackingSystem,
    disturbance: DisturbanceSet,
    ticks: NDArray[np.intp],
    rows: FloatArray,
    rates: slice | None = None,
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield what the last 1, 2, 3, ... steps reach at most in `rows` on m(k), without end.

    The disturbances act in windows counted back from tick k. Each item holds, in this order, what
    the completed windows before the present one reach (t, r), the energy of the present one
    (t, r, n), see `DisturbanceSet.reach`, and the rows on the state before all of them (t, r, n).

    Args:
        system: the closed loop.
        disturbance: acts on the state in every step.
        ticks: k, (t,).
        rows: of each tick, (t, r, n).
        rates: which rows are K(k), to be taken as those of the change K(k) m(k) - K(k-1) m(k-1).
    """
    completed, energy = np.zeros(rows.shape[:2]), np.zeros(rows.shape)
    for step in itertools.count():
        if step % disturbance.window == 0:
            energy = np.zeros(rows.shape)
        energy = energy + (rows @ disturbance.axes) ** 2
        ticks = system.before[ticks]
        rows = rows @ system.closed[ticks]
        if step == 0 and rates:  # w(k-1) acts through K(k) m(k) alone
            rows[:, rates] -= system.gains[ticks]
        yield completed, energy, rows
        if (step + 1) % disturbance.window == 0:
            completed = completed + disturbance.reach(energy)


def _reached(
    system: TrackingSystem,
    disturbance: DisturbanceSet,
    ticks: NDArray[np.intp],
    rows: FloatArray,
    steps: int,
) -> tuple[FloatArray, FloatArray]:
    """Return what the last steps reach in `rows` (t, r, n), (t, r), and the rows before them."""
    reached = np.zeros(rows.shape[:2])
    backwards = reach_backwards(system, disturbance, ticks, rows)
    for completed, energy, before in itertools.islice(backwards, steps):
        reached, rows = completed + disturbance.reach(energy), before
    return reached, rows


def invariant_tube(
    system: TrackingSystem,
    disturbance: DisturbanceSet,
    tolerance: float = 0.02,
    most_steps: int = 1500,
) -> Tube:
    """Return the tube of `system` under `disturbance`, all ticks at once.

    `tolerance` is the largest alpha, the share by which the tube may be too wide; within
    `most_steps` a disturbance must have decayed to it.

    Raises:
        InvalidTube: A + B K does not contract, with the modulus of its largest eigenvalue; the
            disturbance has another dimension than the state; or the tolerance is out of range.
    """
    if not 0.0 < tolerance < 1.0:
        raise InvalidTube(f"tolerance: got {tolerance}, must be between 0 and 1")
    ticks, n = system.a.shape[:2]
    if disturbance.dimension != n:
        raise InvalidTube(f"disturbance: got {disturbance.dimension} dimensions, must be {n}")
    gains = system.gains
    m, p = gains.shape[1], system.c.shape[1]
    unit = np.tile(np.eye(n), (ticks, 1, 1))
    # Rows on m(k): states, outputs, inputs, rates, and the faces of W for alpha.
    rows = np.concatenate(
        [unit, system.c, gains, gains, np.tile(disturbance.faces, (ticks, 1, 1))], axis=1
    )
    rates, face = slice(n + p + m, n + p + 2 * m), slice(n + p + 2 * m, None)
    backwards = reach_backwards(system, disturbance, np.arange(ticks), rows, rates)
    window, step, alpha, total = disturbance.window, 0, np.inf, np.zeros(rows.shape[:2])
    for step, (completed, energy, _) in enumerate(itertools.islice(backwards, most_steps), 1):
        if step % window:
            continue
        alpha, total = float(disturbance.reach(energy)[:, face].max()), completed
        if alpha <= tolerance or not alpha < _EXPLODED:
            break
    if not alpha <= tolerance:
        growth = float(np.abs(np.linalg.eigvals(system.closed)).max())
        raise InvalidTube(
            f"A + B K does not contract: {step} steps leave {alpha:.3g} times a disturbance, "
            f"the largest eigenvalue has the modulus {growth:.4f}"
        )
    half = total / (1.0 - alpha)
    return Tube(
        system,
        disturbance,
        Certificate(alpha, step // window - 1, window),
        states=half[:, :n],
        outputs=half[:, n : n + p],
        inputs=half[:, n + p : n + p + m],
        rates=half[:, rates],
    )


_COARSE = 0.2  # alpha of the tubes of the search: at most 20 % too wide, five times as fast
_EVALUATIONS = 700  # of each simplex, at most
_NO_TUBE = 1e3  # cost of weights that give no tube
_FIRST_SIMPLEX = 1.0  # edge, in logarithms of the weights


def feedback_gains(
    a: FloatArray, b: FloatArray, state_cost: FloatArray, input_cost: FloatArray
) -> FloatArray:
    """Return K (T, m, n) of u = K z that minimises sum z'Q z + sum u'R u, by the Riccati recursion.

    A is (T, n, n), B (T, n, m), Q (T, n, n) or (n, n) of all stages, and the diagonal of R (m,).
    The last stage is repeated indefinitely; one stage alone gives the stationary gain.

    Raises:
        InvalidTube: no gain stabilises the last stage.
    """
    try:
        return -riccati_gains(a, b, np.broadcast_to(state_cost, a.shape), input_cost)
    except InvalidTuning as reason:
        raise InvalidTube(str(reason)) from None


def search_tube(
    system_of: Callable[[FloatArray], TrackingSystem],
    cost: Callable[[Tube], float],
    disturbance: DisturbanceSet,
    start: FloatArray,
    evaluations: int = _EVALUATIONS,
    slowest: float = 0.98,
) -> FloatArray:
    """Return positive weights whose tube minimises a cost, (w,).

    Nelder and Mead's simplex over the logarithms of the weights runs twice, the second time from
    where the first one has stalled. The tubes of the search may be a fifth too wide.

    Args:
        system_of: closed loop for weights (w,); `InvalidTube` excludes them.
        cost: of a tube, below 1000.
        disturbance: that acts in every step.
        start: first weights (w,), above 0.
        evaluations: of each simplex, at most.
        slowest: largest modulus of a mode; it excludes slow loops before their tube is computed.

    Raises:
        InvalidTube: no weights give a tube.
    """

    def tube(logarithms: FloatArray) -> Tube | None:
        try:
            system = system_of(np.exp(logarithms))
            if np.abs(np.linalg.eigvals(system.closed)).max() > slowest:
                return None
            return invariant_tube(system, disturbance, _COARSE)
        except InvalidTube:
            return None

    def value(logarithms: FloatArray) -> float:
        candidate = tube(logarithms)
        return _NO_TUBE if candidate is None else cost(candidate)

    at = np.log(start)
    for _ in range(2):
        simplex = np.vstack([at, at + _FIRST_SIMPLEX * np.eye(len(at))])
        options = {"maxfev": evaluations, "adaptive": True, "initial_simplex": simplex}
        at = scipy.optimize.minimize(value, at, method="Nelder-Mead", options=options).x
    if tube(at) is None:
        raise InvalidTube("no weights of the ancillary gain were found that give a tube")
    return np.exp(at)
