"""All experiments of the inspection, in the order of the card."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from testbed.errors import TestbedError
from testbed.inspection.actuators import steering_steps
from testbed.inspection.bench import Bench
from testbed.inspection.check import Check, between
from testbed.inspection.conservation import free_fall, frictionless
from testbed.inspection.drive import coast_down, hydrostat_step
from testbed.inspection.ground import roughness
from testbed.inspection.kinematics import hitch_kinematics
from testbed.inspection.lateral import contour, side_force
from testbed.inspection.numerics import convergence, same_bits, wheel_models
from testbed.inspection.statics import creep, load_transfer, static_loads
from testbed.inspection.traction import efficiency, slip_against_pull
from testbed.inspection.turning import circles, softening
from testbed.inspection.vertical import bump

Experiment = Callable[[Bench], list[Check]]

EXPERIMENTS: Final[dict[str, Experiment]] = {
    "static loads": static_loads,
    "load transfer": load_transfer,
    "creep": creep,
    "hydrostat": hydrostat_step,
    "coast-down": coast_down,
    "steering": steering_steps,
    "turning": circles,
    "turning on soft soil": softening,
    "slip": slip_against_pull,
    "tractive efficiency": efficiency,
    "side force": side_force,
    "contour": contour,
    "kinematics": hitch_kinematics,
    "bump": bump,
    "roughness": roughness,
    "free fall": free_fall,
    "frictionless": frictionless,
    "time steps": convergence,
    "same bits": same_bits,
    "wheel models": wheel_models,
}


def inspect(bench: Bench, names: Sequence[str] = tuple(EXPERIMENTS)) -> Iterator[Check]:
    """Yield the checks of the named experiments as they are made.

    A plant that diverges, or cannot be built, fails the experiment and not the inspection.
    """
    for name in names:
        try:
            yield from EXPERIMENTS[name](bench)
        except TestbedError as error:
            yield between(
                name, math.nan, 0.0, 0.0, "", "the experiment runs to its end", note=str(error)
            )
