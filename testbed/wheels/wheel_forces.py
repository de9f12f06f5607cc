"""Forces of the ground on the wheels of a machine: their state, their report, their kernel.

The plant steps its six wheels inside its own compiled loop; `soil_wheels` steps those of any MuJoCo
model. Both call `tyre_kernel.wheel_step` on a `WheelForces`.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..bodies import Bodies
from ..ground.ground import Ground
from ..ground.surface import Surface
from ..truth import Wheels
from .ruts import PRESS, Ruts
from .soil_law import SoilLaw
from .tyre import Tyres
from .tyre_kernel import TREAD, WHEEL, WheelSet, wheel_step

_TREAD_SIZE: Final = len(TREAD.names or ())
_PRESS_SIZE: Final = len(PRESS.names or ())


class WheelForces:
    """The n wheels of one machine on the ground.

    The state holds the tread deflections [m]: a restored run without them is 29 mm away after
    10 s. With ruts it also holds the heights.

    Args:
        tyres: of the wheels.
        ground: under them.
        law: coefficients of traction, motion resistance and side force.
        bodies: motion of the wheels, and the wrenches that a step writes; a wheel is a body with
            its centre at the origin and its axle along y.
        numbers: (n,) body of each wheel.
        timestep_s: of the physics.
    """

    state: FloatArray  # all that the future depends on besides the motion; changed in place
    output: FloatArray  # (n, 7) last report, rows `WHEEL`
    report: Wheels  # view of `output`

    def __init__(
        self,
        tyres: Tyres,
        ground: Ground,
        law: SoilLaw,
        bodies: Bodies,
        numbers: NDArray[np.int64],
        timestep_s: float,
    ) -> None:
        count = len(numbers)
        heights = ground.terrain.heights
        self.output = np.zeros((count, len(WHEEL.names or ())))
        self.report = Wheels(*self.output.T)

        # The state: treads, and with ruts the rows `PRESS` of the wheels, then heights.
        treads = _TREAD_SIZE * count
        presses = _PRESS_SIZE * count if ground.ruts else 0
        pressed = heights.size if ground.ruts else 0
        self.state = np.zeros(treads + presses + pressed)
        self._firm = heights if ground.ruts else np.empty((0, 0))
        self._heights = self.state[treads + presses :].reshape(self._firm.shape)
        surface = self._heights.view() if ground.ruts else heights
        for each in (surface, self._firm):
            each.setflags(write=False)  # views: one compiled version of the kernel
        self.reset()

        self.treads: Final = self.state[:treads].reshape(count, _TREAD_SIZE)
        self.tyre_table: Final = tyres.table(law)
        self.kernel: Final = WheelSet(
            law=law.of(tyres.radial).table(count),
            tyres=self.tyre_table,
            surface=Surface.of(ground, surface),
            ruts=Ruts(
                firm=self._firm,
                heights=self._heights,
                presses=self.state[treads : treads + presses].reshape(-1, _PRESS_SIZE),
            ),
            bodies=bodies,
            numbers=numbers,
            treads=self.treads,
            output=self.output,
            timestep=timestep_s,
        )

    def reset(self) -> None:
        """Return to the state before any motion."""
        self.state[:] = 0.0
        self.output[:] = 0.0
        self._heights[:] = self._firm

    def step(self) -> None:
        """Advance the treads by a time step and write the wrenches of the ground."""
        wheel_step(self.kernel)
