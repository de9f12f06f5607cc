"""`[controller]`: who drives, and what it believes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from pydantic.dataclasses import dataclass

from experiments.settings.vehicle import BelievedVehicle
from experiments.tube_file import read_tube
from testbed.strict import STRICT
from ttempc.controllers import CONTROLLERS
from ttempc.reference_tube import TubeDesign


@dataclass(frozen=True, config=STRICT)
class ControllerSettings:
    """Who drives."""

    name: str = "ttempc"  # in ttempc/controllers.py, or "package.module:factory" of your own
    estimator: Literal["ekf", "nmhe", "truth"] = "ekf"
    tube: str = "grass"  # a shipped tube, or a path relative to the scenario; of `ttempc-tube`
    vehicle: BelievedVehicle = BelievedVehicle()

    def design(self) -> TubeDesign | None:
        """Return the tube of a controller that keeps to one, None for others.

        Raises:
            InvalidFit: there is no such tube, or it is not understood.
        """
        known = CONTROLLERS.get(self.name)
        return read_tube(self.tube).design() if known and known.with_tube else None

    def anchored(self, folder: Path) -> ControllerSettings:
        """Return the same with the path of its tube made absolute from `folder`."""
        if not self.tube.endswith(".json"):
            return self
        return replace(self, tube=str((folder / self.tube).resolve()))
