"""Containment of the plant in the tube: fitted on some seeds, counted on others."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import astuple, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from ....testbed.recording.channels import TUBE
from ....testbed.recording.record import Record
from ...output import write_file
from ...results.statistics import proportion
from ...results.summary import Summary
from ...results.tracking_errors import START_UP_S, containment
from ...run.simulate import simulate
from ...scenario.scenario import Scenario
from ...scenario.tube_file import PointHalfWidths, TubeFile, read_tube, to_json
from ...seeds import FITTING, report_seeds
from ...studies.sweep.row import Row
from ...studies.sweep.study import Study
from ...studies.sweep.work import SweepJob, run_job
from ...studies.tubes.calibration import calibrate_tube, driven_run
from ...studies.tubes.fit import fit_run, fit_tube
from ..markdown import grouped, label, lost, mean, slash
from ..runner import Runner
from ..table import Table, study

DRIVER: Final = "ttempc-tube"
_LAP: Final = ("path.laps=1", f'controller.name="{DRIVER}"')
LARGEST: Final = tuple(f"largest_{field.name}" for field in fields(PointHalfWidths))
"""Columns of the largest deviations, in the order of the calibrated half widths [m]."""
LAPS: Final = 12  # fresh ones, of each field
FIT_SEEDS: Final = FITTING[:12]
CALIBRATION_SEEDS: Final = FITTING[12:36]
COVERAGE: Final = 0.95  # coverage that the calibration promises
BORROWED: Final = "grass-soil"  # whose tube the fields without one of their own drive in
OWN: Final[dict[str, tuple[str, ...]]] = {
    "grass-soil": ("grass",),
    "wet-grass-soil": ("wet-grass",),
    "side-slope-soil": ("side-slope",),
}
"""Scenario and changes of the fields to which a tube is fitted and calibrated."""

FIELDS: Final[dict[str, tuple[str, ...]]] = {
    **OWN,
    "grass-200kpa": ("grass", "soil.cone_index_kpa=200.0"),
    "grass-class-E": ("grass", 'terrain.iso_class="E"'),
    "grass-class-F": ("grass", 'terrain.iso_class="F"'),
    "grass-1.2mps": ("grass", "path.speed_mps=1.2"),
    "wet-grass-borrowed": OWN["wet-grass-soil"],
    "side-slope-borrowed": OWN["side-slope-soil"],
}
"""These, then soil, ground and speed that the tube of `grass-soil` was not fitted to."""


def _study(field: str, seeds: Sequence[int], *more: str) -> Study:
    """Return the study of the laps of a field."""
    scenario, *changes = FIELDS[field]
    return study(scenario, seeds, (*_LAP, *changes, *more))


def fitted(job: SweepJob) -> Row:
    """Fit a tube to laps of a field, calibrate it on more laps in it, and return its file's text.

    Raises:
        InvalidFit, InvalidTube: the laps give no tube.
    """

    def lap(seed: int, scenario: Scenario) -> tuple[Record, Scenario]:
        about = {"scenario": job.name, "controller": DRIVER, "seed": str(seed)}
        record = simulate(job.name, scenario, seed)[1]
        return replace(record, metadata=about), scenario

    tube = fit_tube([fit_run(*lap(seed, job.scenario)) for seed in FIT_SEEDS]).file
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{job.name}.json"
        file.write_text(to_json(tube), encoding="utf-8")
        controller = replace(job.scenario.controller, tube=str(file))
        in_it = replace(job.scenario, controller=controller)
        laps = [driven_run(*lap(seed, in_it)) for seed in CALIBRATION_SEEDS]
        text = to_json(calibrate_tube(laps, COVERAGE))
    return {**job.row("completed", None, {}, None), "tube": text}


def fresh_lap(job: SweepJob, summary: Summary, record: Record) -> dict[str, float]:
    """Return the counts of a lap in a tube."""
    found = containment(record)
    membership = record[TUBE]["inside"]
    across = [*found.ACROSS.values()]
    largest = np.abs(found.deviation[:, found.POINTS]).max(axis=0, initial=0.0)
    share = found.normalised_deviation.max(axis=0, initial=0.0)[across].max()
    return {
        "restarts": float((membership[record[TUBE].time_s >= START_UP_S] < 0.5).sum()),
        "share": float(share),
        "steps": float(len(found.margin)),
        "inside": float((found.margin >= 0.0).sum()),
        **dict(zip(LARGEST, largest.tolist(), strict=True)),
    }


FITS: Final = Table(
    name="tubes", studies={name: _study(name, (FITTING[0],)) for name in OWN}, work=fitted
)


def make(runner: Runner) -> str:
    """Fit and calibrate the tubes, drive the fresh laps; return their table."""
    made = runner.frame(FITS)
    folder = runner.folder.resolve() / "tubes"
    folder.mkdir(exist_ok=True)
    for name, text in zip(made["study"], made["tube"], strict=True):
        write_file(folder / f"{name}.json", text.encode())
    files = {name: folder / f"{name if name in OWN else BORROWED}.json" for name in FIELDS}
    seeds = report_seeds(LAPS)
    fresh = {name: _study(name, seeds, f'controller.tube="{file}"') for name, file in files.items()}
    measured = partial(run_job, measure=fresh_lap)
    laps = runner.frame(Table(name="containment", studies=fresh, work=measured))
    return lap_table(laps, {name: read_tube(str(file)) for name, file in files.items()})


def lap_table(laps: pd.DataFrame, tubes: Mapping[str, TubeFile]) -> str:
    """Return the table of the fields: steps and laps inside the tube and the calibrated widths.

    Args:
        laps: fresh laps, as of `fresh_lap`.
        tubes: that the laps of each field were driven in.
    """

    def completed(own: pd.DataFrame, kept: Any) -> str:  # noqa: ANN401 - booleans by lap
        return str(proportion(int((kept & (own["status"] == "completed")).sum()), len(own)))

    def widths(own: pd.DataFrame) -> PointHalfWidths:
        calibration = tubes[own["study"].iloc[0]].calibration
        assert calibration is not None
        return calibration.half_widths

    def calibrated(own: pd.DataFrame) -> str:
        kept = np.all(own[[*LARGEST]].to_numpy() <= astuple(widths(own)), axis=1)
        return completed(own, kept)

    cells = {
        "case": label("study", "`{}`"),
        "lost": lost,
        "steps with both points inside": lambda own: (
            f"{own['inside'].sum() / own['steps'].sum():.4f}"
        ),
        "laps wholly inside": lambda own: completed(own, own["inside"] == own["steps"]),
        "restarts a lap": mean("restarts", factor=1.0),
        "largest share of a cross-track half width": lambda own: f"{own['share'].max():.2f}",
        "calibrated across, tractor / trailer [cm]": lambda own: slash(
            (widths(own).tractor_across_m, widths(own).trailer_across_m)
        ),
        "laps inside the calibrated widths": calibrated,
    }
    return grouped(laps, ["study"], cells)


TABLES: Final = (
    Table(
        name="containment",
        seeds=report_seeds(LAPS),
        make=make,
        checks=tuple((name, DRIVER) for name in ("grass", "wet-grass", "side-slope")),
    ),
)
