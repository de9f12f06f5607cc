"""`[controller]`: controller, estimator and their model parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT
from ttempc.guidance.controllers import CONTROLLERS, controller_options
from ttempc.guidance.estimators import ESTIMATORS
from ttempc.tube.reference_tube import TubeDesign
from ttempc.vehicle import Vehicle

from ..errors import InvalidScenario
from .tube_file import read_tube
from .vehicle import BelievedVehicle

OptionValue = bool | int | float | str | list[float] | None

_DEFAULT_TUBE: Final = "grass"
TRUTH: Final = "truth"
"""Name of the estimator that returns the true state."""


@dataclass(frozen=True, config=STRICT)
class ControllerSettings:
    """The controller, its options, and the estimator."""

    # One of `ttempc.CONTROLLERS`, or "package.module:factory" of a user's own.
    name: str = "ttempc"
    # One of `ttempc.ESTIMATORS`, "truth", or "package.module:factory" of a user's own.
    estimator: str = "ekf"
    # A shipped tube, or a path relative to the scenario: `ttempc-tube` needs one, `ttempc` monitors
    # its place in one. Unnamed it is that of grass, and none for a monitor of another vehicle.
    tube: str | None = None
    # Keyword options of the controller; those of shipped controllers are in docs/controllers.md.
    options: dict[str, OptionValue] = Field(default_factory=dict)
    vehicle: BelievedVehicle = BelievedVehicle()

    def __post_init__(self) -> None:
        if ":" not in self.estimator and self.estimator not in (*ESTIMATORS, TRUTH):
            allowed = ", ".join(sorted((*ESTIMATORS, TRUTH)))
            raise InvalidScenario(
                f"controller.estimator: got {self.estimator!r}, allowed are {allowed}, or "
                "package.module:factory"
            )

    def design(self, vehicle: Vehicle, period_s: float) -> TubeDesign | None:
        """Return the design of the tube that the controller needs or monitors, None without one.

        Raises:
            InvalidFit: there is no such tube, or its file is not valid.
            InvalidTube: the tube that is named was made for another vehicle.
        """
        entry = CONTROLLERS.get(self.name)
        if entry is None or entry.tube is None:
            return None
        design = read_tube(self.tube or _DEFAULT_TUBE).design()
        if entry.tube == "monitor" and self.tube is None and design.differing(vehicle, period_s):
            return None
        design.require(vehicle, period_s)
        return design

    def anchored(self, folder: Path) -> ControllerSettings:
        """Return the same with the path of its tube made absolute from `folder`."""
        if self.tube is None or not self.tube.endswith(".json"):
            return self
        return replace(self, tube=str((folder / self.tube).resolve()))

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
