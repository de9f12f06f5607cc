"""Plant validation of every shipped scenario, and of `grass` with contact wheels."""

import tempfile
from pathlib import Path
from typing import Final

from ...pictures.report.validation_report import figure_text, validation_report
from ...scenario.scenario import load, shipped
from ..runner import Runner
from ..study import Study
from ..tables import markdown


def validate(plant: tuple[str, str]) -> list[str]:
    """Return the line of a scenario with its wheels; a failed check is no error."""
    name, wheels = plant
    scenario = load(name, [f'plant.wheels="{wheels}"'])[1]
    with tempfile.TemporaryDirectory() as parent:
        found = validation_report(name, scenario, Path(parent) / "report")
    judged = [check for check in found.checks if check.passed is not None]
    failed = "; ".join(
        f"{check.name}: {figure_text(check)}, expected {check.expectation}"
        for check in judged
        if not check.passed
    )
    held = sum(bool(check.passed) for check in judged)
    stem = name if wheels == "soil" else f"{name}-{wheels}"
    return [f"`{stem}`", f"{held} of {len(judged)}", failed or "nothing"]


def validations(runner: Runner) -> str:
    """Return the failed checks of all plants."""
    plants = [*((name, "soil") for name in shipped()), ("grass", "contact")]
    heads = ["scenario", "checks that hold", "failed checks"]
    return markdown(heads, runner.map(validate, plants))


STUDIES: Final = (
    Study(
        name="card",
        make=validations,
        checks=tuple((name, "ttempc") for name in shipped()),
    ),
)
