"""The command line `ttempc`: what every command has in common."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import NoReturn

from proving_ground.testbed.errors import TestbedError
from ttempc.errors import TtempcError

from ..errors import ExperimentError
from . import (
    card,
    catalogue,
    compare,
    envelope,
    fit_tube,
    frame,
    log,
    options,
    report,
    run,
    sweep,
    video,
    view,
)

_COMMANDS = (
    *(run, sweep, report, envelope, view, log, video, frame, compare, card, fit_tube, catalogue),
)

_ABOUT = """\
A tractor with a steerable trailer drives a figure eight over a bumpy, slippery
field in MuJoCo, under the controller of your choice.

  ttempc run                        the default: scenario `grass`, controller `ttempc`
  ttempc run wet-slope --seed 7     another field, another draw of terrain and noise
  ttempc run my-field.toml          a scenario of your own; `ttempc list` shows the shipped ones
  ttempc run grass --set soil.cone_index_kpa=250 --set path.laps=1
  ttempc sweep terrain-slip         thousands of runs on all cores: where does a controller fail?
  ttempc report runs/sweep-terrain-slip    what a sweep found: one page with tables and charts
  ttempc card wet-slope             is it my controller or the simulator? inspects the plant
  ttempc log info runs/DIR/log.mcap  what a log holds; export, check and recover it
  ttempc video runs/.../log.mcap    a film of a run; `frame` takes one picture of it
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(
            options.EXIT_BAD_INPUT, f"{self.prog}: error: {message} (see {self.prog} --help)\n"
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parsed = _parser().parse_args(arguments)
    try:
        return parsed.command(parsed)
    except (ExperimentError, TestbedError, TtempcError) as error:
        print(f"ttempc: error: {error}", file=sys.stderr)
        return options.EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("ttempc: interrupted; what was logged so far is in *.mcap.part", file=sys.stderr)
        return options.EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader of our output, as in `| head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="ttempc", description=_ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"ttempc {version('ttempc')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for room in _COMMANDS:
        room.add(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
