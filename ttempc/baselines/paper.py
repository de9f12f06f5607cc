"""Readings of the printed equations where they leave a choice."""

import math
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args, get_type_hints

import numpy as np

from ..errors import check_choice, check_flag, check_vector
from ..laws.tracking_controller import FeedbackLaw, TrackingController
from ..models.kinematics import POSITIONS, Error, estimated_error
from ..models.linear import zero_order_hold
from ..mpc.articulated_error import PredictedPath
from ..mpc.lmpc import CondensedHorizon, HorizonTuning, LinearMpc
from ..reference.reference import Reference, ReferenceSample, exact_feedforward
from ..types import Diagnostics, Estimate, FloatArray, Input
from ..vehicle import CommandLimits, Vehicle

Reading = Literal["one-step", "tube"]


@dataclass(frozen=True)
class PaperEquations:
    """Reading of the equations of Kayacan, Ramon and Saeys (2016).

    The numbers are those of docs/errata.md. The defaults are those of the controller `paper`: as
    printed, with 4, 6 and 7 corrected, without which the vehicle stands still or is lost.
    """

    # 1: sign of the hitch term in the trailer's yaw equation; +1 printed, -1 geometry
    hitch_sign: Literal[1, -1] = 1
    # 2: delta_i = lambda - beta with the hitch angle as measured (printed), so that the loop is
    #    closed through beta, or with the reference's
    hitch_angle: Literal["measured", "reference"] = "measured"
    # 3: steering feedforward by eq. (ffcontrolaction), or from the exact posture on the path
    feedforward: Literal["printed", "geometry"] = "printed"
    # 4: body whose errors stand in the trailer's rows of the error model; "tractor" is printed in
    #    eq. (errormodel), "trailer" in the matrix A of eq. (errorstateupdate)
    trailer_error_frame: Literal["trailer", "tractor"] = "trailer"
    # 5: speed of the trailer point, the tractor's (printed) or the exact one
    trailer_speed: Literal["tractor", "exact"] = "tractor"
    # 6: z_m = robust_sign * (zbar_e - z_e); +1 printed, which pushes the vehicle away
    robust_sign: Literal[1, -1] = -1
    # 7: hydrostat position at full stroke in the unit in which K = 1.4 m/s holds; with 100, the
    #    printed percent, the vehicle stands still
    hp_full_scale: Literal[1, 100] = 1
    # 8: the nominal state zbar_e, which is not defined; see `PaperFeedback`
    nominal: Reading = "one-step"

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(PaperEquations).items():
            check_choice(name, getattr(self, name), get_args(hint))


@dataclass(frozen=True)
class RobustGains:
    """Gains of eq. (robustcontrollaw), in the order of `Input`.

    The defaults are the paper's, with the hydrostat as a fraction. The front steering acts on y of
    the tractor, the trailer steering on y of the trailer, the hydrostat on x of the tractor.
    """

    saturation: tuple[float, float, float] = (0.2, 0.1, 0.10)  # k_s [rad], [rad], fraction
    proportional: tuple[float, float, float] = (2.0, 1.0, 10.0)  # k_p [1/m]
    derivative: tuple[float, float, float] = (4.0, 2.0, 20.0)  # k_d [s/m]

    def __post_init__(self) -> None:
        for item in fields(RobustGains):
            check_vector(item.name, getattr(self, item.name), len(Input))


class RobustLaw:
    """u_m = k_s tanh(k_p z_m + k_d z_m'), eq. (robustcontrollaw).

    z_m = sign * (zbar_e - z_e) of the four positions, within +-1 m. Its derivative is a backward
    difference over one period, 0 at the start and after a missed tick.
    """

    def __init__(self, gains: RobustGains, sign: int, period_s: float) -> None:
        self._gains = gains
        self._rows = tuple(zip(gains.saturation, gains.proportional, gains.derivative, strict=True))
        self._sign = sign
        self._period_s = period_s
        self._last: tuple[int, list[float]] | None = None  # tick and z_m

    def step(self, k: int, nominal: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the action and the modelling error of tick `k`.

        Returns:
            u_m (3,) as (delta^t, lambda, HP), and z_m (4,) [m] in the order x_t, y_t, x_i, y_i.
        """
        z_m = [
            max(-1.0, min(1.0, self._sign * (nominal[row] - error[row]))) for row in POSITIONS
        ]  # eq. (z2)
        before = self._last[1] if self._last and self._last[0] == k - 1 else z_m
        self._last = (k, z_m)
        x_t, y_t, _, y_i = (
            (now, (now - then) / self._period_s) for now, then in zip(z_m, before, strict=True)
        )
        action = [
            k_s * math.tanh(k_p * value + k_d * rate)
            for (k_s, k_p, k_d), (value, rate) in zip(self._rows, (y_t, y_i, x_t), strict=True)
        ]
        return np.array(action), np.array(z_m)


@dataclass(frozen=True)
class PaperOptions(PaperEquations, RobustGains, HorizonTuning):
    """Options of `paper`: horizon, weights and bounds, gains, and the reading of the equations."""

    robust: bool = True  # whether the robust law acts

    def __post_init__(self) -> None:
        HorizonTuning.__post_init__(self)
        RobustGains.__post_init__(self)
        PaperEquations.__post_init__(self)
        check_flag("robust", self.robust)


@dataclass(frozen=True)
class PrintedSignOptions(PaperOptions):
    """Options of `paper-printed-sign`: the sign of the robust action as printed (erratum 6).

    The nominal state is the tube's own. In the one-step reading the modelling error does not depend
    on where the vehicle is, and its sign has next to no effect.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    robust_sign: Literal[1, -1] = 1
    nominal: Reading = "tube"


def linearise(
    reference: ReferenceSample, vehicle: Vehicle, equations: PaperEquations
) -> tuple[FloatArray, FloatArray]:
    """Return A (N, 7, 7) and B (N, 7, 3) of eq. (errorstateupdate) at N reference samples.

    z_e' = A z_e + B u_e with u_e = u_r - u, u = (delta^t, lambda, HP).
    """
    v = reference.state[:, -1]
    speed_i = v if equations.trailer_speed == "tractor" else reference.speed_i
    length_t, length_i = vehicle.wheelbase, vehicle.trailer_length
    tau = vehicle.speed_time_constant
    frames = {"trailer": (Error.X_I, Error.Y_I), "tractor": (Error.X_T, Error.Y_T)}
    x_i, y_i = frames[equations.trailer_error_frame]

    a = np.zeros((len(v), 7, 7))
    a[:, Error.X_T, Error.Y_T] = reference.yaw_rate_t
    a[:, Error.X_T, Error.V] = 1.0
    a[:, Error.Y_T, Error.X_T] = -reference.yaw_rate_t
    a[:, Error.Y_T, Error.PSI_T] = v
    a[:, Error.X_I, y_i] = reference.yaw_rate_i
    a[:, Error.X_I, Error.V] = speed_i / v
    a[:, Error.Y_I, x_i] = -reference.yaw_rate_i
    a[:, Error.Y_I, Error.PSI_I] = speed_i
    a[:, Error.V, Error.V] = -1.0 / tau

    b = np.zeros((len(v), 7, 3))
    b[:, Error.PSI_T, 0] = v / length_t
    b[:, Error.PSI_I, 0] = equations.hitch_sign * v * vehicle.drawbar_offset / (length_t * length_i)
    b[:, Error.PSI_I, 1] = v / length_i
    b[:, Error.V, 2] = vehicle.speed_gain / tau
    return a, b


def printed_feedforward(
    reference: ReferenceSample, vehicle: Vehicle, equations: PaperEquations
) -> FloatArray:
    """Return u_f = (delta^t_r, lambda_r, HP_r) of eq. (ffcontrolaction), (N, 3).

    With a straight drawbar and small angles, lambda_r = (gamma^i L^i - s gamma^t L^d) / v, where
    s is the sign at the hitch (+1 as printed). The paper's delta^i_r is lambda_r - beta.
    """
    v = reference.state[:, -1]
    lever_i = reference.yaw_rate_i * vehicle.trailer_length
    lever_t = equations.hitch_sign * reference.yaw_rate_t * vehicle.drawbar_offset
    return np.stack(
        [
            reference.yaw_rate_t * vehicle.wheelbase / v,
            (lever_i - lever_t) / v,
            v / vehicle.speed_gain,
        ],
        axis=-1,
    )


class PaperFeedback(FeedbackLaw):
    """Linear MPC on the printed error model, and the tanh law on the modelling error.

    The paper uses a nominal tracking error zbar_e and does not define it (erratum 8). In the
    reading `one-step` it is predicted by the linear model from the previous error and feedback,

        zbar(k) = A_{k-1} z_e(k-1) + B_{k-1} u_b(k-1).

    `tube` is the nominal system of Mayne, Seron and Rakovic (2005), on which the MPC acts,

        zbar(k) = A_{k-1} zbar(k-1) + B_{k-1} u_b(k-1).

    Both start at zbar = z_e, and start again there after a missed tick.
    """

    def __init__(
        self, grid: ReferenceSample, vehicle: Vehicle, period_s: float, options: PaperOptions
    ) -> None:
        self._grid = grid
        a, b = zero_order_hold(*linearise(grid, vehicle, options), period_s)
        # No period starts at the last sample: it is only predicted.
        horizon = CondensedHorizon(a[:-1], b[:-1], options, period_s)
        self._mpc = LinearMpc(horizon)
        self._previous: FloatArray = np.zeros(len(Input))  # u_e(k-1)
        self._a, self._b, self._tube = a, b, options.nominal == "tube"
        self._nominal: FloatArray | None = None  # zbar of the coming tick
        self._tick = -1  # the coming tick
        self._robust = None
        if options.robust:
            self._robust = RobustLaw(options, options.robust_sign, period_s)
        self._to_vehicle = np.array([1.0, 1.0, 1.0 / options.hp_full_scale])
        self._path = PredictedPath(grid)
        self._positions = np.ascontiguousarray(horizon.stages.outputs[:, POSITIONS])

    def resume(self, previous: object) -> None:
        """Keep the input of the last tick, see `ttempc.types.Controller.resume`."""
        if isinstance(previous, PaperFeedback):
            self._previous = previous._previous

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Diagnostics:
        error = estimated_error(estimate, self._grid, k)
        nominal = error if self._nominal is None or k != self._tick else self._nominal
        mpc_state = nominal if self._tube else error
        u_b, report = self._mpc.step(k, mpc_state, self._previous)
        self._previous, self._tick = u_b, k + 1
        self._nominal = self._a[k] @ mpc_state + self._b[k] @ u_b
        u_m, z_m = np.zeros(len(Input)), None
        if self._robust:
            u_m, z_m = self._robust.step(k, nominal, error)
        return Diagnostics(
            feedback=-u_b * self._to_vehicle,
            robust=u_m * self._to_vehicle,
            modelling_error=z_m,
            predicted_path=self._path.under(k, self._mpc.work, self._positions[k + 1 :]),
            solver=report,
            fallback="" if report.accepted else f"QP {report.status}: previous feedback held",
        )

    def prepare(self, k: int) -> None:
        self._mpc.prepare(k)


def paper_controller(
    vehicle: Vehicle, reference: Reference, period_s: float, options: PaperOptions = PaperOptions()
) -> TrackingController:
    """Compose the paper's controller: `paper`."""
    options = _in_paper_unit(options)
    grid = reference.on_grid(period_s, beyond=options.horizon)
    ticks = len(grid.time_s) - options.horizon
    if options.feedforward == "printed":
        feedforward = printed_feedforward(grid, vehicle, options)[:ticks]
    else:
        feedforward = exact_feedforward(reference, ticks, period_s)
        feedforward[:, Input.DELTA_I] += grid.hitch_angle[:ticks]  # lambda_r = beta_r + delta_i_r
    feedforward[:, Input.HP] /= options.hp_full_scale
    feedback = PaperFeedback(grid, vehicle, period_s, options)
    limits = CommandLimits.of(vehicle, period_s)
    measured_hitch = options.hitch_angle == "measured"
    return TrackingController(grid, feedforward, feedback, limits, measured_hitch=measured_hitch)


def _in_paper_unit(options: PaperOptions) -> PaperOptions:
    delta_t, delta_i, hp = options.saturation
    scale = options.hp_full_scale
    return replace(
        options,
        input_bound=(*options.input_bound[: Input.HP], options.input_bound[Input.HP] * scale),
        input_rate=(*options.input_rate[: Input.HP], options.input_rate[Input.HP] * scale),
        saturation=(delta_t, delta_i, hp * scale),
    )
