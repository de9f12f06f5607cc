"""Containment of the plant in the tube: fitted on some seeds, counted on others."""

from collections.abc import Mapping
from dataclasses import astuple, replace
from typing import Any, Final

import numpy as np
import pandas as pd

from ....testbed.recording.channels import TUBE
from ....testbed.recording.record import Record
from ...results.statistics import proportion
from ...results.tracking_errors import START_UP_S, containment
from ...run.simulate import simulate
from ...scenario.scenario import Scenario, load
from ...scenario.tube_file import PointHalfWidths, TubeFile, read_tube, to_json
from ...seeds import FITTING, report_seeds
from ...studies.tubes.calibration import calibrate_tube, driven_run
from ...studies.tubes.fit import fit_run, fit_tube
from ..runner import Runner
from ..study import Case, Row, Study
from ..tables import grouped, label, lost, mean, slash

DRIVER: Final = "ttempc-tube"
LAPS: Final = 12  # fresh ones, of each field
FIT_SEEDS: Final = FITTING[:12]
CALIBRATION_SEEDS: Final = FITTING[12:36]
COVERAGE: Final = 0.95  # of the calibration
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


def _case(field: str, seed: int, *more: str, **labels: Any) -> Case:  # noqa: ANN401
    scenario, *changes = FIELDS[field]
    changes = ("path.laps=1", *changes, f'controller.name="{DRIVER}"', *more)
    return Case(scenario, seed, changes, {"field": field, **labels})


def _lap(case: Case, seed: int, *more: str) -> tuple[Record, Scenario]:
    name, scenario = load(case.scenario, (*case.overrides, *more))
    about = {"scenario": name, "controller": DRIVER, "seed": str(seed)}
    return replace(simulate(name, scenario, seed)[1], metadata=about), scenario


def fitted(case: Case) -> Row:
    """Fit a tube to laps of a field, calibrate it on more laps in it, and return its file's text.

    Raises:
        InvalidFit, InvalidTube: the laps give no tube.
    """
    file = case["folder"] / f"{case['field']}.json"
    tube = fit_tube([fit_run(*_lap(case, seed)) for seed in case["fit"]]).file
    file.write_text(to_json(tube), encoding="utf-8")
    in_it = f'controller.tube="{file}"'
    laps = [driven_run(*_lap(case, seed, in_it)) for seed in case["calibrate"]]
    return {"tube": to_json(calibrate_tube(laps, COVERAGE))}


def fresh_lap(case: Case) -> Row:
    """Drive a lap in a tube and return its counts."""
    summary, record = simulate(*load(case.scenario, case.overrides), case.seed)
    found = containment(record)
    inside, membership = found.margin >= 0.0, record[TUBE]["inside"]
    across = [*found.ACROSS.values()]
    return {
        "status": summary.status,
        "restarts": int((membership[record[TUBE].time_s >= START_UP_S] < 0.5).sum()),
        "largest_m": np.abs(found.deviation[:, found.POINTS]).max(axis=0, initial=0.0),
        "share": found.normalised_deviation.max(axis=0, initial=0.0)[across].max(),
        "steps": len(inside),
        "inside": int(inside.sum()),
    }


def study(runner: Runner) -> str:
    """Fit and calibrate the tubes, drive the fresh laps; return their table."""
    folder = runner.kept().resolve()
    common = {"folder": folder, "fit": tuple(FIT_SEEDS), "calibrate": tuple(CALIBRATION_SEEDS)}
    made = runner.frame([_case(field, 0, **common) for field in OWN], fitted)
    for name, text in zip(made["field"], made["tube"], strict=True):
        (folder / f"{name}.json").write_text(text, encoding="utf-8")
    files = {name: folder / f"{name if name in OWN else BORROWED}.json" for name in FIELDS}
    fresh = [
        _case(field, seed, f'controller.tube="{file}"')
        for field, file in files.items()
        for seed in report_seeds(LAPS)
    ]
    laps = runner.frame(fresh, fresh_lap)
    tubes = {name: read_tube(str(file)) for name, file in files.items()}
    return lap_table(laps, tubes)


def lap_table(laps: pd.DataFrame, tubes: Mapping[str, TubeFile]) -> str:
    """Return the table of the fields: steps and laps inside the tube and the calibrated widths.

    Args:
        laps: fresh laps, as of `fresh_lap`.
        tubes: that the laps of each field were driven in.
    """

    def completed(own: pd.DataFrame, kept: Any) -> str:  # noqa: ANN401 - booleans by lap
        return str(proportion(int((kept & (own["status"] == "completed")).sum()), len(own)))

    def widths(own: pd.DataFrame) -> PointHalfWidths:
        calibration = tubes[own["field"].iloc[0]].calibration
        assert calibration is not None
        return calibration.half_widths

    def calibrated(own: pd.DataFrame) -> str:
        kept = np.all(np.array([*own["largest_m"]]) <= astuple(widths(own)), axis=1)
        return completed(own, kept)

    cells = {
        "case": label("field", "`{}`"),
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
    return grouped(laps, ["field"], cells)


STUDIES: Final = (
    Study(
        name="containment",
        seeds=report_seeds(LAPS),
        make=study,
        checks=tuple((name, DRIVER) for name in ("grass", "wet-grass", "side-slope")),
    ),
)
