"""`[controller]`: controller, estimator and their model parameters."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.guidance.controllers import CONTROLLERS, ESTIMATORS, controller_options, speed_tube
from ttempc.reference.corridor import SpeedTube
from ttempc.tube.reference_tube import TubeDesign
from ttempc.vehicle import Vehicle

from ...testbed.configuration.config_io import STRICT, NameOrFile
from ..errors import InvalidScenario
from .assumed_noise import NoiseSettings
from .tube_file import read_tube
from .vehicle import ModelVehicleSettings

OptionValue = bool | int | float | str | list[float] | None

_DEFAULT_TUBE: Final = "grass"
TRUTH: Final = "truth"
"""Name of the estimator that returns the true state."""


@dataclass(frozen=True, config=STRICT)
class ControllerSettings:
    """The controller, its options, and the estimator."""

    name: str = "ttempc"
    """Name in ttempc/guidance/controllers.py, or "package.module:factory" of a user's own."""
    estimator: str = "ekf"
    """Name in ttempc/guidance/controllers.py, "truth", or "package.module:factory"."""
    tube: NameOrFile | None = None
    """Name of a shipped tube, or path of a file relative to the scenario.

    `ttempc-tube` stays inside it. `ttempc` leaves it its share of the inputs and monitors its
    deviation from it. The default is the tube of grass; `ttempc` has none if its vehicle differs
    from that of grass.
    """
    options: dict[str, OptionValue] = Field(default_factory=dict)
    """Options of the controller, such as `horizon`; keyword arguments of a user's factory."""
    vehicle: ModelVehicleSettings = ModelVehicleSettings()
    """Parameters of the model of controller and estimator."""
    noise: NoiseSettings = NoiseSettings()
    """Noise of the sensors that the estimator assumes."""
    learn: bool = True
    """Whether parameters of the model are learnt while driving, see docs/learning.md."""

    def __post_init__(self) -> None:
        if ":" not in self.estimator and self.estimator not in (*ESTIMATORS, TRUTH):
            allowed = ", ".join(sorted((*ESTIMATORS, TRUTH)))
            raise InvalidScenario(
                f"controller.estimator: got {self.estimator!r}, allowed are {allowed}, or "
                "package.module:factory"
            )

    @property
    def tube_name(self) -> str:
        """Name or path of the tube, the default where none is given."""
        return self.tube or _DEFAULT_TUBE

    def design(self, vehicle: Vehicle, period_s: float) -> TubeDesign | None:
        """Return the design of the tube that the controller needs or uses, None without one.

        Raises:
            InvalidFit: there is no such tube, or its file is not valid.
            InvalidTube: the tube that is named was made for another vehicle.
        """
        entry = CONTROLLERS.get(self.name)
        if entry is None or entry.tube is None:
            return None
        design = read_tube(self.tube_name).design()
        if entry.tube == "optional" and self.tube is None and design.differing(vehicle, period_s):
            return None
        design.require(vehicle, period_s)
        return design

    def notes(self, vehicle: Vehicle, period_s: float) -> tuple[str, ...]:
        """Return what a user has to know of the controller's tube; nothing where it has one."""
        entry = CONTROLLERS.get(self.name)
        if entry is None or entry.tube is None or self.design(vehicle, period_s):
            return ()
        options = controller_options(self.name, self.options)
        if options["tightening"] != "tube" or not options["robust"]:
            return ()
        return (
            f"inputs of {self.name} are not tightened: the tube of {_DEFAULT_TUBE} is for another "
            "vehicle or control period, and controller.tube names no other",
        )

    def speed_tube(self) -> SpeedTube | None:
        """Return the half widths that the controller keeps over speed, None where it has none."""
        return speed_tube(self.name, self.options) if self.name in CONTROLLERS else None

    def with_defaults(self) -> ControllerSettings:
        """Return the same with every option of a shipped controller filled in.

        Raises:
            InvalidTuning: an option is unknown, of another type, or out of its range.
        """
        if self.name not in CONTROLLERS:
            return self
        options = controller_options(self.name, self.options)
        return replace(self, options={key: _plain(value) for key, value in options.items()})


def _plain(value: object) -> OptionValue:
    return list(value) if isinstance(value, tuple) else value  # pyright: ignore[reportReturnType]
