"""Saturated LQ robust law of `ttempc`."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace
from typing import Literal, Self, get_args

import numpy as np

from ..errors import InvalidTuning
from ..mpc.riccati import riccati_gains
from ..types import FloatArray, Input, State
from ..validation import check_choice, check_positive, check_vector
from ..vehicle import Vehicle
from .nominal_state import NominalState, Reading

Tightening = Literal["none", "saturation", "tube"]

_N, _M = len(State), len(Input)
# Largest argument of tanh in the tube reading. Beyond it the law cannot bring the vehicle back.
_EXHAUSTED = 3.0
_TINY = 1e-30  # keeps the autocorrelation of a signal of zeros finite


@dataclass(frozen=True)
class LqRobustTuning:
    """Reading, authority and stiffness of the robust law; vectors in the order of `Input`.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    # Reading of erratum 8, see `ttempc.laws.nominal_state.NominalState`.
    nominal: Reading = "one-step"
    # Largest action k_s [rad], [rad], fraction; the paper's.
    saturation: tuple[float, float, float] = (0.2, 0.1, 0.10)
    # Cost of an action [1/rad^2], [1/rad^2], 1, beside errors of both points at 1 / m^2 each: 2 cm
    # weigh as much as 2 deg of steering or 4 % of the hydrostat. For the vehicle of the paper up to
    # 1 m/s; see `for_speed`.
    input_weight: tuple[float, float, float] = (0.3, 0.3, 0.3)
    # What the MPC leaves free. "saturation": k_s of every input, so that the limits never cut the
    # sum of both; it reserves authority that the law seldom uses. "tube": at stage j of the horizon
    # what the tube of `ttempc.tube.growing_tube` takes; nothing without a tube.
    tightening: Tightening = "none"
    # In the one-step reading: time constant of the autocorrelation's average [s].
    memory_s: float = 5.0

    def __post_init__(self) -> None:
        check_choice("nominal", self.nominal, get_args(Reading))
        check_vector("saturation", self.saturation, _M)
        check_vector("input_weight", self.input_weight, _M)
        check_choice("tightening", self.tightening, get_args(Tightening))
        check_positive("memory_s", self.memory_s)
        if self.tightening == "tube" and self.nominal == "tube":
            raise InvalidTuning(
                "tightening: 'tube' grows from the estimate and needs nominal = 'one-step', "
                "got nominal = 'tube'"
            )

    def for_speed(self, vehicle: Vehicle, speed_mps: float) -> Self:
        """Return the tuning for a vehicle and the largest speed of its reference [m/s].

        An action has the cost of the same motion (`Vehicle.motion_per_input`), and none less than
        the one given. With a fixed cost the loop's gain grows with the speed, and above 3 m/s the
        lags that the kinematic model leaves out make steering and drawbar oscillate.
        """
        ratio = vehicle.motion_per_input(speed_mps) / Vehicle().motion_per_input(1.0)
        weights = np.array(self.input_weight) * np.maximum(ratio, 1.0) ** 2
        front, trailer, hp = weights.tolist()
        return replace(self, input_weight=(front, trailer, hp))


@dataclass(frozen=True, slots=True)
class RobustAction:
    """The robust action of one tick, and the state and input that it leaves to the MPC."""

    input: FloatArray  # (3,) u_m
    nominal: FloatArray  # (7,) zbar_e
    deviation: FloatArray  # (7,) z_e - zbar_e
    modelling_error: FloatArray  # (4,) z_m of x, y of tractor, of trailer [m]
    mpc_state: FloatArray  # (n,) the error on which the MPC acts
    mpc_previous: FloatArray  # (3,) the input u_e(k-1) from which the MPC steps on
    fallback: str  # why the law restarted; empty where it did not


class LqRobustLaw:
    """u_m = k_s tanh(r K z_m / k_s), z_m = z_e - zbar_e, element by element.

    K is the gain of the linear-quadratic regulator on the articulated error model along the
    reference, actuator lags included. K z_m replaces the printed k_p z_m + k_d z_m', since the
    rate of a position error follows from heading and speed error; taken from the model, it does not
    amplify the estimate's noise as a difference over a period does.

    One-step reading: zbar_e is predicted from the previous error and the input that was sent, so
    that z_m is the residual of one step. The MPC corrects it, for it has happened; the robust
    action acts on its autocorrelated part, r K z_m, with the lag-one autocorrelation

        r = sum f^j w(k-j) w(k-j-1) / sum f^j (w(k-j)^2 + w(k-j-1)^2) / 2,   w = K z_m,

    within [0, 1] and with f = exp(-period / `memory_s`). Where filter and model are right, the
    residuals are white and r is 0; slopes, patches and furrows outside the model make it grow.

    Tube reading: r = 1, and all feedback on the vehicle is this law. The nominal state restarts at
    z_e where the law's authority is exhausted: then the MPC has to bring the vehicle back.

    Args:
        a: A (N, n, n), see `ttempc.mpc.articulated_error.error_dynamics`.
        b: B (N, n, 3).
        c: C (N + 1, 4, n).
        period_s: control period [s].
        tuning: see `LqRobustTuning`.

    Raises:
        InvalidTuning: no gain stabilises the last stage.
    """

    def __init__(
        self,
        a: FloatArray,
        b: FloatArray,
        c: FloatArray,
        period_s: float,
        tuning: LqRobustTuning,
    ) -> None:
        outputs = c[:-1, :, :_N]
        cost = outputs.transpose(0, 2, 1) @ outputs
        gains = riccati_gains(a[:, :_N, :_N], b[:, :_N], cost, np.array(tuning.input_weight))
        self._limit = np.array(tuning.saturation)
        self._relative = gains / self._limit[:, None]  # (N, 3, 7)
        self._outputs = outputs  # (N, 4, 7)
        self._tube = tuning.nominal == "tube"
        self._nominal = NominalState(a, b, tuning.nominal)
        self._autocorrelation = Autocorrelation(_M, math.exp(-period_s / tuning.memory_s))
        self._last: tuple[int, FloatArray, FloatArray] | None = None  # tick, MPC's state, u_b

    def fresh(self) -> LqRobustLaw:
        """Return the law before its first tick; it shares the gains."""
        law = copy.copy(self)
        law._nominal = self._nominal.fresh()
        law._autocorrelation = self._autocorrelation.fresh()
        law._last = None
        return law

    def resume(self, previous: LqRobustLaw) -> None:
        """Keep the autocorrelation; the nominal state, an error to another reference, restarts."""
        self._autocorrelation = previous._autocorrelation

    def step(self, k: int, error: FloatArray, previous: FloatArray) -> RobustAction:
        """Return the action of tick `k`.

        Args:
            k: the tick.
            error: z_e and the disturbances as in `ttempc.mpc.articulated_error`, (n,).
            previous: u_e(k-1) (3,), the reference's input less the one that was sent.
        """
        if self._last:
            tick, state, feedback = self._last
            previous = feedback if self._tube else previous
            self._nominal.advance(tick, state, previous)
        nominal = self._nominal.at(k, error)[:_N]
        deviation = error[:_N] - nominal  # z_m
        desired = self._relative[k] @ deviation  # in units of k_s
        mpc_state, fallback = error, ""
        if not self._tube:
            desired = self._autocorrelation.update(desired) * desired
        elif np.abs(desired).max() <= _EXHAUSTED:
            # The disturbances act on both states, with their present estimates.
            mpc_state = np.concatenate([nominal, error[_N:]])
        else:
            fallback = "robust action exhausted: nominal state starts anew"
            deviation, desired = np.zeros(_N), np.zeros(_M)
        return RobustAction(
            input=self._limit * np.tanh(desired),
            nominal=nominal,
            deviation=deviation,
            modelling_error=self._outputs[k] @ deviation,
            mpc_state=mpc_state,
            mpc_previous=previous,
            fallback=fallback,
        )

    def record_feedback(self, k: int, mpc_state: FloatArray, feedback: FloatArray) -> None:
        """Store the MPC's state (n,) and its `feedback` u_b (3,) of tick `k` for the next step."""
        self._last = k, mpc_state, feedback


class Autocorrelation:
    """Lag-one autocorrelation of each entry of a signal, with exponential forgetting.

    Args:
        entries: n, of the signal.
        forgetting: factor by which older samples weigh less with each sample, in (0, 1).
    """

    def __init__(self, entries: int, forgetting: float) -> None:
        self._forgetting = forgetting
        self._previous = np.zeros(entries)
        self._product, self._power = np.zeros(entries), np.zeros(entries)

    def fresh(self) -> Autocorrelation:
        """Return the autocorrelation before its first sample."""
        return Autocorrelation(len(self._previous), self._forgetting)

    def update(self, signal: FloatArray) -> FloatArray:
        """Return the autocorrelation with the sample `signal` (n,), clipped to [0, 1], (n,)."""
        self._product = self._forgetting * self._product + signal * self._previous
        self._power = self._forgetting * self._power + 0.5 * (signal**2 + self._previous**2)
        self._previous = signal
        return np.minimum(np.maximum(self._product / np.maximum(self._power, _TINY), 0.0), 1.0)
