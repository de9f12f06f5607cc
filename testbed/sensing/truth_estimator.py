"""Truth estimator: the plant's true state as the estimate, for control with perfect sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ttempc.types import Command, Estimate, Measurement, State

from ..truth import Truth


class TruthEstimator:
    """Estimator that returns the plant's state; satisfies `ttempc.types.Estimator`.

    Args:
        truth: returns the plant's present state.
    """

    def __init__(self, truth: Callable[[], Truth]) -> None:
        self._truth = truth

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the truth with a covariance of zero; measurements are ignored."""
        truth = self._truth()
        state = np.empty(len(State))
        state[State.X], state[State.Y] = truth.tractor.x, truth.tractor.y
        state[State.PSI_T], state[State.PSI_I] = truth.tractor.yaw, truth.trailer.yaw
        state[State.DELTA_T], state[State.DELTA_I] = truth.delta_t, truth.delta_i
        state[State.V] = truth.speed
        return Estimate(
            time_s,
            state,
            np.zeros((len(State), len(State))),
            np.array([truth.trailer.x, truth.trailer.y]),
            truth.beta,
        )
