"""`ttempc list`: list the shipped scenarios, studies, vehicles, controllers and tubes."""

from __future__ import annotations

import argparse

ABOUT = """\
Lists the scenarios, studies, vehicles, controllers and tubes that ship with the
project, by the names that other commands and scenario files take.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.set_defaults(command=_list)


def _list(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo.
    from proving_ground.testbed.vehicle.vehicle_file import read_vehicle, shipped_vehicles
    from ttempc.guidance.controllers import CONTROLLERS

    from ..scenario.scenario import load, shipped
    from ..scenario.tube_file import read_tube, shipped_tubes
    from ..sweep.study import load_study, shipped_studies

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
    print(f"  {'package.module:factory':<20} your own, importable from the current folder")
    print("\nTubes (controller.tube; ttempc-tube requires one, ttempc monitors one):")
    for name in shipped_tubes():
        tube = read_tube(name)
        scenarios = ", ".join(tube.provenance.scenarios)
        whole = tube.calibration
        text = f"{scenarios}, coverage {tube.provenance.coverage:g} of the windows"
        if whole is not None:
            text += f", calibrated for {whole.guaranteed:.3g} of the runs of {whole.scenario}"
        print(f"  {name:<14} {text}")
    return 0
