"""Command line `ttempc`: choice of the command, errors, exit codes."""

import argparse
import io
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from types import FrameType
from typing import Any, Final, NoReturn

from ttempc.errors import TtempcError
from ttempc.suggestion import did_you_mean

from ...testbed.errors import TestbedError
from ...testbed.terminal import one_line
from ..errors import ExperimentError
from ..numerics import settle_numerics
from ..output import announce_compilation
from .options import EXIT_BAD_INPUT, EXIT_INTERRUPTED, Command, Group

# Module and attribute of each command, and its help in one line.
_COMMANDS: Final = {
    "run": ("drive.run", "drive one scenario to its end"),
    "demo": ("drive.demo", "drive 20 s, film them and make the report"),
    "compare": ("pictures.compare", "compare several runs on one reference"),
    "report": ("pictures.report", "page, or figures for a paper, of a run or a sweep"),
    "render": ("pictures.render", "film or picture of a run from its log"),
    "sweep": ("studies.sweep", "drive all runs of a study"),
    "search": ("studies.search", "search for the limit of a quantity, or for the worst case"),
    "bench": ("studies.bench", "benchmark: score a controller on frozen scenarios"),
    "fit": ("log.fit", "fit a tube to the logs of runs"),
    "log": ("log.log", "show, export, check, recover or replay a log"),
    "serve": ("drive.serve", "drive one scenario with a controller over UDP"),
    "validate": ("drive.validate", "validate the plant of one scenario"),
    "mjcf": ("drive.mjcf", "export a scenario's vehicle and ground for MuJoCo"),
    "new": ("catalogue.new", "start a controller, a scenario or a study from a template"),
    "list": ("catalogue.list_", "list what ships; JSON schema of a scenario"),
}

_ABOUT: Final = """\
A tractor with a steerable trailer drives a figure eight over a bumpy, slippery
field in MuJoCo, under the controller of your choice.

  ttempc demo                       20 s of driving as a moving picture, and the report
  ttempc run                        the default: scenario `grass`, controller `ttempc`
  ttempc run wet-slope --seed 7 --set path.laps=1
  ttempc new controller mine        a controller of your own, to start from
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        if unknown := re.match(r"argument COMMAND: invalid choice: '([^']*)'", message):
            message += did_you_mean(unknown[1], _COMMANDS)
        line = one_line(f"{self.prog}: error: {message} (see {self.prog} --help)")
        self.exit(EXIT_BAD_INPUT, f"{line}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    settle_numerics()
    if arguments is None:
        _print_what_the_terminal_can()
    parsed = argparse.Namespace(own_process=arguments is None)
    arguments = sys.argv[1:] if arguments is None else arguments
    previous = _catch_termination()
    try:
        chosen = next((text for text in arguments if not text.startswith("-")), "")
        parsed = make_parser(chosen).parse_args(arguments, parsed)
        return parsed.command(parsed)
    except (ExperimentError, TestbedError, TtempcError) as error:
        return _refuse(str(error))
    except KeyboardInterrupt as error:
        # A run whose log was cut says where it is; a film or a page leaves nothing behind.
        told = "; ".join(["interrupted", *getattr(error, "__notes__", ())])
        print(one_line(f"ttempc: {told}"), file=sys.stderr)
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
        announce_compilation()
        if previous is not None:
            signal.signal(signal.SIGTERM, previous)


def _print_what_the_terminal_can() -> None:
    """Let letters that the encoding of an output lacks be printed as question marks."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


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


def make_parser(*complete: str) -> argparse.ArgumentParser:
    """Return the parser of the command line.

    Args:
        complete: commands whose options it has; it imports their modules alone. None: all.
    """
    shown = argparse.RawDescriptionHelpFormatter
    parser = _Parser(prog="ttempc", description=_ABOUT, formatter_class=shown)
    parser.add_argument("--version", action="version", version=f"ttempc {version('ttempc')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, (place, title) in _COMMANDS.items():
        below = commands.add_parser(name, help=title, formatter_class=shown)
        if not complete or name in complete:
            module, attribute = place.split(".")
            declared = getattr(import_module(f".{module}", __package__), attribute)
            assert isinstance(declared, Command | Group)
            declared.add_to(below)
    return parser


if __name__ == "__main__":
    sys.exit(main())
