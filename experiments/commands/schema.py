"""`ttempc schema`: print the JSON schema of a scenario, or its reference as a page."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from ..output import refuse_existing, write_file

ABOUT = """\
Prints the JSON schema of a scenario file (draft 2020-12): every key with its type,
range, default, unit and meaning. An editor with TOML completion reads it from the
first line of a scenario:

  ttempc schema -o scenario.schema.json
  #:schema ./scenario.schema.json        (Taplo, Even Better TOML)
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "--markdown", action="store_true", help="the same as a page: a row for each key"
    )
    parser.add_argument(
        "-o", "--out", type=Path, metavar="FILE", help="file to write (default: print)"
    )
    parser.set_defaults(command=_schema)


def _schema(arguments: argparse.Namespace) -> int:
    if arguments.out:
        refuse_existing(arguments.out)
    # Imported here so that --help does not load pydantic.
    from ..scenario.schema import json_schema, scenario_reference

    if arguments.markdown:
        text = scenario_reference()
    else:
        text = json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"
    if arguments.out:
        write_file(arguments.out, text)
    else:
        print(text, end="")
    return 0
