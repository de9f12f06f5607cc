"""`ttempc list`: list the shipped scenarios, studies, vehicles, controllers and tubes."""

from __future__ import annotations

import argparse
import json
from typing import Final

from . import options

ABOUT = """\
Lists the scenarios, studies, vehicles, controllers and tubes that ship with the
project, by the names that other commands and scenario files take.
"""

_USES: Final = {
    "scenarios": "ttempc run NAME",
    "studies": "ttempc sweep NAME",
    "vehicles": "plant.vehicle.file",
    "controllers": "--controller NAME",
    "tubes": "controller.tube; ttempc-tube requires one, ttempc monitors one",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_json(parser, "names and descriptions")
    parser.set_defaults(command=_list)


def _list(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo.
    from ttempc.guidance.controllers import CONTROLLERS

    from ...testbed.vehicle.vehicle import read_vehicle, shipped_vehicles
    from ..scenario.scenario import load, shipped
    from ..scenario.tube_file import shipped_tubes
    from ..sweep.study import load_study, shipped_studies

    groups = {
        "scenarios": {name: load(name)[1].description for name in shipped()},
        "studies": {name: load_study(name)[1].description for name in shipped_studies()},
        "vehicles": {name: read_vehicle(name).description for name in shipped_vehicles()},
        "controllers": {name: entry.about for name, entry in CONTROLLERS.items()},
        "tubes": {name: _tube(name) for name in shipped_tubes()},
    }
    if arguments.json:
        print(json.dumps(groups, indent=2))
        return 0
    for group, about in groups.items():
        print(f"{group.capitalize()} ({_USES[group]}):")
        for name, description in about.items():
            print(f"  {name:<20} {description}")
        if group == "controllers":
            print(f"  {'package.module:factory':<20} your own, importable from the current folder")
        print()
    return 0


def _tube(name: str) -> str:
    from ..scenario.tube_file import read_tube

    tube = read_tube(name)
    scenarios = ", ".join(tube.provenance.scenarios)
    text = f"{scenarios}, coverage {tube.provenance.coverage:g} of the windows"
    whole = tube.calibration
    if whole is not None:
        text += f", calibrated for {whole.guaranteed:.3g} of the runs of {whole.scenario}"
    return text
