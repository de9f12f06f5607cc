"""The robust action of `ttempc`: the paper's saturated law with a regulator's gains."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..errors import InvalidTuning
from ..mpc.riccati import riccati_gains
from ..types import FloatArray, State
from .robust_law import Nominal, RobustGains

_N = len(State)
# A law that wants more than this many times its authority will not bring the vehicle back.
_EXHAUSTED = 3.0
_TINY = 1e-30


@dataclass(frozen=True, slots=True)
class RegulatorTuning:
    """What the robust action answers, how stiffly, and how far it may go.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    # The reading of erratum 8, see `ttempc.laws.robust_law.Nominal`.
    nominal: Literal["one-step", "tube"] = "one-step"
    # Largest action k_s [rad], [rad], fraction; the paper's.
    saturation: tuple[float, float, float] = RobustGains().saturation
    # Cost of an action [1/rad^2], [1/rad^2], 1, beside errors of both points at 1 / m^2 each: 2 cm
    # weigh as much as 2 deg of steering or 4 % of the hydrostat.
    input_weight: tuple[float, float, float] = (0.3, 0.3, 0.3)
    # Whether the MPC leaves k_s of every input free, so that no sum of both is ever limited: the
    # law's exact tightening. It takes room from the MPC that the law seldom uses.
    tightened: bool = False
    # In the one-step reading: time over which it is measured what comes again [s].
    memory_s: float = 5.0

    def __post_init__(self) -> None:
        if self.nominal not in ("one-step", "tube"):
            raise InvalidTuning(f"nominal: got {self.nominal!r}, allowed are 'one-step', 'tube'")
        for name in ("saturation", "input_weight"):
            values = getattr(self, name)
            if not all(math.isfinite(v) and v > 0.0 for v in values):
                raise InvalidTuning(f"{name}: got {values}, must be finite and above 0")
        if not (math.isfinite(self.memory_s) and self.memory_s > 0.0):
            raise InvalidTuning(f"memory_s: got {self.memory_s}, must be finite and above 0")


TUBE = RegulatorTuning(nominal="tube")


@dataclass(frozen=True, slots=True)
class RobustAction:
    """What the robust law wants at one tick, and what is left to the MPC."""

    input: FloatArray  # u_m (3,)
    nominal: FloatArray  # (7,) zbar_e
    deviation: FloatArray  # (7,) z_e - zbar_e
    modelling_error: FloatArray  # (4,) z_m of x, y of tractor, of trailer [m]
    mpc_state: FloatArray  # (n,) the error on which the MPC acts
    mpc_before: FloatArray  # (3,) the input u_e(k-1) from which the MPC steps on
    fallback: str  # that the law was not enough


class RobustRegulator:
    """u_m = k_s tanh(r K z_m / k_s), z_m = z_e - zbar_e, element by element.

    K is the gain of the linear-quadratic regulator on the articulated error model along the
    reference, with the actuators' lags in it. K z_m stands for the printed k_p z_m + k_d z_m',
    since the rate of a position error is heading and speed error; taken from the model it does not
    amplify the estimate's noise as a difference over a period does.

    One-step reading: zbar_e is predicted from the last error and the input that was really sent, so
    that z_m is what nobody foresaw. The MPC answers it, for it has happened; the robust action
    answers what will come again, r K z_m with the correlation of the wanted action with the one of
    the tick before,

        r = sum f^j w(k-j) w(k-j-1) / sum f^j (w(k-j)^2 + w(k-j-1)^2) / 2,   w = K z_m,

    within [0, 1] and with f from `memory_s`. Where filter and model are right, surprises are white
    and r is 0; slopes, patches and furrows that they do not know make it grow.

    Tube reading: r = 1, all feedback on the vehicle is this law. The nominal state starts anew at
    z_e where the law's authority is exhausted: then the MPC has to bring the vehicle back.

    `a` (N, n, n), `b` (N, n, 3) and `c` (N + 1, 4, n) are those of
    `ttempc.mpc.articulated_error.error_dynamics`.
    """

    def __init__(
        self,
        a: FloatArray,
        b: FloatArray,
        c: FloatArray,
        period_s: float,
        tuning: RegulatorTuning,
    ) -> None:
        seen = c[:-1, :, :_N]
        cost = seen.transpose(0, 2, 1) @ seen
        gains = riccati_gains(a[:, :_N, :_N], b[:, :_N], cost, np.array(tuning.input_weight))
        self._limit = np.array(tuning.saturation)
        self._relative = gains / self._limit[:, None]  # (N, 3, 7)
        self._positions = seen
        self._nominal = Nominal(a, b, tuning.nominal)
        self._tube = tuning.nominal == "tube"
        self._last: tuple[int, FloatArray, FloatArray] | None = None  # tick, MPC's state, u_b
        self._recurrence = Recurrence(len(self._limit), math.exp(-period_s / tuning.memory_s))

    def step(self, k: int, error: FloatArray, before: FloatArray) -> RobustAction:
        """Return the action of tick `k`.

        Args:
            k: the tick.
            error: z_e and the disturbances as in `ttempc.mpc.articulated_error`, (n,).
            before: u_e(k-1) (3,), the reference's input less the one that was sent.
        """
        if self._last:
            tick, state, feedback = self._last
            before = feedback if self._tube else before
            self._nominal.advance(tick, state, before)
        nominal = self._nominal.at(k, error)[:_N]
        deviation = error[:_N] - nominal  # z_m
        wanted = self._relative[k] @ deviation
        if not self._tube:
            wanted = self._recurrence.share(wanted) * wanted
            mpc_state, fallback = error, ""
        elif np.abs(wanted).max() <= _EXHAUSTED:
            # What lasts acts on both, as it is known now.
            mpc_state, fallback = np.concatenate([nominal, error[_N:]]), ""
        else:
            mpc_state, fallback = error, "robust action exhausted: nominal state starts anew"
            deviation, wanted = np.zeros(_N), np.zeros(len(wanted))
        return RobustAction(
            self._limit * np.tanh(wanted),
            nominal,
            deviation,
            self._positions[k] @ deviation,
            mpc_state,
            before,
            fallback,
        )

    def note(self, k: int, mpc_state: FloatArray, feedback: FloatArray) -> None:
        """Remember the MPC's state and its `feedback` u_b (3,) of tick `k`."""
        self._last = k, mpc_state, feedback


class Recurrence:
    """How much of each entry of a signal comes again in the next period, by its own past."""

    def __init__(self, entries: int, forgetting: float) -> None:
        self._forgetting = forgetting
        self._before = np.zeros(entries)
        self._product, self._power = np.zeros(entries), np.zeros(entries)

    def share(self, now: FloatArray) -> FloatArray:
        """Take in the signal of this period and return its correlation within [0, 1], (n,)."""
        self._product = self._forgetting * self._product + now * self._before
        self._power = self._forgetting * self._power + 0.5 * (now**2 + self._before**2)
        self._before = now
        return np.minimum(np.maximum(self._product / np.maximum(self._power, _TINY), 0.0), 1.0)
