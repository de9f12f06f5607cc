"""True vehicle: a tractor with a steerable trailer."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from ..configuration.config_io import STRICT
from .vehicle_checks import check_vehicle
from .vehicle_parts import VehicleParts


@dataclass(frozen=True, config=STRICT)
class PlantVehicle(VehicleParts):
    """Checked vehicle: read by `vehicle_file`, built by `vehicle_model`.

    Raises:
        InvalidPlant: the parts do not fit together, with the reason.
    """

    def __post_init__(self) -> None:
        check_vehicle(self)
