"""Run benchmarks, print one table, and write it as JSON.

    python -m proving_ground.experiments.benchmarks [PART ...] [--out FILE] [--record]

The exit code is 0; a figure beyond its limit is marked as missed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ..threads import use_one_thread


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print and write."""
    use_one_thread()  # as the command line, and likewise before numpy loads
    from .figure import RELEASED
    from .performance import PARTS, measure

    parser = argparse.ArgumentParser(prog="benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"all, or of {', '.join(PARTS)}")
    parser.add_argument("--out", type=Path, default=Path("runs/benchmarks.json"), metavar="FILE")
    parser.add_argument(
        "--record", action="store_true", help="keep the figures as those of a release"
    )
    given = parser.parse_args(arguments)
    if unknown := [part for part in given.parts if part not in PARTS]:
        parser.error(f"{unknown[0]}: must be one of {', '.join(PARTS)}")
    if given.record and given.parts:
        parser.error("--record: a release has all parts; name none")
    performance = measure(given.parts, lambda part: print(part, file=sys.stderr))
    print(performance.table())
    files = [given.out, *([RELEASED] if given.record else [])]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(performance.json(), encoding="utf-8")


if __name__ == "__main__":
    main()
