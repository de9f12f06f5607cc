"""Saturated LQ robust law of `ttempc`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Self, get_args

import numpy as np

from ..errors import InvalidTuning, check_choice, check_positive, check_vector
from ..models.linear import riccati_gains
from ..types import FloatArray, Input, State
from ..vehicle import Vehicle

Reading = Literal["one-step", "tube"]
Tightening = Literal["none", "saturation", "tube"]

_M = len(Input)


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


def robust_gains(a: FloatArray, b: FloatArray, c: FloatArray, tuning: LqRobustTuning) -> FloatArray:
    """Return K (N, 3, 7) of u_m = k_s tanh(r K z_m / k_s), z_m = z_e - zbar_e, entry by entry.

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
    n = len(State)
    outputs = c[:-1, :, :n]
    cost = outputs.transpose(0, 2, 1) @ outputs
    return riccati_gains(a[:, :n, :n], b[:, :n], cost, np.array(tuning.input_weight))
