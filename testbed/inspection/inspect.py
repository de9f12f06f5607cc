"""Plant validation: all experiments, in the order of the report."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from ..errors import TestbedError
from .actuators import steering_steps
from .bench import Bench
from .check import Check, between
from .conservation import free_fall, frictionless
from .drive import coast_down, hydrostat_step
from .ground import roughness
from .kinematics import hitch_kinematics
from .lateral import contour, mobility_numbers, side_force
from .numerics import convergence, same_bits, wheel_models
from .statics import creep, load_transfer, static_loads
from .traction import efficiency, slip_against_pull
from .turning import circles, softening
from .vertical import bump

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
    "mobility numbers": mobility_numbers,
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
    """Run the named experiments and yield their checks one by one.

    An error of the testbed, such as a diverged plant, becomes a failed check of that experiment.
    """
    for name in names:
        try:
            yield from EXPERIMENTS[name](bench)
        except TestbedError as error:
            yield between(
                name,
                figure=math.nan,
                low=0.0,
                high=0.0,
                unit="",
                source="the experiment runs to its end",
                note=str(error),
            )
