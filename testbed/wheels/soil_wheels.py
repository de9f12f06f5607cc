"""Soil wheels: the law of `tyre` under MuJoCo's bodies, compiled."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import ClassVar, Final

import mujoco
import numpy as np

from ..ground.ground import Ground
from ..truth import WHEELS
from .tyre import LAW, Tyres
from .tyre_kernel import Output, wheel_step


class SoilWheels:
    """Writes the forces of `tyre` on every wheel into `xfrc_applied`; a `WheelModel`.

    The state holds the tread deflections (6, 3) [m]. A restored run without them is 29 mm away
    after 10 s.
    """

    follows_soil_law: ClassVar[bool] = True

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, tyres: Tyres, ground: Ground
    ) -> None:
        self.state: Final = np.zeros((len(WHEELS), 3))
        self.output: Final = np.zeros((len(WHEELS), len(Output)))
        self.tyre_table: Final = tyres.table()
        terrain = ground.terrain
        # views of MuJoCo's arrays, bound once: they outlive a reset of the data
        self.step: Final[Callable[[], object]] = partial(
            wheel_step,
            LAW.table(),
            self.tyre_table,
            terrain.heights,
            ground.cone_index,
            np.array([*terrain.origin, terrain.spacing_m, model.opt.timestep]),
            np.array([model.body(wheel).id for wheel in WHEELS]),
            data.xpos,
            data.xmat,
            data.cvel,
            data.subtree_com,
            self.state,
            self.output,
            data.xfrc_applied,
        )

    @staticmethod
    def adapt(spec: mujoco.MjSpec) -> None:
        """Leave the MJCF as it is: its wheels touch nothing."""

    def prepare(self) -> None:
        """Do nothing: every step reads load and soil itself."""

    def report(self) -> None:
        """Do nothing: every step writes `output`."""
