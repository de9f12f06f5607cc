"""Articulated error model along a reference: dynamics, state and input bounds."""

import math
from enum import IntEnum
from typing import Final

import numpy as np

from ..jit import cached_njit, record
from ..jit.rows import WIDTH
from ..layout import ESTIMATE, estimate_row
from ..models.augmented_state import (
    AugmentedState,
    map_disturbance_gain,
    state_rate_jacobian,
    vehicle_parameters,
)
from ..models.kinematics import trailer_point_jacobian
from ..models.linear import zero_order_hold
from ..reference.corridor import Corridor
from ..reference.reference import Reference, ReferenceSample
from ..types import Disturbance, Estimate, FloatArray, Immutable, Input, MapDisturbance, State
from ..vehicle import CommandLimits, Vehicle
from .condensing import StageBounds, Work
from .lmpc import OutputBounds
from .qp import PENALTY


def rotation(angle: FloatArray) -> FloatArray:
    """Return the rotation matrices by `angle` (N,) [rad], counter-clockwise, (N, 2, 2)."""
    cos = np.cos(angle)
    sin = np.sin(angle)
    return np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)


class PredictedPath(Immutable):
    """Path of both axle points under a plan, to first order in the errors."""

    def __init__(self, grid: ReferenceSample) -> None:
        self._to_map = np.zeros((len(grid.state), 4, 4))
        self._to_map[:, :2, :2] = rotation(grid.state[:, State.PSI_T])
        self._to_map[:, 2:, 2:] = rotation(grid.state[:, State.PSI_I])
        self._reference = np.concatenate([grid.state[:, :2], grid.trailer_xy], axis=1)

    def under(self, k: int, work: Work, outputs: FloatArray) -> FloatArray:
        """Return the path of tick `k` under its plan, (Np, 4) [m], map frame.

        `work` has response and steps; `outputs` C (Np, 4, n) of the ticks after `k` lead to
        position errors as in `less`.
        """
        path = np.empty((len(work.response), 4))
        write_path(k, work, outputs, self._to_map, self._reference, path)
        return path

    def less(self, k: int, errors: FloatArray) -> FloatArray:
        """Return the reference after tick `k` less position errors, (Np, 4) [m], map frame.

        The `errors` (Np, 4) of tractor (x, y) and trailer (x, y) are in the frames of the
        reference.
        """
        ahead = slice(k + 1, k + 1 + len(errors))
        return self._reference[ahead] - (self._to_map[ahead] @ errors[..., None])[..., 0]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_path(
    k: int,
    work: Work,
    outputs: FloatArray,
    to_map: FloatArray,
    reference: FloatArray,
    path: FloatArray,
) -> None:
    """Do `PredictedPath.under`: states z_j = free_{j+1} + response_j steps, errors C z_j."""
    error = np.empty(4)
    response = work.response
    steps = work.steps
    for j in range(response.shape[0]):
        error[:] = 0.0
        for n in range(response.shape[1]):
            z = work.free[j + 1, n]
            for i in range(steps.size):
                z += response[j, n, i] * steps[i]
            for p in range(4):
                error[p] += outputs[j, p, n] * z
        for p in range(4):
            path[j, p] = reference[k + 1 + j, p]
            for q in range(4):
                path[j, p] -= to_map[k + 1 + j, p, q] * error[q]


class Output(IntEnum):
    """Rows of the outputs C z: position errors in the frames of the reference [m].

    The weights of the MPC are in this order, `HorizonTuning.output_weight`.
    """

    TRACTOR_ALONG = 0
    TRACTOR_ACROSS = 1  # positive: the tractor point is to the right of its reference
    TRAILER_ALONG = 2
    TRAILER_ACROSS = 3


_N = len(State)
_M = len(Input)
_D = len(Disturbance)
_MAPPED = len(MapDisturbance)
_SIZE = _N + _D + _MAPPED
_DISTURBANCES: Final = [AugmentedState[item.name] for item in Disturbance][:-1]


def error_dynamics(
    reference: Reference, period_s: float, ticks: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A (N, 16, 16), B (N, 16, 3) and C (N + 1, 4, 16) along the reference.

    The state is (z_e, s, m): z_e = T (z_r - z) is the error of the minimal state with the position
    in the frame of the reference tractor, s the body-fixed disturbance (`Disturbance`) and m the
    map-fixed one (`MapDisturbance`), both constant over the horizon. The input is u_e = u_r - u:

        z_e(k+1) = A_z z_e(k) + B_z u_e(k) - E (s + G(psi_r) m),   s(k+1) = s(k),  m(k+1) = m(k).

    The Jacobians of the exact model in the middle of each period are constant over it (zero-order
    hold by the matrix exponential); T turns with the reference. The outputs C z_e are the errors of
    tractor and trailer point in the frames of the reference tractor and trailer.
    """
    # a call of its own, after which the slopes are released: of a long reference these matrices are
    # the largest
    a, b = zero_order_hold(*_slopes(reference, period_s, ticks), period_s)
    grid = reference.at(np.arange(ticks + 1) * period_s)
    turns = rotation(-grid.state[:, State.PSI_T])  # of positions: map frame -> reference frame
    here = np.eye(_SIZE)
    ahead = np.eye(_SIZE)
    for k in range(ticks):
        here[:2, :2] = turns[k]
        ahead[:2, :2] = turns[k + 1]
        a[k] = ahead @ a[k] @ here.T
        b[k] = ahead @ b[k]

    c = np.zeros((ticks + 1, 4, _SIZE))
    c[:, 0, State.X] = c[:, 1, State.Y] = 1.0
    jacobians = [trailer_point_jacobian(state, reference.vehicle) for state in grid.state]
    c[:, 2:, :_N] = rotation(-grid.state[:, State.PSI_I]) @ jacobians
    c[:, 2:, :2] = c[:, 2:, :2] @ turns.transpose(0, 2, 1)
    return a, b, c


def _slopes(reference: Reference, period_s: float, ticks: int) -> tuple[FloatArray, FloatArray]:
    """Return the rows of dA/dt (N, 7, 16), dB/dt (N, 7, 3) of `error_dynamics`, map frame."""
    vehicle = reference.vehicle
    parameters = vehicle_parameters(vehicle)
    middle = reference.at((np.arange(ticks) + 0.5) * period_s)
    gains = map_gains(middle, vehicle)
    slope_a = np.zeros((ticks, _N, _SIZE))
    slope_b = np.zeros((ticks, _N, _M))
    # of the filter's model without disturbances, where the speed over ground is that of the rims
    x = np.zeros(WIDTH)
    jacobian = np.empty((_N, WIDTH))
    by_disturbance = np.zeros((_N, _D))
    d = vehicle.drawbar_length
    length_i = vehicle.trailer_length + vehicle.trailer_turning_offset
    for k, (x[:_N], inputs) in enumerate(zip(middle.state, middle.inputs, strict=True)):
        state_rate_jacobian(x, inputs, parameters, jacobian)
        by_disturbance[:, :-1] = jacobian[:, _DISTURBANCES]  # the wheel slip has no effect on v
        slope_a[k, :_N, :_N] = jacobian[:, :_N]
        slope_a[k, :_N, _N : _N + _D] = -by_disturbance
        slope_a[k, :_N, _N + _D :] = -by_disturbance @ gains[k]
        for command, angle in ((Input.DELTA_T, State.DELTA_T), (Input.DELTA_I, State.DELTA_I)):
            slope_b[k, angle, command] = -jacobian[angle, angle]
        cos_i = math.cos(x[State.DELTA_I])
        swing = -d * cos_i / (length_i + d * cos_i) * slope_b[k, State.DELTA_I, Input.DELTA_I]
        slope_b[k, State.PSI_I, Input.DELTA_I] = swing
    slope_b[:, State.V, Input.HP] = vehicle.speed_gain / vehicle.speed_time_constant
    if vehicle.is_plain:  # a law must not count on steering that is not there
        slope_b[:, :, Input.DELTA_I] = 0.0
    return slope_a, slope_b


def map_gains(reference: ReferenceSample, vehicle: Vehicle) -> FloatArray:
    """Return G (N, 5, 4), the gains from map disturbances to disturbances at N samples."""
    rows = reference.state[:, [State.PSI_T, State.PSI_I, State.V]].tolist()
    return np.array(
        [
            map_disturbance_gain(psi_t, psi_i, v, yaw_rate, vehicle)
            for (psi_t, psi_i, v), yaw_rate in zip(rows, reference.yaw_rate_t.tolist(), strict=True)
        ]
    )


REFERENCE_ERROR: Final = np.dtype(
    [
        ("z_e", "f8", len(State)),  # T (z_r - z): x, y in the frame of the reference tractor
        ("disturbance", "f8", len(Disturbance)),  # s, body-fixed
        ("map_disturbance", "f8", len(MapDisturbance)),  # m, map-fixed
    ]
)
"""State (16,) of the error model, see `error_dynamics`.

z_e is in the order of `State`, in the frame of the reference. The error of the supervisor,
`TICK.tracking`, is another one: of both axle points, in the frames of the vehicle's bodies."""


def error_state(reference: FloatArray, estimate: Estimate, vehicle: Vehicle) -> FloatArray:
    """Return (z_e, s, m) of `error_dynamics`, (16,), for the state (7,) of the reference."""
    error = np.empty(_SIZE)
    row = estimate_row(estimate)
    write_reference_error(reference, row, vehicle.wheelbase, vehicle.speed_time_constant, error)
    return error


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_reference_error(
    reference: FloatArray,
    estimate: FloatArray,
    wheelbase: float,
    time_constant: float,
    error: FloatArray,
) -> None:
    """Write the `REFERENCE_ERROR` of a record `ESTIMATE`, with L_t [m] and tau [s]."""
    e = record(estimate, ESTIMATE)
    x = e.state
    result = record(error, REFERENCE_ERROR)
    z_e = result.z_e

    # positions: from the map frame into that of the reference tractor
    dx = reference[State.X] - x[State.X]
    dy = reference[State.Y] - x[State.Y]
    cos = math.cos(reference[State.PSI_T])
    sin = math.sin(reference[State.PSI_T])
    z_e[State.X] = cos * dx + sin * dy
    z_e[State.Y] = cos * dy - sin * dx
    for i in range(State.PSI_T, _N):
        rest = reference[i] - x[i]
        turns = math.tau * math.floor(rest / math.tau + 0.5) if i <= State.PSI_I else 0.0
        z_e[i] = rest - turns

    # the map-fixed part of the disturbance, and what remains body-fixed
    write_map_part(x, e.map_disturbance, e.disturbance, wheelbase, time_constant, error)
    for i in range(_D):
        result.disturbance[i] = e.disturbance[i] - result.disturbance[i]
    for i in range(_MAPPED):
        result.map_disturbance[i] = e.map_disturbance[i]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_map_part(
    x: FloatArray,
    on_map: FloatArray,
    disturbance: FloatArray,
    wheelbase: float,
    time_constant: float,
    error: FloatArray,
) -> None:
    """Write what a map disturbance (4,) is in the vehicle's frame, see `map_disturbance_gain`.

    It goes into `REFERENCE_ERROR.disturbance`.
    """
    part = record(error, REFERENCE_ERROR).disturbance
    v = x[State.V]
    gear = math.copysign(1.0, v)
    yaw_rate = v * math.tan(x[State.DELTA_T] + disturbance[Disturbance.STEERING]) / wheelbase
    cos = math.cos(x[State.PSI_T])
    sin = math.sin(x[State.PSI_T])
    cos_i = math.cos(x[State.PSI_I])
    sin_i = math.sin(x[State.PSI_I])
    side_x = on_map[MapDisturbance.SIDE_X]
    side_y = on_map[MapDisturbance.SIDE_Y]
    climb_x = on_map[MapDisturbance.CLIMB_X]
    climb_y = on_map[MapDisturbance.CLIMB_Y]

    # wheel slip that turns with the heading is an acceleration by the drive
    drive_by_x = -v * (cos / time_constant - yaw_rate * sin)
    drive_by_y = -v * (sin / time_constant + yaw_rate * cos)
    part[Disturbance.SLIP_T] = gear * (side_y * cos - side_x * sin)
    part[Disturbance.SLIP_I] = gear * (side_y * cos_i - side_x * sin_i)
    part[Disturbance.STEERING] = 0.0
    part[Disturbance.DRIVE] = gear * (drive_by_x * climb_x + drive_by_y * climb_y)
    part[Disturbance.WHEEL] = gear * (cos * climb_x + sin * climb_y)


def remaining_bounds(feedforward: FloatArray, limits: CommandLimits) -> StageBounds:
    """Return the bounds on u_e = u_r - u that follow from `limits`, (N, 3) each.

    `feedforward` is u_r (N, 3). Where it is beyond a limit, the bound is 0.
    """
    change = np.diff(feedforward, axis=0, prepend=feedforward[:1])
    return StageBounds(
        lower=np.minimum(feedforward - limits.upper, 0.0),
        upper=np.maximum(feedforward - limits.lower, 0.0),
        step_lower=change - limits.step,
        step_upper=change + limits.step,
    )


_ACROSS: Final = (Output.TRACTOR_ACROSS, Output.TRAILER_ACROSS)


def damped(
    a: FloatArray,
    outputs: FloatArray,
    period_s: float,
    damping_s: float,
    across: slice = slice(1, None, 2),
) -> FloatArray:
    """Return the outputs C (N + 1, 4, n) with y + tau y' for the cross-track errors y.

    tau is `damping_s`. Over a period without inputs y' = (C_{k+1} A_k - C_k) z / T; an input acts
    on it through the states alone. A cost of these outputs has its minimum on the approach
    y' = -y / tau, which crosses no line.
    """
    result = outputs.copy()
    rate = (outputs[1:, across] @ a[: len(outputs) - 1] - outputs[:-1, across]) / period_s
    result[:-1, across] += damping_s * rate
    result[-1, across] += damping_s * rate[-1]
    return result


HITCH: Final = np.eye(_N)[State.PSI_T] - np.eye(_N)[State.PSI_I] - np.eye(_N)[State.DELTA_I]
"""Row from the error z_e to that of the hitch angle, beta = psi_t - psi_i - delta_i."""
_HITCH_PENALTY: Final = 1000.0  # of a hitch angle beyond its bound [1/rad]; assumed
_HELD_SHARE: Final = 0.6  # of `held_lambda`, that plans in reverse may take
# Time for which the rate of an angle goes on in reverse; with 0.5 s trailers fold on wet slopes
_TURNS_BACK_S: Final = 1.5
_ROOM: Final = math.radians(3.0)  # beyond the reference that a bound leaves at least; assumed


def corridor_bounds(
    corridor: Corridor, grid: ReferenceSample, outputs: FloatArray, first: int, horizon: int
) -> OutputBounds:
    """Return the bounds on the predicted error that keep the vehicle in its corridor.

    The rows are the cross-track errors of tractor and trailer point, and that of the tool point
    where there is one. With a tool l behind the trailer point it is to first order

        y_tool = y_i - l psi_i    of the error z_e.

    Errors are those to the reference of the same time: on a curve the vehicle has to be near it
    along the path, too.

    `outputs` are C (N + 1, 4, n) of `error_dynamics`; the bounds hold from the stage `first` on.
    """
    n = outputs.shape[2]
    half_width = corridor.half_width(grid.distance_m)
    rows = [outputs[:, row] for row in _ACROSS]
    if corridor.tool_behind_m is not None:
        behind = np.zeros(n)
        behind[State.PSI_I] = corridor.tool_behind_m
        rows.append(rows[1] - behind)
    upper = np.tile(half_width[:, None], (1, len(rows)))
    spread = np.zeros((horizon + 1, len(rows)))
    spread[:first] = -np.inf
    return OutputBounds(np.stack(rows, 1), -upper, upper, spread, np.full(len(rows), PENALTY))


def hitch_bounds(
    grid: ReferenceSample,
    vehicle: Vehicle,
    limit: float,
    spread: FloatArray,
    delta_t: float,
    a: FloatArray,
    period_s: float,
) -> OutputBounds:
    """Return the bounds that keep the true hitch angle within `limit` [rad] over the horizon.

    `spread` (Np + 1,) [rad] is by how much the true angle may deviate at stage j from that of the
    linear plan. The model takes lambda for sin lambda, which changes the angle by `limit` -
    sin `limit` at most while it is within the limit; that is taken off as well.

    In reverse the trailer folds by itself. A second bound is on lambda = beta + delta_i, a share of
    `held_lambda` of the front steering `delta_t` that the plan may take: what remains turns lambda
    back. Both hold for the angle and what its rate adds in the time that turning back takes, under
    the dynamics A (N, n, n) without inputs.

    Where the reference itself comes closer than 3 deg to the bound, the bound gives way to that
    distance.
    """
    state = grid.state[: len(a) + 1]
    largest = np.array([math.sin(limit)])
    angle = grid.hitch_angle[: len(state), None]
    rows = np.zeros((len(angle), 2 if vehicle.reverse else 1, _SIZE))
    rows[:, :, :_N] = HITCH
    if vehicle.reverse:
        rows[:, 1, State.DELTA_I] = 0.0
        angle = np.column_stack([angle, state[:, State.PSI_T] - state[:, State.PSI_I]])
        held = _HELD_SHARE * held_lambda(vehicle, delta_t)
        largest = np.array([math.sin(limit), min(limit, held)])
        rows = damped(a, rows, period_s, _TURNS_BACK_S, slice(2))
    room = np.maximum(largest, np.abs(angle) + _ROOM + spread.max())
    spread = np.tile(spread[:, None], (1, rows.shape[1]))
    penalty = np.full(rows.shape[1], _HITCH_PENALTY)
    return OutputBounds(rows, angle - room, angle + room, spread, penalty)


def held_lambda(vehicle: Vehicle, delta_t: float) -> float:
    """Return the lambda [rad] that the front steering `delta_t` [rad] holds on a steady turn.

    With delta_i = 0 both bodies then turn alike, t (L_i + d) = sin lambda - a t cos lambda with the
    tractor's curvature t = tan delta_t / L_t. In reverse a larger lambda grows without end.
    """
    turn = math.tan(delta_t) / vehicle.wheelbase
    behind = vehicle.hitch_offset * turn
    length = vehicle.drawbar_length + vehicle.trailer_length
    return math.atan(behind) + math.asin(min(1.0, turn * length / math.hypot(1.0, behind)))
