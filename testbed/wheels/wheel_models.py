"""Registry of wheel models: the forces of the ground on the wheels, by name.

A new model is a module with a class that satisfies `WheelModel`, and a line in `WHEEL_MODELS`.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, ClassVar, Final, Protocol

import mujoco
from pydantic import AfterValidator, Field

from ttempc.types import FloatArray

from ..errors import InvalidPlant
from ..ground.ground import Ground
from .contact_wheels import ContactWheels
from .soil_law import SoilLaw
from .soil_wheels import SoilWheels
from .tyre import Tyres


class WheelModel(Protocol):
    """The wheels of one plant.

    The plant calls `adapt` before it compiles the MJCF. For every series of physics steps it calls
    `prepare` once, `step` before the accelerations of each step, and `report` after the
    accelerations of the last one. A reset sets `state` and `output` to zero.
    """

    follows_soil_law: ClassVar[bool]  # its forces are those of `soil_law`

    @property
    def state(self) -> FloatArray:
        """Everything that the future depends on besides MuJoCo's state; changed in place."""
        ...

    @property
    def output(self) -> FloatArray:
        """The last report, (6, 7): wheels in the order of `WHEELS`, columns of `Output`."""
        ...

    @property
    def step(self) -> Callable[[], object]:
        """Apply the forces of the ground for one physics step."""
        ...

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        tyres: Tyres,
        ground: Ground,
        law: SoilLaw,
    ) -> None: ...

    @staticmethod
    def adapt(spec: mujoco.MjSpec) -> None:
        """Change the MJCF, in place, to what the model needs."""
        ...

    def prepare(self) -> None:
        """Prepare a series of steps from the loads of the last report."""
        ...

    def report(self) -> None:
        """Write loads, slips and forces of the present step into `output`."""
        ...


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


def _known(name: str) -> str:
    wheel_model(name)
    return name


WheelModelName = Annotated[
    str, AfterValidator(_known), Field(json_schema_extra={"enum": list(WHEEL_MODELS)})
]
"""Type of a setting: the name of a wheel model; another name raises `InvalidPlant`."""
