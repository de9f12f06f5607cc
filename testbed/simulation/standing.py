"""Check that a vehicle stands on its wheels alone before a run starts."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..errors import InvalidPlant
from ..truth import WHEELS
from ..wheels.tyre import Tyres
from ..wheels.tyre_kernel import Output

_BALANCE: Final = 0.02  # largest difference of the ground's force to the weight, over the weight


def check_standing(
    model: mujoco.MjModel, data: mujoco.MjData, tyres: Tyres, output: FloatArray
) -> None:
    """Refuse a settled vehicle that touches the ground with more than its tyres, or still falls.

    The force of the ground along the vehicle's upward axis must be the weight's part along it. The
    wheel loads are normal to the ground below each wheel, which may be the flank of a furrow: their
    sum alone is up to 2 % larger.

    Args:
        model: of the plant.
        data: of the plant, after a physics step.
        tyres: in the order of `WHEELS`.
        output: (6, 7) report of the wheels, columns of `Output`.

    Raises:
        InvalidPlant: a body touches the ground, a tyre is pressed flat on its rim, where its law
            ends, or the ground does not carry the weight to within 2 %.
    """
    place = "reset: at ({:.1f}, {:.1f}) m".format(*data.qpos[:2])
    for pair in data.contact.geom:
        bodies = {model.body(model.geom_bodyid[geom]).name for geom in pair} - {"world"}
        if not bodies <= set(WHEELS):
            raise InvalidPlant(f"{place} the {', '.join(sorted(bodies))} touches the ground")
    height = data.xpos[[model.body(wheel).id for wheel in WHEELS], 2] - output[:, Output.GROUND]
    spare = height - (tyres.radius - tyres.section_height)  # of the rim above the ground
    worst = int(np.argmin(spare))
    if spare[worst] <= 0.0:
        load, rated = output[worst, Output.LOAD], tyres.rated_load[worst]
        raise InvalidPlant(
            f"{place} the {WHEELS[worst]} tyre is pressed flat on its rim: "
            f"it carries {load:.0f} N, {load / rated:.1f} times its rated load"
        )
    # forces of soil wheels are applied forces, those of contact wheels are constraints
    force = data.xfrc_applied[:, :3].sum(axis=0) + data.qfrc_constraint[:3]
    up = data.body("tractor").xmat.reshape(3, 3)[:, 2]
    share = -(force @ up) / (model.body_mass.sum() * (model.opt.gravity @ up))
    if not abs(share - 1.0) <= _BALANCE:
        raise InvalidPlant(
            f"{place} the vehicle does not come to rest on its wheels: the ground carries "
            f"{share:.0%} of its weight"
        )
