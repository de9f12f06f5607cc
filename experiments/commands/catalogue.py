"""`ttempc list`: show what a scenario can be made of by name."""

from __future__ import annotations

import argparse

from proving_ground.testbed.vehicle.vehicle_file import read_vehicle, shipped_vehicles
from ttempc.guidance.controllers import CONTROLLERS

from ..scenario.scenario import load, shipped
from ..scenario.tube_file import read_tube, shipped_tubes
from ..sweep.study import load_study, shipped_studies
from . import options


def add(commands: options.Commands) -> None:
    """Declare the command."""
    listing = commands.add_parser("list", help="show what ships with the project, by name")
    listing.set_defaults(command=_list)


def _list(arguments: argparse.Namespace) -> int:
    print("Scenarios (ttempc run NAME):")
    for name in shipped():
        print(f"  {name:<14} {load(name)[1].description}")
    print("\nStudies (ttempc sweep NAME):")
    for name in shipped_studies():
        print(f"  {name:<14} {load_study(name)[1].description}")
    print("\nVehicles (plant.vehicle.file):")
    for name in shipped_vehicles():
        print(f"  {name:<14} {read_vehicle(name).description}")
    print("\nControllers (--controller NAME):")
    for name, entry in CONTROLLERS.items():
        print(f"  {name:<20} {entry.about}")
    print(f"  {'package.module:factory':<20} one of your own, importable from where you stand")
    print("\nTubes (controller.tube; ttempc-tube keeps to it, ttempc watches it):")
    for name in shipped_tubes():
        said = read_tube(name).provenance
        print(f"  {name:<14} {', '.join(said.scenarios)}, coverage {said.coverage:g}")
    return 0
