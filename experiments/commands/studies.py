"""`ttempc sweep`, `ttempc search` and `ttempc bench`: many runs in parallel."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import BadOptions
from ..output import progress, refuse_existing, write_file
from ..seeds import report_seeds
from . import options
from .options import Group, command, option, out, refuse_given

if TYPE_CHECKING:
    from ..studies.search.limit import Limit
    from ..studies.search.rays import Report
    from ..studies.sweep.merge import Shard
    from ..studies.sweep.plan import SweepPlan
    from ..studies.sweep.sweep import Progress


def _share(text: str) -> Shard:
    """Read a share K/N of a sweep for `argparse`."""
    from ..studies.sweep.merge import Shard

    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise argparse.ArgumentTypeError(f"must be K/N with K from 1 to N, got {text!r}")
    return Shard(int(number), int(count))


@command(
    option("study", metavar="STUDY", help="name of a shipped study or a .toml file"),
    out("DIR", "to make or to continue; default: runs/sweep-STUDY"),
    *options.ENGINE,
    options.TRUST,
    options.QUIET,
    option(
        "--dry-run",
        action="store_true",
        help="check the plan, print it, its size and an estimate of time; write nothing",
        group="action",
    ),
    option(
        "--shard",
        type=_share,
        metavar="K/N",
        help="drive the K-th of N shares, each on a machine and into a folder of its own",
    ),
    option(
        "--merge",
        nargs="+",
        type=Path,
        metavar="FOLDER",
        help="take the rows of these folders of the same study into DIR; no run is made",
        group="action",
    ),
)
def sweep(arguments: argparse.Namespace) -> int:
    """Drive all runs of a study in parallel and write into DIR:

      results.jsonl   one row per run, written when it ends; opens in pandas and polars
      study.toml      the study, resolved      versions.json   of the software
      logs/           the logs that the study keeps

    The same command continues an interrupted sweep; a study may grow. Exit code 0 if every
    run has a row, whatever its status, 130 if the sweep was interrupted. Two machines:

      ttempc sweep STUDY --shard 1/2 -o one     (and 2/2 -o two on the other)
      ttempc sweep STUDY --merge one two -o all
    """
    # Imported here so that --help does not load MuJoCo and Dask.
    from ..studies.sweep.dry_run import format_plan
    from ..studies.sweep.estimate import format_time
    from ..studies.sweep.folder import is_begun
    from ..studies.sweep.plan import SweepPlan
    from ..studies.sweep.study import load_study

    name, study = load_study(arguments.study)
    plan = SweepPlan(name, study, trusted=arguments.trust)
    extent = plan.extent()
    folder = arguments.out or Path("runs") / f"sweep-{name}"
    if arguments.dry_run or not (is_begun(folder) or arguments.quiet):
        for reason in extent.refused:
            print(f"ttempc: note: left out: {reason}", file=sys.stderr)

    if arguments.dry_run:
        print(f"{format_plan(plan)}\nestimate  {format_time(plan, _workers(arguments))}")
        return 0
    if arguments.merge:
        return _merge(plan, folder, arguments.merge, extent.runs)
    return _resumable(lambda: _drive(arguments, plan, folder, extent.runs), folder)


def _workers(arguments: argparse.Namespace) -> int:
    """Return how many runs are driven at a time on this machine."""
    from ..studies.sweep.engine import cores

    return cores() if arguments.workers is None else max(1, arguments.workers)


def _merge(plan: SweepPlan, folder: Path, sources: Sequence[Path], runs: int) -> int:
    """Take the rows of the folders of shares into one, and say how many of the runs are missing."""
    from ..studies.sweep.folder import lock_folder
    from ..studies.sweep.merge import merge

    with lock_folder(folder, plan) as locked:
        missing = merge(plan, locked, sources)
    rest = f"; {missing} runs are missing: the same command without --merge drives them"
    print(f"{runs - missing} rows    {folder / 'results.jsonl'}{rest if missing else ''}")
    return 0


def _drive(arguments: argparse.Namespace, plan: SweepPlan, folder: Path, runs: int) -> None:
    """Drive what has no row yet of all `runs` of a sweep, or of a share of them."""
    from ..studies.sweep.engine import engine
    from ..studies.sweep.estimate import MOST_UNTOLD, format_time
    from ..studies.sweep.folder import is_begun, lock_folder
    from ..studies.sweep.merge import WHOLE
    from ..studies.sweep.results import rows
    from ..studies.sweep.sweep import sweep

    shard = arguments.shard or WHOLE
    count = sum(1 for _ in shard.runs(plan))
    if count > MOST_UNTOLD and not (arguments.quiet or arguments.dask or is_begun(folder)):
        of = f" (all {runs} runs, of which here {count})" if count < runs else ""
        print(
            f"ttempc: takes {format_time(plan, _workers(arguments))}{of}",
            file=sys.stderr,
            flush=True,
        )

    with (
        engine(arguments.workers, arguments.dask) as submit,
        lock_folder(folder, plan) as locked,
        progress(count, plan.name, "run", shown=not arguments.quiet) as tell,
    ):
        sweep(plan, locked, submit, _counted(tell), shard=shard)
    if not arguments.quiet:
        counts = Counter(str(row["status"]) for row in rows(folder / "results.jsonl"))
        by_status = ", ".join(f"{count} {status}" for status, count in counts.most_common())
        print(f"{counts.total()} runs: {by_status}\nrows      {folder / 'results.jsonl'}")


def _counted(count: Callable[[], object]) -> Callable[[Progress], None]:
    """Return a function that counts the runs that ended."""
    seen = 0

    def show(progress: Progress) -> None:
        nonlocal seen
        for _ in range(progress.done - seen):
            count()
        seen = progress.done

    return show


def _resumable(work: Callable[[], None], folder: Path) -> int:
    """Work; where it is interrupted after the folder was made, say how it goes on."""
    try:
        work()
    except KeyboardInterrupt:
        if not folder.exists():
            raise
        print(f"ttempc: interrupted; the same command carries on in {folder}", file=sys.stderr)
        return options.EXIT_INTERRUPTED
    return 0


_REQUIRED_SCENARIO = options.SCENARIO.but(nargs=None, default=None, help="name or .toml file")


@command(
    _REQUIRED_SCENARIO,
    option("quantity", metavar="QUANTITY", help="quantity to make harder"),
    out("FILE", "default: a new one in runs/"),
    *options.CHANGES,
    options.CONTROLLER.but(action="append", help="may be repeated (default: the scenario's)"),
    option(
        "--seeds",
        type=options.whole_number(1, 1000),
        default=3,
        metavar="N",
        help="runs per value, with the first N seeds of reported runs, from 201 on (default: 3)",
    ),
    options.LIMIT,
    *options.ENGINE,
)
def limit(arguments: argparse.Namespace) -> int:
    """Find the value of a quantity at which a controller begins to fail.

    At a value it fails if at least half of the seeds terminate early or exceed --limit.
    Scans the whole range, then bisects. Prints one line per controller and writes every
    value that was tried to a JSON file.
    """
    # Imported here so that --help does not load MuJoCo and Dask.
    from ..run.user_code import named_parts, refuse_untrusted
    from ..scenario.scenario import read_scenario
    from ..studies.search.limit import limit_file, read_question
    from ..studies.sweep.engine import engine

    draft = read_scenario(arguments.scenario)
    name = arguments.quantity.partition("=")[0]
    file = arguments.out or options.unused_path(Path("runs"), f"limit-{draft.name}-{name}", ".json")
    refuse_existing(file)
    questions = []
    seeds = report_seeds(arguments.seeds)
    for controller in arguments.controller or [None]:
        changes = options.scenario_changes(arguments.overrides, controller)
        scenario = draft.scenario(changes, "--set")
        if not arguments.trust:
            refuse_untrusted(draft.file, named_parts(scenario), changes)
        asked = arguments.scenario, changes, arguments.quantity, seeds, arguments.limit
        questions.append(read_question(draft, *asked))

    def show(found: Limit) -> None:
        print(found, flush=True)

    with engine(arguments.workers, arguments.dask) as workers:
        limit_file(questions, workers, file, show)
    print(f"values    {file}")
    return 0


@command(
    _REQUIRED_SCENARIO,
    option("quantity", nargs="+", metavar="QUANTITY", help="quantity to search"),
    out("DIR", "to make or to continue; default: runs/rays-SCENARIO-CONTROLLER"),
    *options.CHANGES,
    options.CONTROLLER,
    options.SEED,
    option(
        "--rays",
        type=options.whole_number(1, 10_000),
        default=50,
        metavar="N",
        help="rays from the nominal values to the bounds, six runs each at most (default: 50)",
    ),
    options.LIMIT,
    *options.ENGINE,
)
def rays(arguments: argparse.Namespace) -> int:
    """Find the severity at which a controller fails, along rays through several quantities.

    A run fails if it terminates early, leaves the corridor, or exceeds --limit. Severity is
    the share of the way from the nominal values to the first bound. The rays follow from the
    seed: under one seed they are the same for every controller. Writes into DIR rays.json,
    worst.toml, the least severe failure, which `ttempc run` replays, and the rows of all
    runs. The same command continues an interrupted search.
    """
    # Imported here so that --help does not load MuJoCo and Dask.
    from ..run.assembly import check
    from ..scenario.scenario import read_scenario
    from ..studies.search.quantities import read_subject
    from ..studies.search.rays import STEPS, search_rays
    from ..studies.sweep.engine import engine

    name, scenario = options.load_scenario(arguments)
    check(scenario)
    changes = options.scenario_changes(arguments.overrides, arguments.controller)
    draft = read_scenario(arguments.scenario)
    subject = read_subject(draft, arguments.scenario, changes, arguments.quantity)
    controller = scenario.controller.name.replace(":", "-")
    folder: Path = arguments.out or Path("runs") / f"rays-{name}-{controller}"

    def drive() -> None:
        most = 1 + arguments.rays * (1 + STEPS)
        with (
            engine(arguments.workers, arguments.dask) as workers,
            progress(most, f"rays of {name}", "run", shown=True) as count,
        ):
            asked = arguments.seed, arguments.rays, arguments.limit
            report = search_rays(subject, workers, *asked, folder, count)
        print(_text(report, folder), end="")

    return _resumable(drive, folder)


_SEVERITIES = (0.25, 0.5, 0.75)  # of the shares that are printed

search = Group(
    """\
Search quantities of a scenario for failures of a controller. QUANTITY is one of

  cone-index slope speed delay roughness
  KEY=LOW:HIGH      a key of the scenario, e.g. soil.cone_index_kpa=200:600

and of `rays` also

  KEY=LOW:HIGH:free a key without severity, e.g. terrain.uphill_deg=0:360:free
  gust ditch soil_patch gnss_float angle_noise gnss_out commands_late
  front_steering_stuck trailer_steering_stuck
                    a fault of this kind (of [[faults]]), anywhere on the path

  ttempc search limit grass slope --controller pid --controller ttempc --limit 0.3
  ttempc search limit my-gusty-field.toml faults.gust.force_n=100:4000
  ttempc search rays rows gust soil_patch
""",
    {"limit": limit, "rays": rays},
)


def _text(report: Report, folder: Path) -> str:
    """Return the report as lines of text, with the command that replays its case."""
    count = len(report.rays)
    shares = ", ".join(f"{100 * report.survived(x) / count:.0f} % at {x:g}" for x in _SEVERITIES)
    lines = [
        f"{report.controller} on {report.scenario}, seed {report.seed}: {report.survived(1.0)} of "
        f"{count} rays hold to their ends ({shares})"
    ]
    if report.least is not None:
        ray = report.rays[report.least]
        values = ", ".join(
            f"{key} = {value:g}" if isinstance(value, float) else f"{key} = {value}"
            for key, value in report.values.items()
        )
        replay = f"{folder / 'worst.toml'} --seed {report.seed} --out {folder / 'worst'}"
        least = f"severity {ray.fails:.3f} (holds at {ray.holds:.3f}): {ray.failure}"
        lines += [least, f"  {values}", f"  ttempc run {replay}"]
    return "\n".join([*lines, f"report    {folder / 'rays.json'}"]) + "\n"


@command(
    option(
        "controller",
        nargs="?",
        metavar="CONTROLLER",
        help="name of a shipped controller, or package.module:factory of your own",
    ),
    options.SET.but(
        help="a value of [controller], such as controller.options.horizon=20; may be repeated"
    ),
    option("--quick", action="store_true", help="one seed: a minute, no intervals"),
    option("--seeds-file", type=Path, metavar="FILE", help="hidden seeds"),
    *options.ENGINE,
    out("DIR|FILE", "to make or to continue; default: runs/bench-CONTROLLER"),
    option(
        "--compare",
        nargs=2,
        type=Path,
        metavar=("A", "B"),
        help="compare two score cards by scenario and seed; no run is made",
        group="action",
    ),
    option(
        "--draw-seeds", action="store_true", help="write hidden seeds to FILE, print their hash"
    ),
)
def bench(arguments: argparse.Namespace) -> int:
    """Drive a controller through the benchmark: frozen scenarios with public seeds. Print
    its score card and write into DIR:

      score.json                                  the card, for --compare and the leaderboard
      results.jsonl, study.toml, versions.json    the rows, as of a sweep

    The same command continues an interrupted benchmark. An organiser draws seeds with
    --draw-seeds, publishes the hash that it prints, and reruns entries with --seeds-file.
    """
    asked = [arguments.controller, arguments.compare, arguments.draw_seeds]
    if sum(map(bool, asked)) != 1:
        raise BadOptions("bench: give CONTROLLER, or one of --compare, --draw-seeds")
    # Imported here so that --help does not load MuJoCo and Dask.
    from ..studies.trials.score_card import (
        compare_cards,
        draw_hidden,
        format_comparison,
        read_score_card,
    )

    if arguments.compare:
        print(format_comparison(compare_cards(*map(read_score_card, arguments.compare))))
    elif arguments.draw_seeds:
        if arguments.out is None:
            raise BadOptions("bench: --draw-seeds needs -o FILE")
        print(f"{draw_hidden(arguments.out).sha256}  {arguments.out}")
    else:
        return _bench(arguments)
    return 0


def _bench(arguments: argparse.Namespace) -> int:
    from ..studies.sweep.engine import engine
    from ..studies.trials.bench import Entrant, bench
    from ..studies.trials.score_card import PUBLIC, format_card, hidden_draws, public_draws

    if arguments.seeds_file is None:
        draws = public_draws(PUBLIC[:1] if arguments.quick else PUBLIC)
    else:
        refuse_given(arguments, ("quick",), "not with --seeds-file")
        draws = hidden_draws(arguments.seeds_file)
    entrant = Entrant.of(arguments.controller, arguments.overrides)
    runs = entrant.plan(draws).size  # refused here, before workers start
    ending = "" if draws.kind == "public" else f"-{draws.kind}"
    folder = arguments.out or Path("runs") / f"bench-{entrant.stem}{ending}"

    def drive() -> None:
        with (
            engine(arguments.workers, arguments.dask) as workers,
            progress(runs, f"bench {entrant.stem}", "run", shown=True) as count,
        ):
            card = bench(entrant, draws, folder, workers, _counted(count))
        write_file(folder / "score.json", card.to_json())
        if "+" in card.identifier:
            note = "the plant of this code is not that of the benchmark"
            print(f"ttempc: note: {note}", file=sys.stderr)
        print(f"{format_card(card)}\ncard {folder / 'score.json'}")

    return _resumable(drive, folder)
