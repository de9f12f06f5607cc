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
from ..validation.plant_validation import PlantValidation, figure_text
from ..validation.validation_report import write_plant_validation


def main(folder: Path) -> None:
    """Validate all plants and write the pages; a failed check is no error."""
    folder.mkdir(parents=True, exist_ok=True)
    print("| scenario | checks that hold | failed checks |\n|---|---|---|")
    for name, wheels in [*((name, "soil") for name in shipped()), ("grass", "contact")]:
        scenario = load(name, [f'plant.wheels="{wheels}"'])[1]
        with tempfile.TemporaryDirectory() as parent:
            output = Path(parent) / "card"
            card = write_plant_validation(name, scenario, output, lambda check: None)
            stem = name if wheels == "soil" else f"{name}-{wheels}"
            for suffix in ("html", "json"):
                content = (output / f"card.{suffix}").read_bytes()
                (folder / f"{stem}.{suffix}").write_bytes(content)
        print(_row(stem, card), flush=True)


def _row(stem: str, card: PlantValidation) -> str:
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
