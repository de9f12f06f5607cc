"""Every controller on every shipped scenario: tracking error against computation time.

    python -m experiments.studies.compare drive rows.jsonl [--controllers paper,nmpc]
        [--scenarios grass,farm] [--seeds 1-10] [--laps 1] [--processes 2]
    python -m experiments.studies.compare draw rows.jsonl [--against ttempc] [--out docs]

`drive` appends a row to the file for every run as it ends and leaves out the runs whose rows are
there: break it off and start it again, with more seeds or controllers if you like. The columns are
those of a sweep (`experiments.sweep.row`). `draw` writes compare.md and compare.png.

Seeds are paired: all controllers meet the same ground and the same noise. Costs are medians of
the control step as the loop measures it, the caches cold from a period of physics; run as many
processes as there are idle cores, or they measure each other.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from ttempc.errors import TtempcError
from ttempc.guidance.controllers import CONTROLLERS

from ..errors import ExperimentError, InvalidRows
from ..run.assembly import assemble
from ..scenario.scenario import load, shipped
from ..sweep.row import Row, figures, line
from .batch import Job, as_they_end
from .comparison import Comparison, markdown, picture


def jobs(
    controllers: Sequence[str], scenarios: Sequence[str], seeds: Sequence[int], laps: int | None
) -> Iterator[Job]:
    """Yield the runs, one seed of all before the next, so that a part is a fair part."""
    for seed in seeds:
        for scenario in scenarios:
            eight = load(scenario, [])[1].path.kind == "figure-eight"
            length = (f"path.laps={laps}",) if laps is not None and eight else ()
            for controller in controllers:
                yield Job(scenario, seed, (f'controller.name="{controller}"', *length))


def possible(wanted: Sequence[Job]) -> list[Job]:
    """Return the jobs that can be driven; say which scenario refuses which controller, and why.

    A tube is fitted for one vehicle, so not every controller drives every scenario.

    Raises:
        ExperimentError, TtempcError: what a controller says that no scenario takes.
    """
    refusals: dict[tuple[str, tuple[str, ...]], ExperimentError | TtempcError] = {}
    driven: set[str] = set()  # controllers that some scenario takes
    for key, job in {(job.scenario, job.overrides): job for job in wanted}.items():
        try:
            assemble(load(job.scenario, job.overrides)[1], job.seed)
        except (ExperimentError, TtempcError) as error:
            refusals[key] = error
        else:
            driven.add(job.overrides[0])
    for (_, (controller, *_)), error in refusals.items():
        if controller not in driven:
            raise error
    for (scenario, (controller, *_)), error in refusals.items():
        print(f"left out: {controller} on {scenario}: {error}", file=sys.stderr)
    return [job for job in wanted if (job.scenario, job.overrides) not in refusals]


def read(file: Path) -> list[Row]:
    """Return the rows of a file, none where it does not exist.

    Raises:
        InvalidRows: a line is no row, as one that was torn.
    """
    if not file.exists():
        return []
    rows = []
    for number, text in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            rows.append(json.loads(text))
        except json.JSONDecodeError:
            raise InvalidRows(f"{file}, line {number}: not a row; remove the line") from None
    return rows


def drive(file: Path, wanted: Sequence[Job], processes: int | None) -> None:
    """Append the rows of those jobs that are not in the file yet."""
    there = {(row["scenario"], row["seed"], row["overrides"]) for row in read(file)}
    missing = [job for job in wanted if (job.scenario, job.seed, _text(job)) not in there]
    print(f"{len(wanted) - len(missing)} runs in {file}, {len(missing)} to make", file=sys.stderr)
    with file.open("a", encoding="utf-8") as out:
        for job, summary in as_they_end(missing, processes):
            row: Row = {
                "run_id": summary.run_id,
                "scenario": job.scenario,
                "controller": summary.controller,
                "seed": job.seed,
                "overrides": _text(job),
                "status": summary.status,
                "failure": summary.failure or "",
                **figures(summary),
            }
            out.write(line(row))
            out.flush()


def _text(job: Job) -> str:
    return " ".join(job.overrides)


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive or draw; return the exit code."""
    parsed = _parser().parse_args(arguments)
    try:
        if parsed.what == "drive":
            wanted = jobs(parsed.controllers, parsed.scenarios, parsed.seeds, parsed.laps)
            drive(parsed.file, possible(list(wanted)), parsed.processes)
        else:
            comparison = Comparison.of(read(parsed.file), parsed.against)
            (parsed.out / "compare.png").write_bytes(picture(comparison))
            (parsed.out / "compare.md").write_text(markdown(comparison), encoding="utf-8")
    except (ExperimentError, TtempcError) as error:
        print(f"compare: error: {error}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.studies.compare")
    commands = parser.add_subparsers(dest="what", required=True)
    driving = commands.add_parser("drive", help="make the runs that are missing in a file")
    driving.add_argument("file", type=Path)
    driving.add_argument("--controllers", type=_names, default=list(CONTROLLERS))
    driving.add_argument("--scenarios", type=_names, default=list(shipped()))
    driving.add_argument("--seeds", type=_seeds, default=_seeds("1-10"), help="as 1-10 or 3,5")
    driving.add_argument(
        "--laps", type=_positive, help="of the figure eight (default: the scenario's)"
    )
    driving.add_argument("--processes", type=_positive, help="side by side (default: one a core)")
    drawing = commands.add_parser("draw", help="make table and figure of a file")
    drawing.add_argument("file", type=Path)
    drawing.add_argument("--against", default="ttempc", help="whom to compare with")
    drawing.add_argument("--out", type=Path, default=Path("docs"), help="folder (default: docs)")
    return parser


def _positive(text: str) -> int:
    if int(text) < 1:
        raise ValueError
    return int(text)


def _names(text: str) -> list[str]:
    return text.split(",")


def _seeds(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last) + 1)) if last else [int(s) for s in text.split(",")]


if __name__ == "__main__":
    sys.exit(main())
