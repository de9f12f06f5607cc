"""Mounted implement: the forces of `tool_kernel` on the trailer of a plant, compiled."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np
import scipy

from ..bodies import Bodies
from ..errors import InvalidPlant
from ..ground.surface import Surface
from ..ground.terrain import flat
from ..truth import WHEELS
from ..vehicle.servos import equilibrium_slip, tyres_of, wheel_loads
from ..vehicle.vehicle import PlantVehicle
from ..wheels.soil_law import SoilLaw
from ..wheels.tyre import WheelMotion, contact
from .implement import POINTS, Implement
from .tool_kernel import LIFT, POINT, ToolLaw, Tools, tool_step

_MOST_SLIP: Final = 0.3  # of the driven wheels, above which a tractor is not used; assumed
_LIFT_SIZE: Final = len(LIFT.names or ())
_POINT_SIZE: Final = len(POINT.names or ())


class MountedImplement:
    """Writes the forces of the soil on the trailer into its row of `xfrc_applied`.

    `state` is everything that the future depends on besides MuJoCo's state, and the last report:
    `lift`, a row `LIFT`, then `output`, a row `POINT` of each point.

    Args:
        implement: settings.
        model: of the plant.
        data: of the plant; only the row of the trailer in `xfrc_applied` is written.
        vehicle: that carries the implement.
        surface: of the ground, from `tool_surface`.
    """

    def __init__(
        self,
        implement: Implement,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        vehicle: PlantVehicle,
        surface: Surface,
    ) -> None:
        self.settings: Final = implement
        self.law: Final = ToolLaw.of(implement, frame_height(vehicle, implement.behind_m))
        self.state: Final = np.zeros(_LIFT_SIZE + _POINT_SIZE * POINTS)
        self.lift: Final = self.state[:_LIFT_SIZE]
        self.output: Final = self.state[_LIFT_SIZE:].reshape(POINTS, _POINT_SIZE)
        self.kernel: Final = Tools(
            law=self.law.row(),
            offsets=implement.offsets,
            work=np.array(implement.work_m).reshape(-1, 2),
            surface=surface,
            bodies=Bodies.of(data),
            trailer=int(model.body("trailer").id),
            lift=self.lift,
            output=self.output,
            timestep=float(model.opt.timestep),
        )

    def step(self) -> None:
        """Apply the forces of the soil for one physics step."""
        tool_step(self.kernel)


def frame_height(vehicle: PlantVehicle, behind: float) -> float:
    """Return the height of the trailer's frame, `behind` its axle, at rest on level ground [m].

    Heights of the axles from the static loads on the tyres; drawbar and trailer are one beam from
    the pin to the trailer axle.
    """
    tyres = tyres_of(vehicle)
    level = flat((4.0, 4.0))
    count = len(WHEELS)
    zeros = np.zeros((count, 3))
    left = np.tile([0.0, 1.0, 0.0], (count, 1))
    loads = wheel_loads(vehicle)

    def surplus(deflection: float, wheel: int) -> float:
        centre = np.zeros((count, 3))
        centre[:, 2] = tyres.radius - deflection
        load = contact(tyres, level, WheelMotion(centre, left, zeros, zeros)).load
        return float((load - loads)[wheel])

    def deflection(wheel: str) -> float:
        index = WHEELS.index(wheel)
        root = scipy.optimize.brentq(surplus, 0.0, 0.5 * float(tyres.radius[index]), args=(index,))
        return float(root)  # pyright: ignore[reportArgumentType]

    front, rear, trailer = map(deflection, ("front_left", "rear_left", "trailer_left"))
    pin = rear + (rear - front) * vehicle.hitch.offset_m / vehicle.tractor.wheelbase_m
    nose_down = (pin - trailer) / (vehicle.drawbar.length_m + vehicle.trailer.length_m)
    return vehicle.trailer_wheel.radius_m - trailer + nose_down * behind


def draw_implement(spec: mujoco.MjSpec, implement: Implement, height: float) -> None:
    """Add a beam with a shank for each point to the trailer, for pictures; drawn lowered.

    Args:
        spec: model of the vehicle, changed in place.
        implement: settings.
        height: of the trailer's frame above the ground [m].
    """

    def capsule(start: Sequence[float], end: Sequence[float], radius: float) -> None:
        geom = spec.body("trailer").add_geom(spec.find_default("shape"), material="steel")
        geom.type = mujoco.mjtGeom.mjGEOM_CAPSULE
        geom.fromto = [*start, *end]
        geom.size = [radius, 0.0, 0.0]

    x = -implement.behind_m
    half = 0.5 * implement.width_m
    capsule((x, -half, 0.0), (x, half, 0.0), 0.04)
    capsule((x, 0.0, 0.0), (0.0, 0.0, 0.0), 0.04)
    for y in implement.offsets.tolist():
        capsule((x, y, 0.0), (x, y, -height - implement.depth_m), 0.02)


def check_pull(
    law: SoilLaw, implement: Implement, vehicle: PlantVehicle, cone_index: float, speed: float
) -> None:
    """Refuse an implement that the tractor cannot pull on level ground.

    Args:
        law: of the wheels on soil.
        implement: settings.
        vehicle: that pulls it.
        cone_index: of the soil [kPa].
        speed: of the mission [m/s].

    Raises:
        InvalidPlant: at this draft the driven wheels slip by more than 30 %.
    """
    draft = implement.draft(speed)
    try:
        slip = equilibrium_slip(law, tyres_of(vehicle), wheel_loads(vehicle), cone_index, draft)
    except InvalidPlant:
        slip = 1.0
    if slip > _MOST_SLIP:
        needed = f"slip by {100.0 * slip:.0f} %" if slip < 1.0 else "cannot pull it"
        raise InvalidPlant(
            f"implement: got {implement.width_m:g} m x {100.0 * implement.depth_m:g} cm, a draft "
            f"of {draft:.0f} N at {speed:g} m/s; on {cone_index:g} kPa the driven wheels must pull "
            f"it with at most {100.0 * _MOST_SLIP:.0f} % slip, but {needed}"
        )
