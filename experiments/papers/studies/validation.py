"""Plant validation of every shipped scenario."""

import tempfile
from pathlib import Path
from typing import Final

import pandas as pd

from ...pictures.report.validation_report import figure_text, validation_report
from ...scenario.scenario import shipped
from ...seeds import report_seeds
from ...studies.sweep.row import Row
from ...studies.sweep.work import SweepJob
from ..markdown import markdown
from ..table import Table, listed, study


def validate(job: SweepJob) -> Row:
    """Return the counts and the failed checks of a scenario's plant; a failed check is no error."""
    with tempfile.TemporaryDirectory() as parent:
        found = validation_report(job.name, job.scenario, Path(parent) / "report")
    judged = [check for check in found.checks if check.passed is not None]
    failed = [check for check in judged if not check.passed]
    texts = (f"{each.name}: {figure_text(each)}, expected {each.expectation}" for each in failed)
    held = f"{len(judged) - len(failed)} of {len(judged)}"
    return {
        **job.row("completed", None, {}, None),
        "held": held,
        "failed checks": "; ".join(texts) or "nothing",
    }


def validations(rows: pd.DataFrame) -> str:
    """Return the failed checks of all plants."""
    name = "`" + rows["scenario"] + "`"
    heads = ["scenario", "checks that hold", "failed checks"]
    return markdown(heads, zip(name, rows["held"], rows["failed checks"], strict=True))


TABLES: Final = (
    Table(
        name="card",
        studies={
            "card": study("grass", report_seeds(1), (), listed("scenario", *shipped())),
        },
        work=validate,
        text=validations,
        checks=tuple((name, "ttempc") for name in shipped()),
    ),
)
