"""`[controller]`: who drives, and what it believes."""

from __future__ import annotations

from typing import Final, Literal

from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT, NameOrFile
from ttempc.guidance.controllers import CONTROLLERS
from ttempc.tube.reference_tube import TubeDesign
from ttempc.vehicle import Vehicle

from .tube_file import read_tube
from .vehicle import ModelVehicleSettings

_DEFAULT_TUBE: Final = "grass"


@dataclass(frozen=True, config=STRICT)
class ControllerSettings:
    """Who drives."""

    name: str = "ttempc"
    """Name in ttempc/guidance/controllers.py, or "package.module:factory" of a user's own."""
    estimator: Literal["ekf", "nmhe", "truth"] = "ekf"
    """State estimator."""
    tube: NameOrFile | None = None
    """Name of a shipped tube, or path of a file relative to the scenario.

    `ttempc-tube` stays inside it, `ttempc` monitors its deviation from it. The default is the tube
    of grass; a controller that only monitors has none if its vehicle differs from that of grass.
    """
    vehicle: ModelVehicleSettings = ModelVehicleSettings()
    """Parameters of the model of controller and estimator."""

    def design(self, vehicle: Vehicle, period_s: float) -> TubeDesign | None:
        """Return the tube that the controller keeps to or watches, None where it has none.

        Raises:
            InvalidFit: there is no such tube, or it is not understood.
            InvalidTube: the one that is named was made for another vehicle.
        """
        known = CONTROLLERS.get(self.name)
        if known is None or known.tube is None:
            return None
        design = read_tube(self.tube or _DEFAULT_TUBE).design()
        if known.tube == "watches" and self.tube is None and design.differing(vehicle, period_s):
            return None
        design.require(vehicle, period_s)
        return design
