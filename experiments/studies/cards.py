"""Plant validation of every shipped scenario, as published in docs/card.

    python -m experiments.studies.cards DIR

Writes DIR/NAME.html and DIR/NAME.json, and prints a table with the failed checks. `grass` is
validated with contact wheels, too.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from ..scenario.scenario import load, shipped
from ..validation.validation_report import ValidationReport, figure_text, validation_report


def main(folder: Path) -> None:
    """Validate all plants and write the pages; a failed check is no error."""
    folder.mkdir(parents=True, exist_ok=True)
    print("| scenario | checks that hold | failed checks |\n|---|---|---|")
    for name, wheels in [*((name, "soil") for name in shipped()), ("grass", "contact")]:
        scenario = load(name, [f'plant.wheels="{wheels}"'])[1]
        with tempfile.TemporaryDirectory() as parent:
            output = Path(parent) / "card"
            card = validation_report(name, scenario, output)
            stem = name if wheels == "soil" else f"{name}-{wheels}"
            for suffix in ("html", "json"):
                content = (output / f"validation.{suffix}").read_bytes()
                (folder / f"{stem}.{suffix}").write_bytes(content)
        print(_row(stem, card), flush=True)


def _row(stem: str, card: ValidationReport) -> str:
    judged = [check for check in card.checks if check.passed is not None]
    failed = "; ".join(
        f"{check.name}: {figure_text(check)}, expected {check.expectation}"
        for check in judged
        if not check.passed
    )
    held = sum(bool(check.passed) for check in judged)
    return f"| [{stem}]({stem}.html) | {held} of {len(judged)} | {failed or 'nothing'} |"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
