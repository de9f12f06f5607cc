"""The second wheel model: MuJoCo's own contact of ellipsoid wheels, for cross-checks.

Coulomb friction instead of soil: the friction of each wheel is the largest gross traction ratio of
its soil (Brixius, see `tyre`), its motion resistance without slip
acts as dry friction at the wheel's bearing. Both follow the cone index under the wheel and the load
that it carried, once per `prepare`. Slip and slip angle are not reported (NaN).
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import Terrain
from ..truth import WHEELS
from .tyre import Tyres, largest_traction, mobility, motion_resistance_ratio
from .tyre_kernel import Output


class NativeWheels:
    """Sets the friction of the contact wheels and reads their forces."""

    def __init__(
        self, model: mujoco.MjModel, tyres: Tyres, terrain: Terrain, cone_indices: FloatArray
    ) -> None:
        self._model, self._tyres, self._terrain = model, tyres, terrain
        self._cone_indices = cone_indices
        self._bodies = np.array([model.body(wheel).id for wheel in WHEELS])
        self._geoms = np.array([model.geom(f"{wheel}_contact").id for wheel in WHEELS])
        self._dofs = np.array([model.joint(wheel).dofadr[0] for wheel in WHEELS])

    def prepare(self, data: mujoco.MjData, load: FloatArray) -> None:
        """Set friction and rolling resistance for the soil under each wheel, `load` (6,) [N] on it.

        Contacts are made anew, for those of `data` still have the friction from before.
        """
        bn, _ = mobility(self._tyres, load, self._cone_index(data))
        self._model.geom_friction[self._geoms, 0] = largest_traction(bn)
        resistance = load * motion_resistance_ratio(bn, np.zeros_like(bn))  # (6,) [N]
        self._model.dof_frictionloss[self._dofs] = resistance * self._tyres.radius
        mujoco.mj_step1(self._model, data)

    def report(self, data: mujoco.MjData, output: FloatArray) -> None:
        """Write loads and forces of the present contacts into `output`, (6, 7)."""
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
        output[:, Output.CONE_INDEX] = self._cone_index(data)
        output[:, Output.GROUND] = self._terrain.height(place[:, 0], place[:, 1])

    def _cone_index(self, data: mujoco.MjData) -> FloatArray:
        ny, nx = self._cone_indices.shape
        cells = (data.xpos[self._bodies, :2] - self._terrain.origin) / self._terrain.spacing_m
        column = np.clip(np.rint(cells[:, 0]).astype(int), 0, nx - 1)
        row = np.clip(np.rint(cells[:, 1]).astype(int), 0, ny - 1)
        return self._cone_indices[row, column]
