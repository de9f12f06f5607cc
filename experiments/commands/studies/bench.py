"""`ttempc bench`: field trials of a controller."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .. import options

if TYPE_CHECKING:
    from ...sweep.sweep import Progress
    from ...trials.score_card import Draws

ABOUT = """\
Drives a controller through the field trials: frozen scenarios with public seeds. Prints
its score card and writes into DIR:

  score.json   the card, for --compare and the leaderboard     score.html   as a page
  results.jsonl, study.toml, versions.json                     the rows, as of a sweep

The same command continues an interrupted bench. An organiser draws seeds with
--draw-seeds, publishes the hash that it prints, and reruns entries with --seeds-file;
their cards hold the hash, not the seeds. docs/field-trials.md defines the score.

Exit code 0 if every run has a row, whatever its status, 2 for bad input (one line; no
run is made), 130 if the bench was interrupted.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "controller",
        nargs="?",
        metavar="CONTROLLER",
        help="name of a shipped controller, or package.module:factory of your own",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="a value of [controller], such as controller.options.horizon=20; may be repeated",
    )
    parser.add_argument("--quick", action="store_true", help="one seed: a minute, no intervals")
    parser.add_argument("--seeds-file", type=Path, metavar="FILE", help="hidden seeds")
    options.add_workers(parser)
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make or to continue (default: runs/bench-CONTROLLER)",
    )
    options.add_json(parser, "the score card or the comparison")
    parser.add_argument(
        "--compare",
        nargs=2,
        type=Path,
        metavar=("A", "B"),
        help="compare two score cards by trial and seed; no run is made",
    )
    parser.add_argument(
        "--draw-seeds", type=Path, metavar="FILE", help="write hidden seeds, print their hash"
    )
    parser.add_argument("--schema", action="store_true", help="print the JSON schema of score.json")
    parser.set_defaults(command=_bench)


def _bench(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and Dask.
    from ...errors import BadOptions

    asked = [arguments.controller, arguments.compare, arguments.draw_seeds, arguments.schema]
    if sum(map(bool, asked)) != 1:
        raise BadOptions("bench: give CONTROLLER, or one of --compare, --draw-seeds, --schema")
    if arguments.compare:
        from ...trials.score_card import compare_cards, read_score_card
        from ...trials.tables import format_comparison

        found = compare_cards(*map(read_score_card, arguments.compare))
        print(json.dumps(found, indent=1) if arguments.json else format_comparison(found))
    elif arguments.draw_seeds:
        from ...trials.score_card import draw_hidden

        print(f"{draw_hidden(arguments.draw_seeds).sha256}  {arguments.draw_seeds}")
    elif arguments.schema:
        from ...trials.score_card import card_schema

        print(json.dumps(card_schema(), indent=2))
    else:
        return _drive(arguments)
    return 0


def _drive(arguments: argparse.Namespace) -> int:
    from ...output import write_file
    from ...sweep.engine import engine
    from ...trials.bench import Entrant, bench
    from ...trials.tables import card_page, format_card

    draws = _draws(arguments)
    entrant = Entrant.of(arguments.controller, arguments.overrides)
    entrant.plan(draws)  # refused here, before workers start
    ending = "" if draws.kind == "public" else f"-{draws.kind}"
    folder = arguments.out or Path("runs") / f"bench-{entrant.stem}{ending}"
    started = False
    try:
        with engine(arguments.workers, arguments.dask) as workers:
            started = True
            card = bench(entrant, draws, folder, workers, _report)
    except KeyboardInterrupt:
        if not started:
            raise
        print(f"ttempc: interrupted; the same command carries on in {folder}", file=sys.stderr)
        return options.EXIT_INTERRUPTED
    text = card.to_json()
    write_file(folder / "score.json", text)
    write_file(folder / "score.html", card_page(card))
    if "+" in card.identifier:
        print("ttempc: note: the plant of this code is not that of the trials", file=sys.stderr)
    if arguments.json:
        print(text, end="")
    else:
        print(f"{format_card(card)}\ncard      {folder / 'score.json'}")
        print(f"page      {folder / 'score.html'}")
    return 0


def _draws(arguments: argparse.Namespace) -> Draws:
    """Return the seeds of the bench.

    Raises:
        BadOptions: they are given twice, or the file is not understood.
    """
    from ...errors import BadOptions
    from ...trials.score_card import PUBLIC, hidden_draws, public_draws

    if arguments.seeds_file is None:
        return public_draws(PUBLIC[:1] if arguments.quick else PUBLIC)
    if arguments.quick:
        raise BadOptions("bench: --quick and --seeds-file exclude each other")
    return hidden_draws(arguments.seeds_file)


def _report(progress: Progress) -> None:
    if progress.done % max(1, progress.runs // 10) == 0:
        print(f"{progress.done} of {progress.runs} runs", file=sys.stderr, flush=True)
