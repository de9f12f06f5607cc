"""Invariance of the paper's tube, -1 m <= z_m <= 1 m and U - K Z_m, for its model and gains.

    python -m experiments.studies.paper_tube

Prints the figures of docs/tube.md: the part of the input set that the robust action uses, the modes
of the linear closed loop of the modelling error, and the share of modelling errors inside the
assumed box that leave it without disturbance. The robust law acts alone, as a tube requires: z_m is
the deviation from the nominal state, and u = u_f - u_b + u_m with erratum 6 corrected and as
printed.
"""

from __future__ import annotations

import math

import numpy as np

from ttempc.baselines.paper import PaperEquations, RobustGains, linearise
from ttempc.errors import InvalidTube
from ttempc.models.kinematics import POSITIONS, Error
from ttempc.models.linear import zero_order_hold
from ttempc.mpc.lmpc import HorizonTuning
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.sets import DisturbanceSet
from ttempc.tube.tube import TrackingSystem, invariant_tube
from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
SECTIONS = {"straight": 2.0, "curve": 24.0}  # times along the figure eight [s]
ACTS_ON = (Error.Y_T, Error.Y_I, Error.X_T)  # errors that delta_t, lambda and HP act on
BOX_M = 1.0
YAW_RAD = 0.1  # yaw deviations of the draws, within
SPEED_MPS = 0.05  # speed deviations of the draws, within
DRAWS = 2000
STEPS = 300  # a minute
SEED = 1


def model(time_s: float) -> tuple[FloatArray, FloatArray]:
    """Return A (7, 7) and B (7, 3) of the paper's error model at a time of its reference."""
    reference = Reference(figure_eight(), Vehicle(), ConstantSpeed(1.0))
    grid = reference.at(np.array([time_s]))
    a, b = zero_order_hold(*linearise(grid, Vehicle(), PaperEquations()), PERIOD_S)
    return a[0], b[0]


def linear_loop(a: FloatArray, b: FloatArray, gains: RobustGains, sign: int) -> FloatArray:
    """Return the closed loop of (z_m, positions one step before), tanh linearised, (11, 11).

    The modelling error is the deviation of z_e, so that u_m moves it by -B u_m.
    """
    now, before = np.zeros((3, 7)), np.zeros((3, 7))
    for row, (state, k_s, k_p, k_d) in enumerate(
        zip(ACTS_ON, gains.saturation, gains.proportional, gains.derivative, strict=True)
    ):
        now[row, state] = k_s * (k_p + k_d / PERIOD_S)
        before[row, state] = -k_s * k_d / PERIOD_S
    positions = list(POSITIONS)
    loop = np.zeros((11, 11))
    loop[:7, :7] = a + sign * b @ now
    loop[:7, 7:] = sign * b @ before[:, positions]
    loop[7:, positions] = np.eye(4)
    return loop


def leaving(a: FloatArray, b: FloatArray, gains: RobustGains, sign: int) -> float:
    """Return the share of deviations from inside the box that leave it, undisturbed."""
    generator = np.random.default_rng(SEED)
    positions = list(POSITIONS)
    z = generator.uniform(-1.0, 1.0, (DRAWS, 7))
    z[:, positions] *= BOX_M
    z[:, [Error.PSI_T, Error.PSI_I]] *= YAW_RAD
    z[:, Error.V] *= SPEED_MPS
    before, left = z, np.zeros(DRAWS, dtype=bool)
    k_s, k_p, k_d = map(np.array, (gains.saturation, gains.proportional, gains.derivative))
    for _ in range(STEPS):
        held, last = (np.clip(one[:, list(ACTS_ON)], -1.0, 1.0) for one in (z, before))
        u_m = k_s * np.tanh(k_p * held + k_d * (held - last) / PERIOD_S)
        before, z = z, z @ a.T + sign * u_m @ b.T
        left |= (np.abs(z[:, positions]) > BOX_M).any(axis=1)
    return float(left.mean())


def invariant(loop: FloatArray) -> str:
    """Return the half widths of the invariant set under 1 mm, 1 mrad and 1 mm/s per step."""
    n = len(loop)
    system = TrackingSystem(
        loop[None],
        np.zeros((1, n, 1)),
        np.eye(n)[None],
        np.zeros((1, 1, n)),
        np.zeros(1, dtype=np.intp),
    )
    try:
        half = invariant_tube(system, DisturbanceSet(1e-3 * np.eye(n), shape="box")).states[0]
    except InvalidTube as error:
        return f"no invariant set, {error}"
    trailer = half[Error.Y_I - (n < 11)]  # one place ahead where x_i is left out
    return f"x_t {half[Error.X_T]:.2f} m, y_t {half[Error.Y_T]:.2f} m, y_i {trailer:.2f} m"


def main() -> None:
    """Print input sets, modes and shares."""
    gains, bound = RobustGains(), HorizonTuning().input_bound
    print("What u_m takes of U, and what is left of it (delta_t and lambda [deg], HP [%]):")
    scale = (math.degrees(1.0), math.degrees(1.0), 100.0)
    for label, taken in (
        ("linear in z_m, |z_m| <= 1", np.multiply(gains.saturation, gains.proportional)),
        (
            "saturated, no derivative",
            np.multiply(gains.saturation, np.tanh(gains.proportional)),
        ),
        ("saturated, any derivative: k_s", np.array(gains.saturation)),
    ):
        cells = [
            f"{s * t:.2f} of {s * u:.2f}, left {s * (u - t):+.2f}"
            for s, t, u in zip(scale, taken, bound, strict=True)
        ]
        print(f"  {label:<32}{'; '.join(cells)}")
    for section, time_s in SECTIONS.items():
        a, b = model(time_s)
        for name, sign in (("corrected", -1), ("as printed", 1)):
            loop = linear_loop(a, b, gains, sign)
            modes = np.sort(np.abs(np.linalg.eigvals(loop)))[::-1][:4]
            print(
                f"{section}, sign {name}: largest moduli {np.round(modes, 4).tolist()}, "
                f"{100 * leaving(a, b, gains, sign):.0f} % leave the box undisturbed"
            )
            print(f"  all seven states: {invariant(loop)}")
            kept = [row for row in range(11) if row not in (Error.X_I, 7 + 2)]
            print(f"  without x_i:      {invariant(loop[np.ix_(kept, kept)])}")


if __name__ == "__main__":
    main()
