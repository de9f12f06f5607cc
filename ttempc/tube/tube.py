"""Reachable tubes of a disturbed linear system around its nominal state.

The deviation m of a system from its nominal state obeys m(k+1) = A_K(k) m(k) + w(k), A_K = A + B K.
For one matrix A_K, Rakovic, Kerrigan, Kouramas and Mayne (2005) give an invariant outer
approximation of the minimal robust positively invariant (RPI) set: the sum of the first terms of
A_K^i W, scaled by 1 / (1 - alpha) where the next term lies in alpha W. Here A_K changes along a
reference and W bounds windows of N steps. Let V_k be the set of m(k) that the last N steps reach
from 0, and Phi(k, l) the product of A_K from tick l to tick k. The same argument gives

    S_k = (1 - alpha)^-1 [ V_k + Phi(k, k-N) V_{k-N} + ... + Phi(k, k-(J-1)N) V_{k-(J-1)N} ],

    Phi(k+N, k) S_k + V_{k+N}  is inside  S_{k+N}   if   Phi(k, k-JN) V_{k-JN}  is inside  alpha W,

because V contains W. The first stage is assumed to hold before the first tick. With N = 1 the sets
are robust positively invariant. With longer windows they contain every m(k) that is reached from 0.
From another point of S_k, m(k+N) lies in S_{k+N}, but the ticks between need not lie in their sets.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..errors import InvalidTube, InvalidTuning
from ..models.linear import riccati_gains
from ..types import FloatArray
from .sets import DisturbanceSet, SupportSet

_DIVERGENT: Final = 1e6  # alpha above which the series counts as divergent
_SEARCH_ALPHA: Final = 0.2  # of the tubes of a search: a fifth too wide, computed five times faster
_EVALUATIONS: Final = 700  # of each simplex, at most
_NO_TUBE_COST: Final = 1e3  # cost of weights that give no tube
_FIRST_EDGE: Final = 1.0  # edge of the first simplex, in logarithms of the weights
_SIMPLICES: Final = 2  # the second begins where the first has stalled


@dataclass(frozen=True)
class TrackingSystem:
    """Linear dynamics in n dimensions, closed by a gain at every tick.

    The state is z(k+1) = A_k z(k) + B_k u(k), the input u = K_k z, the outputs C_k z. `before` is
    the index of the stage that precedes each one: k - 1, or k itself where every stage is a
    stationary motion.

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

        ticks, n, _ = self.a.shape
        m = self.b.shape[2]
        p = self.c.shape[1]
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

        T = 1 is a time-invariant system. Without C the system has no outputs.
        """
        ticks = len(a)
        if c is None:
            c = np.zeros((ticks, 0, a.shape[-1]))
        before = np.maximum(np.arange(ticks) - 1, 0)
        return cls(a, b, c, gains, before)

    @cached_property
    def closed(self) -> FloatArray:
        """Matrices A_K = A + B K of the closed loop, (T, n, n)."""
        return self.a + self.b @ self.gains


@dataclass(frozen=True)
class Certificate:
    """Numbers that prove the inclusion of a tube, see the docstring of the module.

    The first term that is left out of the series lies in alpha W. Each half width of the tube
    exceeds the half width of the whole series by at most a share alpha. For N = 1 the whole series
    is the minimal RPI set.
    """

    alpha: float
    terms: int  # J, number of terms of the series
    window: int  # N [steps]


@dataclass(frozen=True)
class Tube:
    """Half widths of the sets S_k that contain the deviation m(k) at T ticks, symmetric about 0."""

    system: TrackingSystem
    disturbance: DisturbanceSet
    certificate: Certificate
    states: FloatArray  # (T, n) of m
    outputs: FloatArray  # (T, p) of C m
    inputs: FloatArray  # (T, m) of K m
    rates: FloatArray  # (T, m) of the change of K m from the tick before

    def at(self, k: int) -> SupportSet:
        """Return the set S_k."""

        def function(directions: FloatArray) -> FloatArray:
            return self._support(np.array([k]), directions[None])[0]

        return SupportSet(self.disturbance.dimension, function)

    def support(self, rows: FloatArray) -> FloatArray:
        """Return the support function of every S_k, (T, r), in the directions `rows` (T, r, n)."""
        every_tick = np.arange(len(self.states))
        return self._support(every_tick, rows)

    def transition(self, k: int, steps: int) -> FloatArray:
        """Return Phi(k, k - steps), the effect of m(k - steps) on m(k), (n, n)."""
        phi = np.eye(self.disturbance.dimension)
        tick = k
        for _ in range(steps):
            tick = self.system.before[tick]
            phi = phi @ self.system.closed[tick]
        return phi

    def worst_case(self, k: int, direction: FloatArray) -> FloatArray:
        """Return disturbances before tick `k` that reach far along `direction`, (J N, n).

        The oldest one is the first. Every sliding window of them lies in the disturbance set, see
        `DisturbanceSet.worst`. From m = 0 they lead to direction'm(k) <= (1 - alpha) h(direction),
        with equality for windows of one step. The sets of longer windows are wider than what
        sliding windows reach, because their terms fill windows side by side.
        """
        steps = self._steps
        # Row of the effect of w(k-1), w(k-2), ... on direction'm(k).
        coefficients = np.zeros((steps, len(direction)))
        row = direction
        tick = k
        for step in range(steps):
            coefficients[step] = row
            tick = self.system.before[tick]
            row = row @ self.system.closed[tick]
        newest_first = self.disturbance.worst(coefficients)
        return newest_first[::-1]

    @property
    def _steps(self) -> int:
        """Number J N of steps of the series."""
        return self.certificate.terms * self.certificate.window

    def _support(self, ticks: NDArray[np.intp], rows: FloatArray) -> FloatArray:
        """Return the support functions of S_k at `ticks` (t,), (t, r), for rows (t, r, n)."""
        reached = np.zeros(rows.shape[:2])
        backwards = reach_backwards(self.system, self.disturbance, ticks, rows)
        for reach in itertools.islice(backwards, self._steps):
            reached = reach.completed + self.disturbance.reach(reach.energy)
        return reached / (1.0 - self.certificate.alpha)


class BackwardReach(NamedTuple):
    """Reach of the last steps before tick k, for t ticks and r rows on m(k) each."""

    completed: FloatArray  # (t, r) reach of all complete windows before the present one
    # Sums of squared weights over the present window along each axis (t, r, n), for
    # `DisturbanceSet.reach`.
    energy: FloatArray


def reach_backwards(
    system: TrackingSystem,
    disturbance: DisturbanceSet,
    ticks: NDArray[np.intp],
    rows: FloatArray,
    rates: slice | None = None,
) -> Iterator[BackwardReach]:
    """Yield the reach of the last 1, 2, 3, ... steps in `rows` on m(k), without end.

    The disturbances act in windows of N steps, counted back from tick k.

    Args:
        system: the closed loop.
        disturbance: acts on the state in every step.
        ticks: k, (t,).
        rows: of each tick, (t, r, n).
        rates: place of rows K(k) that are read as the change in a period,
            K(k) m(k) - K(k-1) m(k-1).
    """
    completed = np.zeros(rows.shape[:2])
    energy = np.zeros(rows.shape)
    for step in itertools.count():
        if step % disturbance.window == 0:
            energy = np.zeros(rows.shape)
        energy = energy + (rows @ disturbance.axes) ** 2

        # The rows on the state one step earlier. The newest disturbance w(k-1) acts on m(k) but not
        # on m(k-1): K(k-1) m(k-1) is subtracted after its energy is added.
        ticks = system.before[ticks]
        rows = rows @ system.closed[ticks]
        if step == 0 and rates:
            rows[:, rates] -= system.gains[ticks]

        yield BackwardReach(completed, energy)
        if (step + 1) % disturbance.window == 0:
            completed = completed + disturbance.reach(energy)


def invariant_tube(
    system: TrackingSystem,
    disturbance: DisturbanceSet,
    tolerance: float = 0.02,
    most_steps: int = 1500,
) -> Tube:
    """Return the tube of `system` under `disturbance`, all ticks at once.

    `tolerance` is the largest alpha, the share by which the tube may be too wide. The effect of a
    disturbance must have decayed to this share within `most_steps`.

    Raises:
        InvalidTube: A + B K does not contract, with the modulus of its largest eigenvalue; the
            disturbance has another dimension than the state; or the tolerance is out of range.
    """
    if not 0.0 < tolerance < 1.0:
        raise InvalidTube(f"tolerance: got {tolerance}, must be between 0 and 1")
    n = system.a.shape[1]
    if disturbance.dimension != n:
        raise InvalidTube(f"disturbance: got {disturbance.dimension} dimensions, must be {n}")

    rows = _TubeRows.of(system, disturbance)
    series = _sum_series(system, disturbance, rows, tolerance, most_steps)
    if not series.alpha <= tolerance:
        growth = float(np.abs(np.linalg.eigvals(system.closed)).max())
        raise InvalidTube(
            f"A + B K does not contract: {series.steps} steps leave {series.alpha:.3g} times a "
            f"disturbance, the largest eigenvalue has the modulus {growth:.4f}"
        )

    # The last window of the sum is the first term that is left out.
    terms = series.steps // disturbance.window - 1
    half_widths = series.total / (1.0 - series.alpha)
    return Tube(
        system,
        disturbance,
        Certificate(series.alpha, terms, disturbance.window),
        states=half_widths[:, rows.states],
        outputs=half_widths[:, rows.outputs],
        inputs=half_widths[:, rows.inputs],
        rates=half_widths[:, rows.rates],
    )


class _TubeRows(NamedTuple):
    """Rows on m(k) whose reach is the tube, (T, r, n), and the place of each part among them."""

    matrix: FloatArray
    states: slice
    outputs: slice
    inputs: slice
    rates: slice
    faces: slice  # of W: their reach over one window is alpha

    @classmethod
    def of(cls, system: TrackingSystem, disturbance: DisturbanceSet) -> _TubeRows:
        """Return the rows of all ticks."""
        ticks, n, _ = system.a.shape
        unit = np.tile(np.eye(n), (ticks, 1, 1))
        faces = np.tile(disturbance.faces, (ticks, 1, 1))
        parts = [unit, system.c, system.gains, system.gains, faces]

        ends = np.cumsum([part.shape[1] for part in parts]).tolist()
        places = [slice(begin, end) for begin, end in itertools.pairwise([0, *ends])]
        return cls(np.concatenate(parts, axis=1), *places)


class _Series(NamedTuple):
    """Sum of the first terms of a tube's series."""

    steps: int  # number of steps, those of the first term that is left out included
    alpha: float  # least alpha for which that term lies in alpha W
    total: FloatArray  # (T, r) reach of all terms before it


def _sum_series(
    system: TrackingSystem,
    disturbance: DisturbanceSet,
    rows: _TubeRows,
    tolerance: float,
    most_steps: int,
) -> _Series:
    """Add terms until the next one lies in `tolerance` W, the series diverges or the steps end."""
    step = 0
    alpha = np.inf
    total = np.zeros(rows.matrix.shape[:2])
    every_tick = np.arange(len(rows.matrix))
    backwards = reach_backwards(system, disturbance, every_tick, rows.matrix, rows.rates)
    for step, reach in enumerate(itertools.islice(backwards, most_steps), start=1):
        if step % disturbance.window != 0:
            continue
        alpha = float(disturbance.reach(reach.energy)[:, rows.faces].max())
        total = reach.completed
        if alpha <= tolerance or not alpha < _DIVERGENT:
            break
    return _Series(step, alpha, total)


def feedback_gains(
    a: FloatArray, b: FloatArray, state_cost: FloatArray, input_cost: FloatArray
) -> FloatArray:
    """Return the gains K (T, m, n) of u = K z that minimise sum z'Q z + sum u'R u.

    The Riccati recursion runs backwards over the stages. A is (T, n, n), B (T, n, m), Q (T, n, n)
    or (n, n) for all stages, and the diagonal of R (m,). The last stage is repeated indefinitely.
    One stage alone gives the stationary gain.

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

    The simplex of Nelder and Mead moves over the logarithms of the weights. It runs twice, the
    second time from where the first one has stalled. The tubes of the search may be a fifth too
    wide.

    Args:
        system_of: closed loop for weights (w,); `InvalidTube` excludes the weights.
        cost: of a tube, below 1000.
        disturbance: acts on the state in every step.
        start: first weights (w,), above 0.
        evaluations: of each simplex, at most.
        slowest: largest modulus of an eigenvalue; slower loops are excluded before their tube is
            computed.

    Raises:
        InvalidTube: no weights give a tube.
    """

    def tube(logarithms: FloatArray) -> Tube | None:
        try:
            system = system_of(np.exp(logarithms))
            if np.abs(np.linalg.eigvals(system.closed)).max() > slowest:
                return None
            return invariant_tube(system, disturbance, _SEARCH_ALPHA)
        except InvalidTube:
            return None

    def value(logarithms: FloatArray) -> float:
        candidate = tube(logarithms)
        return _NO_TUBE_COST if candidate is None else cost(candidate)

    best = np.log(start)
    for _ in range(_SIMPLICES):
        simplex = np.vstack([best, best + _FIRST_EDGE * np.eye(len(best))])
        options = {"maxfev": evaluations, "adaptive": True, "initial_simplex": simplex}
        found = scipy.optimize.minimize(value, best, method="Nelder-Mead", options=options)
        best = found.x
    if tube(best) is None:
        raise InvalidTube("no weights of the ancillary gain were found that give a tube")
    return np.exp(best)
