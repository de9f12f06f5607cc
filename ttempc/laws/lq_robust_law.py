"""Saturated LQ robust law of `ttempc`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Self, get_args

import numpy as np

from ..errors import InvalidTuning, check_choice, check_positive, check_vector
from ..jit import cached_njit
from ..models.linear import ordered_product, riccati_gains
from ..types import FloatArray, Input, State
from ..vehicle import Vehicle

Reading = Literal["one-step", "tube"]
Tightening = Literal["none", "saturation", "tube"]

_N, _M = len(State), len(Input)


@dataclass(frozen=True)
class LqRobustTuning:
    """Reading, authority and stiffness of the robust law; vectors in the order of `Input`."""

    # Reading of erratum 8, see `ttempc.baselines.paper.PaperFeedback`.
    nominal: Reading = "one-step"
    # Largest action k_s [rad], [rad], fraction; the paper's.
    saturation: tuple[float, float, float] = (0.2, 0.1, 0.10)
    # Cost of an action [1/rad^2], [1/rad^2], 1, beside errors of both points at 1 / m^2 each: 2 cm
    # weigh as much as 2 deg of steering or 4 % of the hydrostat. For the vehicle of the paper up to
    # 1 m/s; see `for_speed`.
    input_weight: tuple[float, float, float] = (0.3, 0.3, 0.3)
    # What the MPC leaves free. "tube": at stage j of the horizon what the growing tube takes;
    # nothing without a tube. "saturation": k_s of every input, so that the limits never cut the
    # sum of both; it reserves authority that the law seldom uses.
    tightening: Tightening = "tube"
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
                "tightening: 'tube' (the default) grows from the estimate and needs nominal = "
                "'one-step'; with nominal = 'tube' it must be 'none' or 'saturation'"
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


class RobustAction(NamedTuple):
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

    A (N, n, n), B (N, n, 3) and C (N + 1, 4, n) are those of `error_dynamics`.

    Raises:
        InvalidTuning: no gain stabilises the last stage.
    """

    def __init__(
        self, a: FloatArray, b: FloatArray, c: FloatArray, period_s: float, tuning: LqRobustTuning
    ) -> None:
        outputs = np.ascontiguousarray(c[:-1, :, :_N])
        cost = outputs.transpose(0, 2, 1) @ outputs
        gains = riccati_gains(a[:, :_N, :_N], b[:, :_N], cost, np.array(tuning.input_weight))
        self._limit = np.array(tuning.saturation)
        self._relative = gains / self._limit[:, None]  # (N, 3, 7)
        self._outputs = outputs  # (N, 4, 7)
        self._one_step = tuning.nominal == "one-step"
        self._model = np.concatenate([a, b], axis=2)[:, :_N]  # (N, 7, n + 3)
        self._memory = np.zeros((3, _M))  # see `autocorrelation`
        self._forgetting = math.exp(-period_s / tuning.memory_s)
        self._last: tuple[int, FloatArray, FloatArray] | None = None  # tick, MPC's state, u_b

    def resume(self, previous: LqRobustLaw) -> None:
        """Keep the autocorrelation; the nominal state, an error to another reference, restarts."""
        self._memory = previous._memory

    def step(self, k: int, error: FloatArray, previous: FloatArray) -> RobustAction:
        """Return the action of tick `k` at z_e and the disturbances, `error` (n,).

        `previous` is u_e(k-1) (3,), the reference's input less the one that was sent.
        """
        nominal = error[:_N]
        if self._last and not self._one_step:
            previous = self._last[2]
        if self._last and self._last[0] == k - 1:
            given = np.concatenate([self._last[1], previous])
            nominal = ordered_product(self._model[k - 1], given)
        deviation, modelling_error, action, exhausted = robust_action(
            k,
            error,
            nominal,
            self._relative,
            self._outputs,
            self._limit,
            self._memory,
            self._forgetting,
            self._one_step,
        )
        mpc_state = error
        if not (self._one_step or exhausted):
            # The disturbances act on both states, with their present estimates.
            mpc_state = np.concatenate([nominal, error[_N:]])
        return RobustAction(
            input=action,
            nominal=nominal,
            deviation=deviation,
            modelling_error=modelling_error,
            mpc_state=mpc_state,
            mpc_previous=previous,
            fallback="robust action exhausted: nominal state starts anew" if exhausted else "",
        )

    def record_feedback(self, k: int, mpc_state: FloatArray, feedback: FloatArray) -> None:
        """Store the MPC's state (n,) and its `feedback` u_b (3,) of tick `k` for the next step."""
        self._last = k, mpc_state, feedback


_TINY = 1e-30  # keeps the autocorrelation of a signal of zeros finite
# Largest argument of tanh in the tube reading. Beyond it the law cannot bring the vehicle back.
_EXHAUSTED = 3.0


@cached_njit(error_model="numpy", boundscheck=False)
def autocorrelation(memory: FloatArray, forgetting: float, signal: FloatArray) -> FloatArray:
    """Return the lag-one autocorrelation of each entry of a signal, clipped to [0, 1], (n,).

    Older samples weigh less by the factor `forgetting` with each sample. `memory` (3, n) holds the
    previous sample and the averages of product and power; the sample `signal` (n,) enters them.
    """
    result = np.empty_like(signal)
    for i in range(signal.size):
        last, now = memory[0, i], signal[i]
        memory[1, i] = forgetting * memory[1, i] + now * last
        memory[2, i] = forgetting * memory[2, i] + 0.5 * (now * now + last * last)
        memory[0, i] = now
        result[i] = min(max(memory[1, i] / max(memory[2, i], _TINY), 0.0), 1.0)
    return result


@cached_njit(error_model="numpy", boundscheck=False)
def robust_action(
    k: int,
    error: FloatArray,
    nominal: FloatArray,
    gains: FloatArray,
    outputs: FloatArray,
    limit: FloatArray,
    memory: FloatArray,
    forgetting: float,
    one_step: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Return deviation (n,), modelling error (p,), action (m,), and whether the law is exhausted.

    At tick `k` with z_e and zbar_e (n,), K in units of the `limit` k_s (N, m, n), C (N, p, n) in
    `outputs`. `one_step`: the autocorrelation scales the action; else the law may be exhausted.
    """
    inputs, n = gains.shape[1:]
    deviation, action = np.empty(n), np.zeros(inputs)
    for j in range(n):
        deviation[j] = error[j] - nominal[j]
    for i in range(inputs):
        for j in range(n):
            action[i] += gains[k, i, j] * deviation[j]
    exhausted = False
    if one_step:
        action *= autocorrelation(memory, forgetting, action)
    else:
        exhausted = np.abs(action).max() > _EXHAUSTED
        if exhausted:
            deviation[:], action[:] = 0.0, 0.0
    modelling = np.zeros(outputs.shape[1])
    for i in range(modelling.size):
        for j in range(n):
            modelling[i] += outputs[k, i, j] * deviation[j]
    for i in range(inputs):
        action[i] = limit[i] * math.tanh(action[i])
    return deviation, modelling, action, exhausted
