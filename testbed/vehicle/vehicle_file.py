"""Vehicles by name: the files that ship in `mjcf/vehicles/`, and files of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ..configuration.config_io import read_toml, validated
from ..configuration.resources import Shelf
from ..errors import InvalidPlant
from .vehicle import PlantVehicle

DEFAULT_VEHICLE: Final = "kayacan2016"
_VEHICLES: Final = Shelf("vehicle", "proving_ground.mjcf", "vehicles", ".toml", InvalidPlant)


def shipped_vehicles() -> list[str]:
    """Return the names of the vehicles that ship with the project."""
    return _VEHICLES.names()


def find_vehicle(name: str) -> Path:
    """Return the file of a vehicle: a shipped name, or the path of a TOML file.

    Raises:
        InvalidPlant: there is none.
    """
    return _VEHICLES.find(name)


def read_vehicle(name: str = DEFAULT_VEHICLE) -> PlantVehicle:
    """Return the vehicle with this name or in this file.

    Raises:
        InvalidPlant: no such file, a key or value that is not allowed (with file and key), or
            parts that do not make a vehicle (with the reason).
    """
    file = find_vehicle(name)
    content = read_toml(file, InvalidPlant)
    try:
        return validated(PlantVehicle, content, InvalidPlant)
    except InvalidPlant as error:
        raise InvalidPlant(f"{file}: {error}") from None
