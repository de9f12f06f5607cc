"""Soil wheels: the law of `tyre` under MuJoCo's bodies, compiled."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, Final

import mujoco
import numpy as np

from ..ground.ground import Ground
from ..truth import WHEELS
from .soil_law import SoilLaw
from .tyre import Tyres
from .tyre_kernel import Output, wheel_step


class SoilWheels:
    """Writes the forces of `tyre` on every wheel into `xfrc_applied`; a `WheelModel`.

    The state holds the tread deflections [m]: a restored run without them is 29 mm away after
    10 s. With a second pass it also holds the tracks of the run, see `wheel_step`.
    `arguments` are those of `wheel_step`.
    """

    follows_soil_law: ClassVar[bool] = True

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        tyres: Tyres,
        ground: Ground,
        law: SoilLaw,
    ) -> None:
        tracks = 1 + ground.cone_index.size if law.second_pass else 0
        self.state: Final = np.zeros(3 * len(WHEELS) + tracks)
        self.output: Final = np.zeros((len(WHEELS), len(Output)))
        self.tyre_table: Final = tyres.table(law)
        terrain = ground.terrain
        # views of MuJoCo's arrays, bound once: they outlive a reset of the data
        self.arguments: Final[tuple[Any, ...]] = (
            law.table(),
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
        self.step: Final[Callable[[], object]] = partial(wheel_step, *self.arguments)

    @staticmethod
    def adapt(spec: mujoco.MjSpec) -> None:
        """Leave the MJCF as it is: its wheels touch nothing."""

    def prepare(self) -> None:
        """Do nothing: every step reads load and soil itself."""

    def report(self) -> None:
        """Do nothing: every step writes `output`."""
