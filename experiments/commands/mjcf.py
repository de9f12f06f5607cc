"""`ttempc mjcf`: export the vehicle of a scenario on its ground as MJCF."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..output import make_folder, write_file
from . import options

ABOUT = """\
Writes a scenario's vehicle on its ground as files that MuJoCo loads without this
project: scene.xml, and ground.hf where the ground is not level. The wheels have
MuJoCo's own contact with the friction of the soil at the start; the keyframe `home`
stands there. Positions of the actuators: front steering [rad], drawbar [rad],
hydrostat from -1 to 1.

  ttempc mjcf patchy -o patchy
  python -m mujoco.viewer --mjcf=patchy/scene.xml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_scenario(parser)
    options.add_seed(parser)
    parser.set_defaults(command=_mjcf)


def _mjcf(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo.
    from ...testbed.simulation.mjcf_export import mjcf_files
    from ..run.assembly import assemble

    arguments.overrides.append("plant.wheels=contact")
    name, scenario = options.load_scenario(arguments)
    folder = arguments.out or options.unused_path(Path("runs"), f"{name}-mjcf-{arguments.seed}")
    assembly = assemble(scenario, arguments.seed)
    assembly.plant.restore(assembly.start)
    files = mjcf_files(assembly.plant)
    make_folder(folder)
    for file, content in files.items():
        write_file(folder / file, content)
        print(folder / file)
    return 0
