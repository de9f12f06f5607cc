"""`ttempc completion`: script that completes commands in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

ABOUT = """\
Prints a script that completes commands, options, files, and the names of scenarios,
studies and controllers:

  ttempc completion bash > ~/.local/share/bash-completion/completions/ttempc
  ttempc completion zsh > ~/.zfunc/_ttempc      with fpath+=~/.zfunc before compinit
"""

_SHELLS: Final = ("bash", "zsh")


class _All:
    """Every command."""

    def __contains__(self, name: object) -> bool:
        return True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("shell", choices=_SHELLS)
    parser.set_defaults(command=_print)


def _print(arguments: argparse.Namespace) -> int:
    # Imported here: the parser of all commands loads slowly.
    import shtab

    from ttempc.guidance.controllers import CONTROLLERS

    from ..scenario.scenario import shipped
    from ..sweep.study import shipped_studies
    from .cli import make_parser

    names = {
        "SCENARIO": shipped(),
        "STUDY": shipped_studies(),
        "--controller": list(CONTROLLERS),
    }
    functions = {name: f"_ttempc_{name.strip('-').lower()}" for name in names}
    parser = make_parser(_All())
    for action in _actions(parser):
        if isinstance(action.choices, dict):  # shtab takes it for commands
            action.choices = [*action.choices]
        key = next(filter(names.__contains__, (*action.option_strings, str(action.metavar))), None)
        if key is not None:
            completed: Any = dict.fromkeys(_SHELLS, functions[key])
            action.complete = completed  # pyright: ignore[reportAttributeAccessIssue] # of shtab
        elif action.type is Path:
            action.complete = shtab.FILE  # pyright: ignore[reportAttributeAccessIssue]
    preamble: Any = {
        "bash": "\n".join(
            f'{function}() {{ compgen -W "{" ".join(names[key])}" -- "$1"; compgen -f -- "$1"; }}'
            for key, function in functions.items()
        ),
        "zsh": "\n".join(
            f"{function}() {{ compadd {' '.join(names[key])}; _files }}"
            for key, function in functions.items()
        ),
    }
    print(shtab.complete(parser, arguments.shell, preamble=preamble))
    return 0


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments of a parser and of its commands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in dict.fromkeys(action.choices.values()):
                yield from _actions(below)
        else:
            yield action
