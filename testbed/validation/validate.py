"""Validation of a plant: the table of all checks, in the order of the report."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, NamedTuple

from ..errors import TestbedError
from . import manoeuvres as drive
from .bench import Bench
from .check import Check, between, number, range_text
from .manoeuvres import Measured

Band = Callable[[Any], tuple[float, float, str]]
"""Smallest and largest figure that pass, with the text of both, from the value of the law."""


class Row(NamedTuple):
    """A check: its name, with words of the manoeuvre in braces, and what must hold."""

    name: str
    band: Band
    unit: str
    source: str


def _near(share: float = 0.0, least: float = 0.0) -> Band:
    """Return the band about the law: a share of it, at least `least`."""

    def band(law: float) -> tuple[float, float, str]:
        tolerance = max(least, share * abs(law))
        return law - tolerance, law + tolerance, f"{number(law)} ± {tolerance:.2g}"

    return band


def _within(low: float, high: float) -> Band:
    return lambda law: (low, high, range_text(low, high))


def _most(high: float) -> Band:
    return _within(0.0, high)


_LEVER: Final = "rule of the lever on masses and lengths of the vehicle's file"
_STEP: Final = "vehicle's K and tau; for the paper's vehicle: Kayacan et al. 2016, sec. II"
_RATES: Final = "vehicle; rates of the paper's: Kayacan et al. 2016, constraints"
_ROLLING: Final = "rolling without side slip behind two hinges, docs/architecture.md"
_SOFTENING: Final = "planar balance of the lateral law: slip angles grow as soil softens"

# fmt: off
EXPERIMENTS: Final[dict[str, tuple[Callable[[Bench], Iterator[Measured]], tuple[Row, ...]]]] = {
    "static loads": (drive.static_loads, (
        Row("weight on the wheels", _near(0.005), "N", _LEVER),
        *3 * (Row("static load, {axle} axle", _near(0.01), "N", _LEVER),))),
    "load transfer": (drive.load_transfer, (
        Row("load transfer across a slope of 10 deg", _near(0.02), "mm",
            "moments about the ground: h tan(slope)"),)),
    "creep": (drive.creep, (
        Row("creep across a slope of 15 deg in 30 s", _most(5.0), "mm",
            "a wheel at rest does not move; 5 mm assumed, 1/6 of the paper's GNSS noise"),)),
    "hydrostat": (drive.hydrostat_step, (
        Row("hydrostat gain K", _near(0.05), "m/s", _STEP),
        Row("hydrostat time constant tau", _near(0.05), "s", _STEP))),
    "coast-down": (drive.coast_down, (
        Row("coast-down at {kpa:.0f} kPa", _near(0.01), "m/s²",
            "Brixius 1987: motion resistance without slip"),)),
    "steering": (drive.steering_steps, 2 * (
        Row("{axis}, rate", _near(0.05), "deg/s", _RATES),
        Row("{axis}, stop", _near(least=0.6), "deg", "vehicle"),
        Row("{axis}, lag", _near(0.25), "s", "vehicle"))),
    "turning": (drive.circles, (
        Row("turning, R = 6 to 20 m, least yaw rate over Ackermann", _within(0.92, 1.0), "",
            "Ackermann; 0.08 below it for slip angles on firm ground (assumed)"),
        Row("turning, R = 6 to 20 m, most yaw rate over Ackermann", _within(0.92, 1.0), "",
            "Ackermann: slip angles at walking pace do not reduce the radius"),
        Row("turning, R = 6 to 20 m, off the balance of forces", _most(0.015), "",
            "planar balance of the same tyre law (steady_motion.py)"),
        Row("off-tracking, R = 6 to 20 m, off the closed form", _most(20.0), "mm",
            "R - sqrt(R² + a² - (d + L_i)²); 20 mm for slip of the trailer's axle"))),
    "turning on soft soil": (drive.softening, (
        Row("loss of yaw rate from {firm:.0f} to {soft:.0f} kPa at R = 10 m", _near(least=0.01),
            "", _SOFTENING),
        Row("least loss of yaw rate from one soil to the next softer one",
            _within(0.001, math.inf), "", _SOFTENING))),
    "slip": (drive.slip_against_pull, 2 * (
        Row("slip under drawbar pull at {kpa:.0f} kPa, off the law", _most(0.005), "",
            "Brixius 1987, traction equation"),)),
    "tractive efficiency": (drive.efficiency, (
        Row("tractive efficiency at {kpa:.0f} kPa, off the law", _most(0.015), "",
            "Brixius 1987: (1 - MRR/GTR) (1 - s)"),
        Row("tractive efficiency lost at the published best slip, {surface}", _most(3.0), "points",
            "Univ. of Arizona Coop. Ext., surface by Bn (ASABE D497, unconfirmed); 3 points "
            "assumed, since by the law radial and bias-ply tyres differ by 2"))),
    "side force": (drive.side_force, (
        Row("side force over load at {kpa:.0f} kPa, off the law", _most(0.01), "",
            "lateral law, mu (1 - exp(-C/mu |alpha|)) by similarity with slip"),)),
    "contour": (drive.contour, (
        Row("drift along a contour of {slope:.2f} rad in {way_m:.1f} m", _near(0.15, least=2.0),
            "cm", "planar balance of forces with the same lateral law"),)),
    "kinematics": (drive.hitch_kinematics, (
        Row("trailer yaw rate, rms residual", _most(0.01), "rad/s", _ROLLING),
        Row("axle points against the chain of lengths", _most(5.0), "mm",
            "e(psi) summed over a, d and L_i"),
        *3 * (Row("residual with the sign of {term} flipped, over that without",
                  _within(3.0, math.inf), "", _ROLLING),))),
    "bump": (drive.bump, (
        Row("least wheel load over a bump", _within(0.0, math.inf), "N",
            "the ground does not pull"),
        Row("energy left a second after the bump", _most(2.0), "% of its peak",
            "the tyres damp a bump within a second (assumed)"))),
    "free fall": (drive.free_fall, (
        Row("momentum drift in free fall of 0.5 s", _most(1e-3), "of m g t",
            "Newton: m v = m g t, whatever the joints do"),
        Row("angular momentum drift in free fall of 0.5 s", _most(0.01), "of itself",
            "Euler: no moment about the centre of mass; 1 % of integration error (assumed)"),
        Row("drift of the energy about the centre of mass in free fall of 0.5 s", _most(0.01),
            "of itself", "conservation; 1 % of integration error (assumed)"))),
    "frictionless": (drive.frictionless, (
        Row("momentum drift on frictionless level ground in 1 s", _most(1e-3), "of itself",
            "Newton: no horizontal force"),
        Row("kinetic energy drift on frictionless level ground in 1 s", _most(0.005), "of itself",
            "conservation; 0.5 % of integration error (assumed)"))),
    "time steps": (drive.convergence, (
        Row("end point after 10 s, time steps of 0.5 to 4 ms", _most(20.0), "mm",
            "convergence; 20 mm assumed, below the GNSS noise of the paper (30 mm)"),)),
}
# fmt: on
"""Manoeuvre and rows of each experiment; a manoeuvre may have nothing to say of the last rows."""


def validate(bench: Bench, names: Sequence[str] = tuple(EXPERIMENTS)) -> Iterator[Check]:
    """Run the named experiments and yield their checks one by one.

    An error of the testbed, such as a diverged plant, becomes a failed check of that experiment.
    """
    for name in names:
        manoeuvre, rows = EXPERIMENTS[name]
        try:
            for row, measured in zip(rows, manoeuvre(bench), strict=False):
                yield _check(row, measured)
        except TestbedError as error:
            source = "the experiment runs to its end"
            yield between(name, math.nan, 0.0, 0.0, "", source, note=str(error))


def _check(row: Row, measured: Measured) -> Check:
    name = row.name.format(**measured.words)
    if measured.figure is None:
        return Check(name, None, "", "", -math.inf, math.inf, "", measured.note)
    low, high, text = row.band(measured.law)
    figure = float(measured.figure)
    note = measured.note
    chart = measured.chart
    return Check(name, figure, row.unit, text, low, high, row.source, note, chart)
