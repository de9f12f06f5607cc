"""Contact wheels: MuJoCo's own contact of ellipsoid wheels, to compare with the soil wheels.

The contact has Coulomb friction. Its coefficient is the largest traction ratio of the soil under
the wheel (Brixius, see `soil_law`); the motion resistance without slip acts as dry friction at the
wheel's bearing. Both follow the cone index under the wheel and the load of the last report, and
are set once per `prepare`. Slip and slip angle are not reported (NaN).
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from typing import ClassVar, Final

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..ground.ground import Ground
from ..truth import WHEELS
from .soil_law import SoilLaw
from .tyre import Tyres, mobility
from .tyre_kernel import Output


class ContactWheels:
    """Sets the friction of the contacts and reads their forces; a `WheelModel`.

    It has no state of its own.
    """

    follows_soil_law: ClassVar[bool] = False

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        tyres: Tyres,
        ground: Ground,
        law: SoilLaw,
    ) -> None:
        self.state: Final = np.zeros(0)
        self.output: Final = np.zeros((len(WHEELS), len(Output)))
        self._model, self._data, self._tyres, self._ground = model, data, tyres, ground
        self._law = law
        self._bodies = np.array([model.body(wheel).id for wheel in WHEELS])
        self._geoms = np.array([model.geom(f"{wheel}_contact").id for wheel in WHEELS])
        self._dofs = np.array([model.joint(wheel).dofadr[0] for wheel in WHEELS])

    @staticmethod
    def adapt(spec: mujoco.MjSpec) -> None:
        """Let the ellipsoid of every wheel collide with the ground."""
        for wheel in WHEELS:
            geom = spec.geom(f"{wheel}_contact")
            geom.contype, geom.conaffinity = 2, 1

    def prepare(self) -> None:
        """Set friction and motion resistance for the soil under each wheel and its last load.

        MuJoCo's contacts are computed again: the present ones have the previous friction.
        """
        load = self.output[:, Output.LOAD]
        bn, _ = mobility(self._law, self._tyres, load, self._cone_index())
        self._model.geom_friction[self._geoms, 0] = self._law.largest_traction_ratio(bn)
        resistance = load * self._law.motion_resistance_ratio(bn, np.zeros_like(bn))  # (6,) [N]
        self._model.dof_frictionloss[self._dofs] = resistance * self._tyres.radius
        mujoco.mj_step1(self._model, self._data)

    def step(self) -> None:
        """Do nothing: MuJoCo computes the forces of its contacts."""

    def report(self) -> None:
        """Write loads and forces of the present contacts into `output`, (6, 7)."""
        data, output = self._data, self.output
        output[:] = 0.0
        output[:, [Output.SLIP, Output.SLIP_ANGLE]] = np.nan
        wrench = np.zeros(6)
        for index, pair in enumerate(data.contact.geom):
            wheel = np.flatnonzero((self._geoms == pair[0]) | (self._geoms == pair[1]))
            if not wheel.size:
                continue
            mujoco.mj_contactForce(self._model, data, index, wrench)
            frame = data.contact.frame[index].reshape(3, 3)
            # the contact's normal points from the first geom to the second
            sign = 1.0 if pair[1] == self._geoms[wheel[0]] else -1.0
            force = sign * (frame.T @ wrench[:3])
            normal = sign * frame[0]
            axle = data.xmat[self._bodies[wheel[0]]].reshape(3, 3)[:, 1]
            ahead = np.cross(axle, normal)
            ahead /= np.linalg.norm(ahead)
            output[wheel, Output.LOAD] += wrench[0]
            output[wheel, Output.FORCE_LONG] += force @ ahead
            output[wheel, Output.FORCE_LAT] += force @ np.cross(normal, ahead)
        place = data.xpos[self._bodies]
        output[:, Output.CONE_INDEX] = self._cone_index()
        output[:, Output.GROUND] = self._ground.terrain.height(place[:, 0], place[:, 1])

    def _cone_index(self) -> FloatArray:
        """Return the cone index under each wheel [kPa], (6,)."""
        return self._ground.cone_index_at(*self._data.xpos[self._bodies, :2].T)
