"""`ttempc list` and `ttempc new`: what ships, and templates of one's own."""

from __future__ import annotations

import argparse
import json
import keyword
from pathlib import Path
from typing import Final

from ...testbed.configuration.resources import resource
from ..errors import BadOptions, ExperimentError
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
    out("FILE", "of --schema, --completion; default: print"),
    json_of("names and descriptions"),
    option(
        "--schema",
        nargs="?",
        choices=("json", "markdown"),
        const="json",
        help="the JSON schema of a scenario for editors, or a page with a row for each key",
        group="what",
    ),
    option("--completion", choices=("bash", "zsh"), help="the script for this shell", group="what"),
)
def list_(arguments: argparse.Namespace) -> int:
    """List the scenarios, studies, vehicles, controllers and tubes that ship with the
    project, by the names that other commands and scenario files take.

    --schema prints the JSON schema of a scenario file (draft 2020-12): every key with its
    type, range, default, unit and meaning. An editor with TOML completion reads it from the
    first line of a scenario. --completion prints a script that completes commands, options
    and files.

      ttempc list --schema -o scenario.schema.json
      #:schema ./scenario.schema.json        (Taplo, Even Better TOML)
      ttempc list --completion bash > ~/.local/share/bash-completion/completions/ttempc
      ttempc list --completion zsh > ~/.zfunc/_ttempc      with fpath+=~/.zfunc before compinit
    """
    if not (arguments.schema or arguments.completion):
        if arguments.out:
            raise BadOptions("--out: goes with --schema or --completion")
        print(json.dumps(_groups(), indent=2) if arguments.json else _listing())
        return 0
    if arguments.out:
        refuse_existing(arguments.out)
    if arguments.completion:
        import shtab

        from .cli import make_parser

        text = shtab.complete(make_parser(), arguments.completion)
    elif arguments.schema == "markdown":
        from ..scenario.schema import scenario_reference

        text = scenario_reference()
    else:
        from ..scenario.schema import json_schema

        text = json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"
    if arguments.out:
        write_file(arguments.out, text)
    else:
        print(text, end="")
    return 0


def _groups() -> dict[str, dict[str, str]]:
    # Imported here so that --help does not load MuJoCo.
    from ttempc.guidance.controllers import CONTROLLERS

    from ...testbed.vehicle.vehicle import read_vehicle, shipped_vehicles
    from ..scenario.scenario import load, shipped
    from ..scenario.tube_file import shipped_tubes
    from ..sweep.study import load_study, shipped_studies

    return {
        "scenarios": {name: load(name)[1].description for name in shipped()},
        "studies": {name: load_study(name)[1].description for name in shipped_studies()},
        "vehicles": {name: read_vehicle(name).description for name in shipped_vehicles()},
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

    tube = read_tube(name)
    scenarios = ", ".join(tube.provenance.scenarios)
    text = f"{scenarios}, coverage {tube.provenance.coverage:g} of the windows"
    whole = tube.calibration
    if whole is not None:
        text += f", calibrated for {whole.guaranteed:.3g} of the runs of {whole.scenario}"
    return text


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
    is_module = name.isidentifier() and not keyword.iskeyword(name)
    if suffix == ".py" and not is_module:
        raise ExperimentError(
            f"name {name!r}: must be the name of a Python module, such as my_controller"
        )
    if not name.replace("-", "").replace("_", "").isalnum():
        raise ExperimentError(f"name {name!r}: must have letters, digits, - and _ only")
    file = Path(f"{name}{suffix}")
    refuse_existing(file)
    named = "".join(part.capitalize() for part in name.split("_"))
    text = resource("proving_ground.experiments", f"templates/{template}").read_text()
    write_file(file, text.replace("NameOfClass", named).replace("NAME", name))
    print(f"{file}\n{drive.format(name=name, named=named)}")
    return 0
