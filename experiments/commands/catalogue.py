"""`ttempc list` and `ttempc new`: what ships, and templates of one's own."""

import argparse
import importlib.util
import json
import keyword
from pathlib import Path
from typing import Final

from ...testbed.configuration.resources import resource
from ...testbed.foreign_files import read_bounded
from ..errors import ExperimentError
from ..output import refuse_existing, write_file
from .options import command, json_of, option, out

_USES: Final = {
    "scenarios": "ttempc run NAME",
    "studies": "ttempc sweep NAME",
    "vehicles": "plant.vehicle.file",
    "controllers": "--controller NAME",
    "tubes": "controller.tube; ttempc-tube requires one, ttempc monitors one",
}
# Template, suffix of the new file, and the command that drives it.
_TEMPLATES: Final = {
    "controller": ("controller.py.txt", ".py", "ttempc run grass --controller {name}:{named}"),
    "scenario": ("scenario.toml", ".toml", "ttempc run {name}.toml"),
    "study": ("study.toml", ".toml", "ttempc sweep {name}.toml --dry-run"),
}


@command(
    out("FILE", "default: print"),
    json_of("names and descriptions"),
    option("--schema", action="store_true", help="the JSON schema of a scenario, for editors"),
)
def list_(arguments: argparse.Namespace) -> int:
    """List the scenarios, studies, vehicles, controllers and tubes that ship with the
    project. --schema prints the JSON schema of a scenario file: every key with its type,
    range, default, unit and meaning, as editors with TOML completion read it.

      ttempc list --schema -o scenario.schema.json
    """
    if arguments.schema:
        from ..scenario.schema import json_schema

        text = json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"
    else:
        text = json.dumps(_groups(), indent=2) + "\n" if arguments.json else _listing() + "\n"
    if arguments.out:
        refuse_existing(arguments.out)
        write_file(arguments.out, text)
    else:
        print(text, end="")
    return 0


def _groups() -> dict[str, dict[str, str]]:
    # Imported here so that --help does not load MuJoCo.
    from ttempc.guidance.controllers import CONTROLLERS

    from ...testbed.vehicle.vehicle import VEHICLES, read_vehicle
    from ..scenario.scenario import load, shipped
    from ..scenario.tube_file import shipped_tubes
    from ..studies.sweep.study import load_study, shipped_studies

    return {
        "scenarios": {name: load(name)[1].description for name in shipped()},
        "studies": {name: load_study(name)[1].description for name in shipped_studies()},
        "vehicles": {name: read_vehicle(name).description for name in VEHICLES.names()},
        "controllers": {name: entry.about for name, entry in CONTROLLERS.items()},
        "tubes": {name: _tube(name) for name in shipped_tubes()},
    }


def _listing() -> str:
    lines = []
    for group, about in _groups().items():
        if group == "controllers":
            about |= {"package.module:factory": "your own, importable from the current folder"}
        lines.append(f"{group.capitalize()} ({_USES[group]}):")
        lines += [f"  {name:<20} {description}" for name, description in about.items()]
        lines.append("")
    return "\n".join(lines)


def _tube(name: str) -> str:
    from ..scenario.tube_file import read_tube

    made = read_tube(name).provenance
    return f"{', '.join(made.scenarios)}, coverage {made.coverage:g} of the windows"


@command(
    option("kind", choices=tuple(_TEMPLATES), help="what to start"),
    option("name", metavar="NAME", help="of the file, without its suffix"),
)
def new(arguments: argparse.Namespace) -> int:
    """Write a template that works into the current folder, and say how to drive it:

    ttempc new controller my_controller    my_controller.py
    ttempc new scenario my-field           my-field.toml
    ttempc new study my-study              my-study.toml
    """
    name: str = arguments.name
    template, suffix, drive = _TEMPLATES[arguments.kind]
    module = name if suffix == ".py" else name.replace("-", "_")
    if not module.isidentifier() or keyword.iskeyword(module):
        raise ExperimentError(f"name {name!r}: must be as that of a Python module, my_controller")
    file = Path(f"{name}{suffix}")
    refuse_existing(file)
    if suffix == ".py" and importlib.util.find_spec(name) is not None:
        raise ExperimentError(f"name {name!r}: the file would hide the module {name}, give another")
    named = "".join(part.capitalize() for part in name.split("_"))
    shipped = resource("proving_ground.experiments", f"templates/{template}")
    text = read_bounded(shipped).decode()
    write_file(file, text.replace("NameOfClass", named).replace("NAME", name))
    print(f"{file}\n{drive.format(name=name, named=named)}")
    return 0
