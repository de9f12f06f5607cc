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

from .. import batch
from .runs import RunStore
from .study import BOTH, LMPC_ON_FIELD, ONE_LAP, find, shipped_field_cm
from .tables import fit_table, search_table

STAGES = ("fit", "search", "all")
FOLDER = Path("runs/eight-numbers")
BUDGET, FIT_BUDGET = 80, 32


def markdown(
    stage: str = "all",
    budget: int = BUDGET,
    fit_budget: int = FIT_BUDGET,
    folder: Path = FOLDER,
    workers: int | None = None,
    path: tuple[str, ...] | None = None,
) -> str:
    """Return the tables of a stage; `path` overrides that of every run.

    Raises:
        SweepRefused: the folder holds runs of another version of the code.
    """
    parts = []
    with batch.engine(workers) as engine:
        store = RunStore(folder / "runs.jsonl", engine)
        if stage in ("fit", "all"):
            fit = find(LMPC_ON_FIELD, store, fit_budget, path or ONE_LAP)
            parts.append(fit_table(fit, shipped_field_cm(store, path or ())))
        if stage in ("search", "all"):
            parts.append(search_table(find(BOTH, store, budget, path or ONE_LAP)))
    return "\n\n".join(parts)


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
    print(markdown(given.stage, given.budget, given.fit_budget, given.folder, given.workers))


if __name__ == "__main__":
    main()
