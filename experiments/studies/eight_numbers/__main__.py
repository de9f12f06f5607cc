"""Eight published errors of one vehicle: fit of the field, and the search for one set for all.

    python -m experiments.studies.eight_numbers [fit|search|all] [--budget N] [--fit-budget N]
        [--folder runs/eight-numbers] [--workers N]

`fit` searches class, cone index and slope for the four errors of the linear MPC (`paper`), and
drives both controllers on the shipped field `kayacan2016`. `search` varies all of `parameters.py`
for the errors of both controllers (`paper`, `kayacan-nmpc`). Runs are kept in the folder: a command
that is repeated continues. A larger budget continues a smaller one. docs/errata.md has the tables.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ....testbed.recording.provenance import code_digest
from ..batch import BatchSettings, batch_settings
from .tables import BUDGET, FIT_BUDGET, STAGES, print_tables

FOLDER = Path("runs/eight-numbers")


def main(arguments: list[str] | None = None) -> None:
    """Print the tables of the stage that the command names."""
    parser = argparse.ArgumentParser(prog="python -m experiments.studies.eight_numbers")
    parser.add_argument("stage", nargs="?", choices=STAGES, default="all")
    parser.add_argument("--budget", type=int, default=BUDGET, help="sets for eight numbers")
    parser.add_argument("--fit-budget", type=int, default=FIT_BUDGET, help="fields for four")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of the runs that are kept")
    parser.add_argument("--workers", type=int, default=None, help="processes; 0: this one")
    given = parser.parse_args(arguments)
    for name in ("budget", "fit_budget"):
        if getattr(given, name) < 1:
            parser.error(
                f"--{name.replace('_', '-')}: got {getattr(given, name)}, must be 1 or more"
            )
    given.folder.mkdir(parents=True, exist_ok=True)
    kept = given.folder / f"{code_digest()}.pickle"
    with batch_settings(BatchSettings(given.workers, kept)):
        print_tables(given.stage, given.budget, given.fit_budget)


if __name__ == "__main__":
    main()
