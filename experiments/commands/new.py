"""`ttempc new`: start a controller, a scenario or a study from a template that works."""

from __future__ import annotations

import argparse
import keyword
from pathlib import Path
from typing import Final

from ...testbed.configuration.resources import resource
from ..errors import ExperimentError
from ..output import refuse_existing, write_file

ABOUT = """\
Writes a template that works into the current folder, and says how to drive it:

  ttempc new controller my_controller    my_controller.py
  ttempc new scenario my-field           my-field.toml
  ttempc new study my-study              my-study.toml
"""

# Template, suffix of the new file, and the command that drives it.
_KINDS: Final = {
    "controller": ("controller.py.txt", ".py", "ttempc run grass --controller {name}:{named}"),
    "scenario": ("scenario.toml", ".toml", "ttempc run {name}.toml"),
    "study": ("study.toml", ".toml", "ttempc sweep {name}.toml --dry-run"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("kind", choices=_KINDS, help="what to start")
    parser.add_argument("name", metavar="NAME", help="of the file, without its suffix")
    parser.set_defaults(command=_new)


def _new(arguments: argparse.Namespace) -> int:
    name: str = arguments.name
    template, suffix, drive = _KINDS[arguments.kind]
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
