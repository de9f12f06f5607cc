"""Side slip that a curve itself makes, known from the reference and learnt while driving.

A body that turns needs a lateral force at its axle, and tyres give it at a slip angle: in a steady
curve the cornering compliance of R. S. Rice (SAE 730150, 1973), mass on the axle over the cornering
stiffness of its tyres.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Final

import numpy as np

from ..layout import ESTIMATE
from ..models.augmented_state import MAPPED, vehicle_parameters
from ..reference.reference import Reference
from ..types import Disturbance, FloatArray, State
from ..vehicle import Vehicle
from .field import shown

_BODIES: Final = 2  # tractor, trailer: the first two of `Disturbance`
_UNKNOWN: Final = 2  # compliance, and the rest of the slip as a constant
_COMPLIANCE: Final = 0
_REST: Final = 1
_WINDOW: Final = 3  # estimates over which a motion shows a slip

_PRIOR_SD: Final = 0.01  # standard deviation of a given compliance [rad s^2/m]; assumed
_REST_SD: Final = 0.02  # of the rest of the slip [rad]; assumed
# Of the slip that the motion of the estimate shows in a tick [rad]: on a tuning seed 0.011, with a
# correlation of 0.41 from tick to tick; and of the change of the rest in a tick, assumed
_SHOWN_SD: Final = 0.017
_REST_WALK: Final = 0.0005
# The filter explains a part of an unexpected slip by heading and steering: the share of it that the
# motion of its estimate shows. With a wrong share the compliance is found as well, only slower
# or faster, since the rest that is not expected yet goes to 0 in either case; on tuning seeds
_SHARE: Final = 0.5
_SETTLED_S: Final = 5.0  # from the first estimate on, until which nothing is learnt; assumed
# Largest lateral acceleration of a reference from which on it counts [m/s^2]; assumed. Below, the
# slip of curves is less than that of the ground, which would pass for it: on `grass` at 1 m/s,
# 0.1 m/s^2, the trailer's error grew by 3 % with it
_LEAST_ACCELERATION: Final = 0.2
_LARGEST: Final = 0.1  # compliance that is believed [rad s^2/m]


class CurveSlip:
    """Slips -c a of both axles along a reference, by its lateral acceleration a = |v| psi'.

    c is the compliance of a body (`Vehicle.compliance_t`, `compliance_i`). Of the slips, as of
    `ttempc.learning.field.FieldMap`, only changes are given: to the filter from a tick to the next
    one, to the plan from the present tick on.

    While the vehicle drives, a Kalman filter a body learns c and a constant rest b from the slip
    that the motion of the estimate shows,

        slip + (1 - e) c_now a = -e c a + b,

    c_now that the estimator was told, e the share of an unexpected slip that its motion shows.

    Args:
        reference: what is driven, with the parameters of the model.
        period_s: control period [s].
        lead_s: time by which the reference of the controller is ahead [s].
    """

    def __init__(self, reference: Reference, period_s: float, lead_s: float = 0.0) -> None:
        grid = reference.on_grid(period_s, beyond=1)
        speed = np.abs(grid.state[:, State.V])
        headings = np.unwrap(grid.state[:, [State.PSI_T, State.PSI_I]], axis=0)
        # Beyond its end the reference goes on as at its last tick: enough rows for any horizon
        self._acceleration = speed[:, None] * np.gradient(headings, period_s, axis=0)  # (T, 2)
        self._counts = bool(np.abs(self._acceleration).max() >= _LEAST_ACCELERATION)
        self._acceleration *= self._counts
        self._period_s = period_s
        self._unsettled = round(_SETTLED_S / period_s)
        self._last = -2  # tick of the last estimate
        self._states: list[FloatArray] = []  # the last estimates of consecutive ticks
        self._none = np.zeros(MAPPED)

        vehicle = reference.vehicle
        given = np.array([vehicle.compliance_t, vehicle.compliance_i])
        self._mean = np.zeros((_BODIES, _UNKNOWN))  # of c [rad s^2/m] and b [rad]
        self._mean[:, _COMPLIANCE] = given
        self._covariance = np.zeros((_BODIES, _UNKNOWN, _UNKNOWN))
        self._covariance[:, _COMPLIANCE, _COMPLIANCE] = _PRIOR_SD**2
        self._covariance[:, _REST, _REST] = _REST_SD**2
        self.exchange(vehicle, lead_s)

    def exchange(self, vehicle: Vehicle, lead_s: float) -> None:
        """Learn on with other model parameters and another lead of the controller."""
        self._parameters = vehicle_parameters(vehicle)
        self._lead = round(lead_s / self._period_s)

    def warm_up(self) -> None:
        """Compile or load what a tick needs; no later result changes."""
        twin = deepcopy(self)
        twin._unsettled = 0
        for k in range(_WINDOW):
            twin.observe(k, np.ones(ESTIMATE.itemsize // 8), True)

    @property
    def compliance(self) -> FloatArray:
        """Compliance of tractor and trailer as learnt so far, (2,) [rad s^2/m]."""
        return self._mean[:, _COMPLIANCE].copy()

    @property
    def compliance_sd(self) -> FloatArray:
        """Standard deviation of `compliance`, (2,)."""
        return np.sqrt(self._covariance[:, _COMPLIANCE, _COMPLIANCE])

    def change(self, k: int) -> FloatArray:
        """Return by how much the slips change up to tick k from the tick before, (3,) [rad].

        0 where the reference has waited.
        """
        if k != self._last + 1 or not 0 < k < len(self._acceleration):
            return self._none
        change = np.zeros(MAPPED)
        step = self._acceleration[k] - self._acceleration[k - 1]
        change[:_BODIES] = -self._mean[:, _COMPLIANCE] * step
        return change

    def ahead(self, k: int, count: int) -> FloatArray:
        """Return the changes from tick k to ticks k, k + 1, ... k + count - 1, (count, 3) [rad]."""
        result = np.zeros((count, MAPPED))
        last = len(self._acceleration) - 1
        first = min(k + self._lead, last)
        rows = self._acceleration[first : first + count]
        result[: len(rows), :_BODIES] = -self._mean[:, _COMPLIANCE] * (rows - rows[0])
        result[len(rows) :] = result[len(rows) - 1]
        return result

    def known(self, k: int) -> float:
        """Return 0: a slip that is the curve's own does not tell of the ground."""
        return 0.0

    def observe(self, k: int, row: FloatArray, usable: bool) -> None:
        """Take in the record `ESTIMATE` at tick `k` of the reference.

        Where the reference waits, and at ticks that are not `usable`, nothing is learnt.
        """
        follows = k == self._last + 1
        if k == self._last:
            self._states.clear()
            return
        self._last = k
        self._unsettled = max(self._unsettled - 1, 0)
        if not (follows and usable):
            self._states.clear()
        if not usable or self._unsettled or not self._counts:
            return
        self._states = [*self._states, row.view(ESTIMATE)["state"][0].copy()][-_WINDOW:]
        middle = k - 1
        if len(self._states) < _WINDOW or middle >= len(self._acceleration):
            return
        slips = np.empty(MAPPED)
        shown(np.array(self._states), self._period_s, self._parameters, slips)
        if np.isfinite(slips).all():
            self._learn(slips[[Disturbance.SLIP_T, Disturbance.SLIP_I]], self._acceleration[middle])

    def _learn(self, slips: FloatArray, acceleration: FloatArray) -> None:
        """Correct both compliances by the slips (2,) of a tick with these accelerations (2,)."""
        told = self._mean[:, _COMPLIANCE]
        measured = slips + (1.0 - _SHARE) * told * acceleration
        self._covariance[:, _REST, _REST] += _REST_WALK**2
        for body in range(_BODIES):
            mean = self._mean[body]
            covariance = self._covariance[body]
            row = np.array([-_SHARE * acceleration[body], 1.0])
            gain = covariance @ row / (row @ covariance @ row + _SHOWN_SD**2)
            mean += gain * (measured[body] - row @ mean)
            covariance -= np.outer(gain, row @ covariance)
            mean[_COMPLIANCE] = min(max(mean[_COMPLIANCE], 0.0), _LARGEST)
