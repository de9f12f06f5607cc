"""Wheel models: the forces of the ground on the wheels, by name."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from typing import ClassVar, Final, Literal

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..bodies import Bodies
from ..errors import InvalidPlant
from ..ground.ground import Ground
from ..ground.surface import Surface
from ..truth import WHEELS, Wheels
from ..vehicle.steering_coupling import Coupling, couple_joints
from .ruts import PRESS, Ruts
from .soil_law import SoilLaw
from .tyre import Tyres, mobility
from .tyre_kernel import TREAD, WHEEL, WheelSet, wheel_step

_TREAD_SIZE: Final = len(TREAD.names or ())
_PRESS_SIZE: Final = len(PRESS.names or ())


class WheelModel:
    """The wheels of one plant.

    The plant calls `adapt` before it compiles the MJCF. For every series of physics steps it calls
    `prepare` once, `step` before the accelerations of each step, and `write_report` after the
    accelerations of the last one.
    """

    follows_soil_law: ClassVar[bool] = False  # its forces are those of `soil_law`
    couples_steering: ClassVar[bool] = False  # by a force, in place of the model's constraints

    state: FloatArray  # all that the future depends on besides MuJoCo's state; changed in place
    output: FloatArray  # (6, 7) last report: wheels in the order of `WHEELS`, rows `WHEEL`
    report: Wheels  # view of `output`

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, tyres: Tyres, ground: Ground, law: SoilLaw
    ) -> None:
        self.state = np.zeros(0)
        self.output = np.zeros((len(WHEELS), len(WHEEL.names or ())))
        self.report = Wheels(*self.output.T)

    @staticmethod
    def adapt(spec: mujoco.MjSpec) -> None:
        """Change the MJCF, in place, to what the model needs."""

    def reset(self) -> None:
        """Return to the state before any motion."""
        self.state[:] = 0.0
        self.output[:] = 0.0

    def prepare(self) -> None:
        """Prepare a series of steps from the loads of the last report."""

    def couple(self) -> None:
        """Add the torques of the steering linkage for one physics step."""

    def step(self) -> None:
        """Apply the forces of the ground for one physics step, and couple the steering."""

    def write_report(self) -> None:
        """Write loads, slips and forces of the present step into `output`."""


class SoilWheels(WheelModel):
    """Writes the forces of `wheel_step` on every wheel into `xfrc_applied`.

    Those of `couple_joints`, which steer the front wheels, are added to `qfrc_passive`.

    The state holds the tread deflections [m]: a restored run without them is 29 mm away after
    10 s. With ruts it also holds the heights.
    """

    follows_soil_law: ClassVar[bool] = True
    couples_steering: ClassVar[bool] = True

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, tyres: Tyres, ground: Ground, law: SoilLaw
    ) -> None:
        super().__init__(model, data, tyres, ground, law)
        count = len(WHEELS)
        heights = ground.terrain.heights

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
            bodies=Bodies.of(data),
            numbers=np.array([model.body(wheel).id for wheel in WHEELS]),
            treads=self.state[:treads].reshape(count, _TREAD_SIZE),
            output=self.output,
            timestep=float(model.opt.timestep),
        )
        self.coupling: Final = Coupling.of(model, data)

    def reset(self) -> None:
        """Return to the state before any motion."""
        super().reset()
        self._heights[:] = self._firm

    def couple(self) -> None:
        """Add the torques of the steering linkage for one physics step."""
        couple_joints(self.coupling)

    def step(self) -> None:
        """Apply the forces of the ground for one physics step, and couple the steering."""
        wheel_step(self.kernel)
        self.couple()


class ContactWheels(WheelModel):
    """MuJoCo's own contact of ellipsoid wheels, to compare with the soil wheels; without a state.

    The contact has Coulomb friction. Its coefficient is the largest traction ratio of the soil
    under the wheel (Brixius, see `soil_law`); the motion resistance without slip acts as dry
    friction at the wheel's bearing. Both follow the cone index under the wheel and the load of the
    last report, and are set once per `prepare`. Slip and slip angle are not reported (NaN).
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, tyres: Tyres, ground: Ground, law: SoilLaw
    ) -> None:
        super().__init__(model, data, tyres, ground, law)
        self._model = model
        self._data = data
        self._tyres = tyres
        self._ground = ground
        self._law = law.of(tyres.radial)
        self._bodies = np.array([model.body(wheel).id for wheel in WHEELS])
        self._geoms = np.array([model.geom(f"{wheel}_contact").id for wheel in WHEELS])
        self._dofs = np.array([model.joint(wheel).dofadr[0] for wheel in WHEELS])

    @staticmethod
    def adapt(spec: mujoco.MjSpec) -> None:
        """Let the ellipsoid of every wheel collide with the ground."""
        for wheel in WHEELS:
            geom = spec.geom(f"{wheel}_contact")
            geom.contype = 2
            geom.conaffinity = 1

    def prepare(self) -> None:
        """Set friction and motion resistance for the soil under each wheel and its last load.

        MuJoCo's contacts are computed again: the present ones have the previous friction.
        """
        load = self.report.load
        bn, _ = mobility(self._law, self._tyres, load, self._cone_index())
        self._model.geom_friction[self._geoms, 0] = self._law.largest_traction_ratio(bn)
        resistance = load * self._law.motion_resistance_ratio(bn, np.zeros_like(bn))  # (6,) [N]
        self._model.dof_frictionloss[self._dofs] = resistance * self._tyres.radius
        mujoco.mj_step1(self._model, self._data)

    def write_report(self) -> None:
        """Write loads and forces of the present contacts into `output`, (6, 7)."""
        data = self._data
        report = self.report
        self.output[:] = 0.0
        report.slip[:] = np.nan
        report.slip_angle[:] = np.nan
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
            report.load[wheel] += wrench[0]
            report.force_long[wheel] += force @ ahead
            report.force_lat[wheel] += force @ np.cross(normal, ahead)
        place = data.xpos[self._bodies]
        report.cone_index[:] = self._cone_index()
        report.ground[:] = self._ground.terrain.height(place[:, 0], place[:, 1])

    def _cone_index(self) -> FloatArray:
        """Return the cone index under each wheel [kPa], (6,)."""
        return self._ground.cone_index_at(*self._data.xpos[self._bodies, :2].T)


WheelModelName = Literal["soil", "contact"]
WHEEL_MODELS: Final[dict[str, type[WheelModel]]] = {"soil": SoilWheels, "contact": ContactWheels}
DEFAULT_WHEEL_MODEL: Final = "soil"


def wheel_model(name: str) -> type[WheelModel]:
    """Return the wheel model of a name.

    Raises:
        InvalidPlant: there is no wheel model of that name.
    """
    if name not in WHEEL_MODELS:
        allowed = " or ".join(map(repr, WHEEL_MODELS))
        raise InvalidPlant(f"plant.wheels: got {name!r}, must be {allowed}")
    return WHEEL_MODELS[name]
