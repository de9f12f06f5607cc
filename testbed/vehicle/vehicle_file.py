"""Vehicle files: the shipped ones in `mjcf/vehicles/`, and a user's own."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ..configuration.config_io import read_toml, validated
from ..configuration.resources import ShippedFiles
from ..errors import InvalidPlant
from .vehicle import PlantVehicle

DEFAULT_VEHICLE: Final = "kayacan2016"
_VEHICLES: Final = ShippedFiles("vehicle", "proving_ground.mjcf", "vehicles", ".toml", InvalidPlant)


def shipped_vehicles() -> list[str]:
    """Return the names of the vehicles that ship with the project."""
    return _VEHICLES.names()


def find_vehicle(name: str) -> Path:
    """Return the path of a vehicle file.

    Args:
        name: name of a shipped vehicle, or path of a TOML file.

    Raises:
        InvalidPlant: there is no such file.
    """
    return _VEHICLES.find(name)


def read_vehicle(name: str = DEFAULT_VEHICLE) -> PlantVehicle:
    """Return the vehicle of a file.

    Args:
        name: name of a shipped vehicle, or path of a TOML file.

    Raises:
        InvalidPlant: there is no such file, a key or a value is not allowed (the message names
            file and key), or the parts do not fit together (the message gives the reason).
    """
    file = find_vehicle(name)
    content = read_toml(file, InvalidPlant)
    try:
        return validated(PlantVehicle, content, InvalidPlant)
    except InvalidPlant as error:
        raise InvalidPlant(f"{file}: {error}") from None
