"""The farm machine with its field cultivator, as it ships or with one constant wrong."""

from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any, Final

from ...testbed.configuration.config_io import read_toml, validated
from ...testbed.errors import InvalidPlant
from ...testbed.ground.soil import SoilMap
from ...testbed.ground.terrain import flat
from ...testbed.implement.implement import Implement
from ...testbed.validation.bench import FIRM_KPA, Bench
from ...testbed.validation.single_manoeuvres import Machine
from ...testbed.vehicle.servos import tyres_of
from ...testbed.vehicle.vehicle import VEHICLES, PlantVehicle
from ...testbed.wheels.soil_law import SoilLaw
from .markdown import markdown

VEHICLE: Final = "farm4500"
WRONG: Final = (0.7, 1.3)
"""Factors of a wrong constant."""

_TOOL: Final = {"width_m": 2.0, "side_stiffness_n_per_deg_m2": 1500.0}


@dataclass(frozen=True, slots=True)
class Constant:
    """A constant times a factor: of the wheel law, the vehicle, the implement, or the soil."""

    name: str = ""  # as "law.side", "vehicle.load.mass_kg", "vehicle.*_wheel.damping_spm"
    factor: float = 1.0

    def of(self, name: str) -> float:
        """Return the factor of a constant: 1, unless it is the one that is wrong."""
        return self.factor if name == self.name else 1.0


RIGHT: Final = Constant()


def machine(wrong: Constant = RIGHT) -> Machine:
    """Return the machine on firm, level ground.

    Raises:
        InvalidPlant: nobody can build it with that constant.
    """
    vehicle = _vehicle(wrong)
    place, _, name = wrong.name.partition(".")
    law = scaled_law(vehicle, (name,), wrong.factor) if place == "law" else SoilLaw()
    tool: dict[str, Any] = {key: own * wrong.of(f"implement.{key}") for key, own in _TOOL.items()}
    return Machine(
        Bench(vehicle, flat((300.0, 60.0)), SoilMap(FIRM_KPA), wheel_law=law),
        Implement(type="field-cultivator", depth_m=0.10, **tool),
        strength=wrong.of("soil.cone_index_kpa"),
    )


def scaled_law(
    vehicle: PlantVehicle, names: Iterable[str], factor: float, of: SoilLaw | None = None
) -> SoilLaw:
    """Return the law of a vehicle's tyres, of either kind, with coefficients times a factor.

    Args:
        vehicle: whose tyres are of one kind or the other.
        names: of the coefficients.
        factor: of all of them.
        of: law that is changed; None: the default one.
    """
    law = copy((of or SoilLaw()).of(tyres_of(vehicle).radial))
    for name in names:
        object.__setattr__(law, name, factor * getattr(law, name))
    return law


def _vehicle(wrong: Constant) -> PlantVehicle:
    """Return the vehicle; a table `*_wheel` stands for the wheels of all axles."""
    content = read_toml(VEHICLES.find(VEHICLE), InvalidPlant)
    place, _, rest = wrong.name.partition(".")
    if place == "vehicle":
        table, key = rest.split(".")
        ending = table.lstrip("*")
        for name in [each for each in content if each.endswith(ending)]:
            if name == table or table.startswith("*"):
                content[name][key] *= wrong.factor
    return validated(PlantVehicle, content, InvalidPlant)


def settings(*, tool: bool = True, cone_index: float = 900.0) -> tuple[str, ...]:
    """Return the settings of the right machine on the field of `farm`, as of `--set`."""
    inside = ",".join(f"{key}={value}" for key, value in _TOOL.items())
    return (
        f"plant.vehicle.file={VEHICLE}",
        f"soil.cone_index_kpa={cone_index}",
        *([f'implement={{type="field-cultivator",depth_m=0.10,{inside}}}'] if tool else []),
        'sensors.preset="field"',
    )


def turned_out(out: Mapping[Constant, list[int]], refused: Iterable[Constant] = ()) -> str:
    """Return how many rows each constant turns out, and which; last the constants that turn none.

    Args:
        out: numbers of the rows that each wrong constant turns out.
        refused: constants with which nobody can build the machine.
    """
    cells: dict[str, list[str]] = {}
    for wrong, rows in out.items():
        text = f"{len(rows)}: {', '.join(map(str, rows))}".rstrip(": ")
        own = cells.setdefault(wrong.name, [f"`{wrong.name}`"])
        own.append("refused" if wrong in refused else text)
    heads = ["constant", "30 % too small turns out", "30 % too large"]
    idle = [name for name, *own in cells.values() if own == ["0", "0"]]
    table = markdown(heads, (own for own in cells.values() if own[0] not in idle))
    return f"{table}\n\nNo row: {', '.join(idle)}." if idle else table
