"""Tubes on their own models: invariance of the shipped one, and the paper's."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from ttempc.baselines.paper import PaperEquations, RobustGains, linearise
from ttempc.errors import InvalidTube
from ttempc.models.kinematics import POSITIONS, Error
from ttempc.models.linear import zero_order_hold
from ttempc.mpc.lmpc import HorizonTuning
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import ReferenceTube
from ttempc.tube.sets import DisturbanceSet, directions_in, linear_map, minkowski_sum
from ttempc.tube.tube import TrackingSystem, invariant_tube
from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle

from ...scenario.tube_file import read_tube
from ..study import Study
from ..tables import fenced

PERIOD_S: Final = 0.2


def invariance(worst: int = 1_000, stride: int = 20) -> Iterator[str]:
    """Yield how far disturbances push the deviation in the tube of `grass`; no share may exceed 1.

    Deviations start at zero, at ticks all along the figure eight, and are disturbed over the memory
    of the tube by the worst case of a direction, random or along a state, an output or an input.
    Beside them stands the ratio of both sides of the invariance condition in dense directions.

    Args:
        worst: number of worst cases.
        stride: ticks between checks of the condition.
    """
    generator = np.random.default_rng(1)
    design = read_tube("grass").design()
    reference = Reference(figure_eight(laps=1), design.vehicle, ConstantSpeed(1.0))
    ticks = int(reference.duration_s / design.period_s)
    tube = ReferenceTube.along(design, reference, ticks).tube
    certificate = tube.certificate
    window, steps = certificate.window, certificate.terms * certificate.window
    yield f"alpha {certificate.alpha:.4f}, {certificate.terms} windows of {window}"

    largest = 0.0
    for k in range(window, ticks, stride):
        directions = directions_in(7, 1_000, generator) / tube.states[k]
        before = linear_map(tube.transition(k, window), tube.at(k - window))
        after = minkowski_sum([before, tube.last_window(k)]).support(directions)
        largest = max(largest, float((after / tube.at(k).support(directions)).max()))
    yield f"Phi S + V over S, largest in 1000 directions every {stride} ticks: {largest:.6f}"

    shares = []
    for count in range(worst):
        k = int(generator.integers(steps, ticks))
        rows = np.concatenate([np.eye(7), tube.system.c[k], tube.system.gains[k]])
        widths = np.concatenate([tube.states[k], tube.outputs[k], tube.inputs[k]])
        choice = count % (len(rows) + 6)
        if choice < len(rows):
            row, width = rows[choice], widths[choice]
        else:
            row = generator.standard_normal(7) / tube.states[k]
            width = float(tube.at(k).support(row[None])[0])
        deviation, runs = np.zeros(7), tube.worst_case(k, row)
        for step, w in enumerate(runs):
            deviation = tube.system.closed[max(0, k - len(runs) + step)] @ deviation + w
        shares.append(float(deviation @ row) / width)
    yield f"{worst} worst cases: share {min(shares):.4f} to {max(shares):.4f}"


_ACTS_ON: Final = (Error.Y_T, Error.Y_I, Error.X_T)  # errors that delta_t, lambda and HP act on


def paper_tube() -> Iterator[str]:
    """Yield the parts of the paper's tube, -1 m <= z_m <= 1 m and U - K Z_m, for its own gains.

    The part of the input set that the robust action uses, and the modes of the closed loop of the
    modelling error. The robust law acts alone, as a tube requires: z_m is the deviation from the
    nominal state, and u = u_f - u_b + u_m with erratum 6 corrected and as printed.
    """
    law, bound = RobustGains(), HorizonTuning().input_bound
    yield "What u_m takes of U, and what is left of it (delta_t and lambda [deg], HP [%]):"
    scale = (math.degrees(1.0), math.degrees(1.0), 100.0)
    for label, taken in (
        ("linear in z_m, |z_m| <= 1", np.multiply(law.saturation, law.proportional)),
        ("saturated, no derivative", np.multiply(law.saturation, np.tanh(law.proportional))),
        ("saturated, any derivative: k_s", np.array(law.saturation)),
    ):
        cells = [
            f"{s * t:.2f} of {s * u:.2f}, left {s * (u - t):+.2f}"
            for s, t, u in zip(scale, taken, bound, strict=True)
        ]
        yield f"  {label:<32}{'; '.join(cells)}"
    reference = Reference(figure_eight(), Vehicle(), ConstantSpeed(1.0))
    for section, time_s in {"straight": 2.0, "curve": 24.0}.items():
        model = linearise(reference.at(np.array([time_s])), Vehicle(), PaperEquations())
        a, b = (matrix[0] for matrix in zero_order_hold(*model, PERIOD_S))
        for name, sign in (("corrected", -1), ("as printed", 1)):
            loop = _linear_loop(a, b, law, sign)
            modes = np.sort(np.abs(np.linalg.eigvals(loop)))[::-1][:4]
            yield f"{section}, sign {name}: largest moduli {np.round(modes, 4).tolist()}"
            yield f"  all seven states: {_invariant(loop)}"
            kept = [row for row in range(11) if row not in (Error.X_I, 7 + 2)]
            yield f"  without x_i:      {_invariant(loop[np.ix_(kept, kept)])}"


def _linear_loop(a: FloatArray, b: FloatArray, law: RobustGains, sign: int) -> FloatArray:
    """Return the closed loop of (z_m, positions one step before), tanh linearised, (11, 11).

    The modelling error is the deviation of z_e, so that u_m moves it by -B u_m.
    """
    now, before = np.zeros((3, 7)), np.zeros((3, 7))
    parts = (law.saturation, law.proportional, law.derivative)
    for row, (state, k_s, k_p, k_d) in enumerate(zip(_ACTS_ON, *parts, strict=True)):
        now[row, state] = k_s * (k_p + k_d / PERIOD_S)
        before[row, state] = -k_s * k_d / PERIOD_S
    positions, loop = list(POSITIONS), np.zeros((11, 11))
    loop[:7, :7] = a + sign * b @ now
    loop[:7, 7:] = sign * b @ before[:, positions]
    loop[7:, positions] = np.eye(4)
    return loop


def _invariant(loop: FloatArray) -> str:
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


STUDIES: Final = (
    Study(
        name="invariance",
        make=lambda runner: fenced(invariance()),
        checks=(("grass", "ttempc-tube"),),
    ),
    Study(
        name="paper-tube",
        make=lambda runner: fenced(paper_tube()),
        checks=(("pavement", "paper"),),
    ),
)
