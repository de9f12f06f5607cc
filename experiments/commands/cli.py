"""Command line `ttempc`: choice of the command, errors, exit codes."""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
import threading
from collections.abc import Container, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from types import FrameType
from typing import Any, Final, NoReturn

from ttempc.errors import TtempcError
from ttempc.suggestion import did_you_mean

from ...testbed.errors import TestbedError
from ...testbed.terminal import one_line
from ..errors import ExperimentError
from ..threads import use_one_thread
from .options import EXIT_BAD_INPUT, EXIT_INTERRUPTED


@dataclass(frozen=True, slots=True)
class _Command:
    module: str  # of this package
    help: str  # in one line


_COMMANDS: Final = {
    "run": _Command("run", "drive one scenario to its end"),
    "view": _Command("pictures.view", "watch a run in MuJoCo's viewer"),
    "serve": _Command("serve", "drive one scenario with a controller over UDP"),
    "list": _Command("catalogue", "list what ships with the project"),
    "new": _Command("new", "start a controller, a scenario or a study from a template"),
    "schema": _Command("schema", "print the JSON schema of a scenario, for editors"),
    "sweep": _Command("studies.sweep", "drive all runs of a study"),
    "report": _Command("report", "page of a sweep, or of a run from its log"),
    "envelope": _Command("studies.envelope", "find where controllers fail"),
    "bench": _Command("studies.bench", "field trials: score a controller on frozen scenarios"),
    "falsify": _Command("studies.falsify", "search for the least severe case that fails"),
    "compare": _Command("studies.compare", "compare several runs on one reference"),
    "log": _Command("log", "show, export, check, recover or replay a log"),
    "video": _Command("pictures.video", "film a run from its log"),
    "figures": _Command("pictures.figures", "figures of a run for a paper, and their data"),
    "frame": _Command("pictures.frame", "take one picture of a run from its log"),
    "mjcf": _Command("mjcf", "export a scenario's vehicle and ground for MuJoCo"),
    "card": _Command("card", "validate the plant of one scenario"),
    "completion": _Command("completion", "print what completes commands in a shell"),
    "fit-tube": _Command("studies.fit_tube", "fit a tube to the logs of runs"),
}

_ABOUT = """\
A tractor with a steerable trailer drives a figure eight over a bumpy, slippery
field in MuJoCo, under the controller of your choice.

  ttempc run                        the default: scenario `grass`, controller `ttempc`
  ttempc run wet-slope --seed 7     another field, another draw of terrain and noise
  ttempc run my-field.toml          your own scenario; `ttempc list` shows the shipped ones
  ttempc run grass --set soil.cone_index_kpa=250 --set path.laps=1
  ttempc new controller mine        a controller of your own, to start from
  ttempc sweep terrain-slip         thousands of runs on all cores
  ttempc report runs/sweep-terrain-slip    one page with tables and charts of a sweep
  ttempc serve grass                the plant over UDP, for a controller in any language
  ttempc card wet-slope             validation of the plant: is it my controller or the simulator?
  ttempc log info runs/DIR/log.mcap  content of a log; export, check, recover, replay it
  ttempc log calibrate runs/DIR -o vehicle.toml     lengths of the vehicle from a run
  ttempc video runs/.../log.mcap    a film of a run; `frame` takes one picture of it
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        if unknown := re.match(r"argument COMMAND: invalid choice: '([^']*)'", message):
            message += did_you_mean(unknown[1], _COMMANDS)
        line = one_line(f"{self.prog}: error: {message} (see {self.prog} --help)")
        self.exit(EXIT_BAD_INPUT, f"{line}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    use_one_thread()
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == ["calibrate"]:  # the action of a log by its short name
        arguments = ["log", *arguments]
    previous = _catch_termination()
    compiled_before = _compiled()[0]
    try:
        chosen = next((text for text in arguments if not text.startswith("-")), None)
        parsed = make_parser({chosen}).parse_args(arguments)
        return parsed.command(parsed)
    except (ExperimentError, TestbedError, TtempcError) as error:
        return _refuse(str(error))
    except KeyboardInterrupt:
        print(
            "ttempc: interrupted; the log of an unfinished run is its *.mcap.part", file=sys.stderr
        )
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader of the output has closed it, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a full disk, a name that is too long, no permission
        return _refuse(f"{error.filename or 'output'}: {error.strerror or error}")
    except MemoryError as error:
        return _refuse(f"more memory is needed than there is: {error}")
    except RecursionError:
        return _refuse("the input is nested too deeply")
    finally:
        kernels, seconds = _compiled()
        if kernels > compiled_before:
            print(f"ttempc: compiled {kernels} kernels in {seconds:.1f} s", file=sys.stderr)
        if previous is not None:
            signal.signal(signal.SIGTERM, previous)


def _compiled() -> tuple[int, float]:
    """Return how many kernels this process has compiled, and in what time [s]."""
    jit = sys.modules.get("ttempc.jit")  # it loads numba, which help and refusals do without
    if jit is None or not jit.COMPILATION.done:
        return 0, 0.0
    return jit.COMPILATION.kernels, jit.COMPILATION.duration


def _refuse(reason: str) -> int:
    print(one_line(f"ttempc: error: {reason}"), file=sys.stderr)
    return EXIT_BAD_INPUT


def _catch_termination() -> Any:  # noqa: ANN401 - as of `signal.signal`
    """Let SIGTERM, as from Slurm or systemd, end a command as Ctrl-C does; return the handler."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once: the way out is not interrupted
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        return None
    return signal.signal(signal.SIGTERM, interrupt)


def make_parser(complete: Container[str | None]) -> argparse.ArgumentParser:
    """Return the parser of the command line.

    Args:
        complete: commands whose arguments it has; it imports their modules alone, since some load
            slowly.
    """
    parser = _Parser(
        prog="ttempc", description=_ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"ttempc {version('ttempc')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, command in _COMMANDS.items():
        subparser = commands.add_parser(
            name, help=command.help, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        if name in complete:
            module = import_module(f".{command.module}", __package__)
            subparser.description = module.ABOUT
            module.add_arguments(subparser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
