"""The paper's controller: its equations as printed, and the readings where they leave a choice.

E. Kayacan, H. Ramon, W. Saeys (2016), "Robust Trajectory Tracking Error Model-Based Predictive
Control for Unmanned Ground Vehicles", IEEE/ASME Transactions on Mechatronics 21(2).
"""

from dataclasses import dataclass, replace
from typing import Final, Literal, get_args, get_type_hints

import numpy as np

from ..errors import check_choice, check_flag, check_vector
from ..laws.tracking_controller import TrackingController
from ..models.kinematics import Error
from ..models.linear import zero_order_hold
from ..mpc.lmpc import CondensedHorizon, HorizonTuning
from ..reference.reference import Reference, ReferenceSample, exact_feedforward
from ..types import FloatArray, Input
from ..vehicle import CommandLimits, Vehicle
from .paper_law import CONSTANTS, NOMINALS, PaperLaw, PaperTables

HitchAngle = Literal["added", "subtracted", "reference"]
Nominal = Literal["reference", "one-step", "model"]

_HITCH_SIGNS: Final = {"added": 1.0, "subtracted": -1.0, "reference": 0.0}
_PERCENT: Final = 100.0  # per fraction


@dataclass(frozen=True)
class PaperEquations:
    """Reading of the equations of Kayacan, Ramon and Saeys (2016).

    The numbers are those of the errata in docs/appendix/errata.md. The defaults are those of the
    controller `paper`: of the readings that were driven they agree best with what the paper
    reports of its own experiment (docs/appendix/errata.md).
    """

    # 1: sign of the hitch term in the trailer's yaw equation; +1 printed, -1 geometry
    hitch_sign: Literal[1, -1] = 1
    # 2, 9: delta_i = lambda - beta with the measured hitch angle, whose sign is not printed. In the
    #    convention of this project, lambda = beta + delta_i, the measured angle is "added" or
    #    "subtracted"; "reference": the angle of the reference is subtracted
    hitch_angle: HitchAngle = "added"
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
    # 8: the nominal state zbar_e, which is not defined; see `PaperLaw`
    nominal: Nominal = "reference"
    # 8: what the MPC predicts from: z_e ("for a given z_e(k)"), or the nominal state of a tube
    mpc_start: Literal["error", "nominal"] = "error"
    # 10: whether A has the column of v_e in the yaw rows, gamma_r / v_r, which the print leaves out
    yaw_by_speed: bool = False
    # 13: units of the inputs in R = diag(1, 1, 1), which are not printed
    hp_in_cost: Literal["percent", "fraction"] = "percent"
    steering_in_cost: Literal["rad", "deg", "rad/s"] = "rad"

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(PaperEquations).items():
            if hint is bool:
                check_flag(name, getattr(self, name))
            else:
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
        check_vector("saturation", self.saturation, len(Input))
        check_vector("proportional", self.proportional, len(Input))
        check_vector("derivative", self.derivative, len(Input), zero=True)


@dataclass(frozen=True)
class PaperOptions(PaperEquations, RobustGains, HorizonTuning):
    """Options of `paper`: horizon, weights and bounds, gains, and the reading of the equations.

    Bounds and gains of the hydrostat are for its position as a fraction, `step_weight` for the
    units that the reading names.
    """

    robust: bool = True  # whether the robust law acts

    def __post_init__(self) -> None:
        HorizonTuning.__post_init__(self)
        RobustGains.__post_init__(self)
        PaperEquations.__post_init__(self)
        check_flag("robust", self.robust)


@dataclass(frozen=True)
class RateWeightOptions(PaperOptions):
    """Options of `paper-rate-weight`: the cost has steering in rad/s, the hydrostat in percent."""

    steering_in_cost: Literal["rad", "deg", "rad/s"] = "rad/s"


@dataclass(frozen=True)
class TubeOptions(PaperOptions):
    """Options of `paper-tube`: MPC and nominal state as in the tube MPC that the paper cites.

    Mayne, Seron and Rakovic (2005): the nominal system runs under the MPC alone.
    """

    nominal: Nominal = "model"
    mpc_start: Literal["error", "nominal"] = "nominal"


@dataclass(frozen=True)
class SubtractedOptions(PaperOptions):
    """Options of `paper-subtracted`, with which the trailer's steering stands at its stop.

    The measured hitch angle is subtracted in the convention of this project, the nominal state is
    a one-step prediction, and the hydrostat is a fraction throughout.
    """

    hitch_angle: HitchAngle = "subtracted"
    nominal: Nominal = "one-step"
    hp_in_cost: Literal["percent", "fraction"] = "fraction"


@dataclass(frozen=True)
class PrintedSignOptions(PaperOptions):
    """Options of `paper-printed-sign`: the sign of the robust action as printed (erratum 6).

    In the one-step reading the modelling error does not depend on where the vehicle is, and its
    sign has next to no effect; here the nominal state is the reference.
    """

    robust_sign: Literal[1, -1] = 1


def linearise(
    reference: ReferenceSample, vehicle: Vehicle, equations: PaperEquations
) -> tuple[FloatArray, FloatArray]:
    """Return A (N, 7, 7) and B (N, 7, 3) of eq. (errorstateupdate) at N reference samples.

    z_e' = A z_e + B u_e with u_e = u_r - u, u = (delta^t, lambda, HP).
    """
    v = reference.state[:, -1]
    speed_i = v if equations.trailer_speed == "tractor" else reference.speed_i
    length_t = vehicle.wheelbase
    length_i = vehicle.trailer_length
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
    if equations.yaw_by_speed:
        a[:, Error.PSI_T, Error.V] = reference.yaw_rate_t / v
        a[:, Error.PSI_I, Error.V] = reference.yaw_rate_i / v

    b = np.zeros((len(v), 7, 3))
    b[:, Error.PSI_T, Input.DELTA_T] = v / length_t
    lever = equations.hitch_sign * vehicle.drawbar_offset
    b[:, Error.PSI_I, Input.DELTA_T] = lever * v / (length_t * length_i)
    b[:, Error.PSI_I, Input.DELTA_I] = v / length_i
    b[:, Error.V, Input.HP] = vehicle.speed_gain / tau
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


def paper_controller(
    vehicle: Vehicle, reference: Reference, period_s: float, options: PaperOptions = PaperOptions()
) -> TrackingController:
    """Compose the paper's controller in the reading of its options."""
    options = _in_model_units(options, period_s)
    grid = reference.on_grid(period_s, beyond=options.horizon)
    ticks = len(grid.time_s) - options.horizon
    if options.feedforward == "printed":
        feedforward = printed_feedforward(grid, vehicle, options)[:ticks]
    else:
        feedforward = exact_feedforward(reference, ticks, period_s)
        feedforward[:, Input.DELTA_I] += grid.hitch_angle[:ticks]  # lambda_r = beta_r + delta_i_r
    feedforward[:, Input.HP] /= options.hp_full_scale

    a, b = zero_order_hold(*linearise(grid, vehicle, options), period_s)
    # No period starts at the last sample: it is only predicted.
    horizon = CondensedHorizon(a[:-1], b[:-1], options, period_s)
    law = PaperLaw(grid, horizon, paper_tables(options, grid, period_s))
    return TrackingController(
        grid,
        feedforward,
        law,
        CommandLimits.of(vehicle, period_s),
        measured_hitch=_HITCH_SIGNS[options.hitch_angle],
    )


def paper_tables(options: PaperOptions, grid: ReferenceSample, period_s: float) -> PaperTables:
    """Return the tables of the law for options in the units of the model's inputs."""
    constants = np.zeros(CONSTANTS.itemsize // 8)
    values = constants.view(CONSTANTS)[0]
    for name in ("saturation", "proportional", "derivative"):
        values[name] = getattr(options, name)
    values["sign"] = options.robust_sign
    values["period_s"] = period_s
    values["nominal"] = NOMINALS[options.nominal]
    values["from_nominal"] = options.mpc_start == "nominal"
    values["robust"] = options.robust
    values["full_scale"] = options.hp_full_scale
    return PaperTables(constants, np.concatenate([grid.state, grid.trailer_xy], axis=1))


def _in_model_units(options: PaperOptions, period_s: float) -> PaperOptions:
    """Return the options in the units of the model's inputs: radians, stroke as of erratum 7.

    The printed weights R are for the units that the reading names; a weight of an input is divided
    by the square of its unit.
    """
    full_scale = options.hp_full_scale
    hp_unit = {"percent": full_scale / _PERCENT, "fraction": full_scale}[options.hp_in_cost]
    steering_unit = {"rad": 1.0, "deg": np.pi / 180.0, "rad/s": period_s}[options.steering_in_cost]
    units = np.array([steering_unit, steering_unit, hp_unit])
    in_model = np.array([1.0, 1.0, full_scale])

    def scaled(values: tuple[float, ...], factors: FloatArray) -> tuple[float, ...]:
        return tuple((np.array(values) * factors).tolist())

    delta_t, delta_i, hp = options.saturation
    return replace(
        options,
        step_weight=scaled(options.step_weight, units**-2),
        input_bound=scaled(options.input_bound, in_model),
        input_rate=scaled(options.input_rate, in_model),
        saturation=(delta_t, delta_i, hp * full_scale),
    )
