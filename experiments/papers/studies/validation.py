"""Plant validation of every shipped scenario, and of `grass` with contact wheels."""

import tempfile
from pathlib import Path
from typing import Final

from ...pictures.report.validation_report import figure_text, validation_report
from ...scenario.scenario import load, shipped
from ..runner import Runner
from ..study import Block, Study
from ..tables import markdown


def validate(plant: tuple[str, str]) -> tuple[list[str], dict[str, bytes]]:
    """Return the line of a scenario with its wheels, and its pages; a failed check is no error."""
    name, wheels = plant
    stem = name if wheels == "soil" else f"{name}-{wheels}"
    scenario = load(name, [f'plant.wheels="{wheels}"'])[1]
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "report"
        found = validation_report(name, scenario, folder)
        kinds = ("html", "json")
        files = {
            f"card/{stem}.{kind}": (folder / f"validation.{kind}").read_bytes() for kind in kinds
        }
    judged = [check for check in found.checks if check.passed is not None]
    failed = "; ".join(
        f"{check.name}: {figure_text(check)}, expected {check.expectation}"
        for check in judged
        if not check.passed
    )
    held = sum(bool(check.passed) for check in judged)
    return [f"[{stem}](card/{stem}.html)", f"{held} of {len(judged)}", failed or "nothing"], files


def validations(runner: Runner) -> Block:
    """Return the failed checks of all plants, and the pages of all checks."""
    plants = [*((name, "soil") for name in shipped()), ("grass", "contact")]
    found = runner.map(validate, plants)
    heads = ["scenario", "checks that hold", "failed checks"]
    files = {name: content for _, own in found for name, content in own.items()}
    return Block(markdown(heads, [line for line, _ in found]), files)


STUDIES: Final = (
    Study(
        name="card",
        make=validations,
        checks=tuple((name, "ttempc") for name in shipped()),
    ),
)
