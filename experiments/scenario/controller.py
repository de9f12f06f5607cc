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

    name: str = (
        "ttempc"  # in ttempc/guidance/controllers.py, or "package.module:factory" of your own
    )
    estimator: Literal["ekf", "nmhe", "truth"] = "ekf"
    # A shipped tube, or a path relative to the scenario. `ttempc-tube` keeps to it,
    # `ttempc` watches where it is in it. Unnamed it is that of grass;
    # a watcher of another vehicle has none then.
    tube: NameOrFile | None = None
    vehicle: ModelVehicleSettings = ModelVehicleSettings()

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
