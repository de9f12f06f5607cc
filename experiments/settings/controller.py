"""`[controller]`: who drives, and what it believes."""

from __future__ import annotations

from typing import Literal

from pydantic.dataclasses import dataclass

from experiments.settings.vehicle import BelievedVehicle
from testbed.strict import STRICT


@dataclass(frozen=True, config=STRICT)
class ControllerSettings:
    """Who drives."""

    name: str = "ttempc"  # in ttempc/controllers.py, or "package.module:factory" of your own
    estimator: Literal["ekf", "nmhe", "truth"] = "ekf"
    vehicle: BelievedVehicle = BelievedVehicle()
