"""`ttempc validate` and `ttempc mjcf`: the plant of a scenario, without a controller."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..output import make_folder, write_file
from . import options
from .options import command, json_of, out


@command(
    options.SCENARIO,
    out("DIR", "default: a new one in runs/"),
    *options.CHANGES,
    json_of("the checks"),
)
def validate(arguments: argparse.Namespace) -> int:
    """Validate the plant of a scenario in experiments whose results are known without the
    simulation, or published. Write the validation report into DIR: a page to attach to a
    paper, the checks as JSON, the figures. Exit code 1 if a check fails.
    """
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..validation.validation_report import format_check, validation_report

    name, scenario = options.load_scenario(arguments)
    stem = f"{name}-validation-{scenario.plant.wheels}"
    folder = arguments.out or options.unused_path(Path("runs"), stem)
    validation = validation_report(
        name,
        scenario,
        folder,
        on_check=lambda check: None if arguments.json else print(format_check(check), flush=True),
    )
    if arguments.json:
        print(validation.to_json(), end="")
    else:
        print(f"\n{validation.summary_line()}\n\nopen {folder / 'validation.html'}")
    return 0 if validation.passed else options.EXIT_CHECK_FAILED


@command(
    options.SCENARIO,
    out("DIR", "default: a new one in runs/"),
    *options.CHANGES,
    options.SEED,
)
def mjcf(arguments: argparse.Namespace) -> int:
    """Write a scenario's vehicle on its ground as files that MuJoCo loads without this
    project: scene.xml, and ground.hf where the ground is not level. The wheels have
    MuJoCo's own contact; the keyframe `home` stands at the start. Actuators: front
    steering [rad], drawbar [rad], hydrostat from -1 to 1.

      ttempc mjcf patchy -o patchy
      python -m mujoco.viewer --mjcf=patchy/scene.xml
    """
    # Imported here so that --help does not load MuJoCo.
    from ...testbed.simulation.mjcf_export import mjcf_files
    from ..run.assembly import assemble

    arguments.overrides = [*arguments.overrides, "plant.wheels=contact"]
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
