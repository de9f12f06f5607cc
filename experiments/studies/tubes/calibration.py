"""Calibration of a tube on whole runs that were driven in it.

The half widths hold for the whole of the next run of the same scenario with a given probability:
split-conformal prediction, see `ttempc.tube.conformal`. The unit is the run, because the laps of a
run share their ground and their learnt noise: only runs of different seeds are exchangeable.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Final

import numpy as np

from ttempc.tube.conformal import Calibration, calibrate, fewest_scores, largest_score
from ttempc.tube.reference_tube import ReferenceTube
from ttempc.types import FloatArray

from ....testbed.recording.channels import TUBE
from ....testbed.recording.provenance import versions
from ....testbed.recording.record import Record
from ...errors import InvalidFit
from ...results.tracking_errors import QUANTITIES, Containment, containment
from ...scenario.plant import PAPER_PERIOD_S
from ...scenario.scenario import Scenario
from ...scenario.tube_file import PointHalfWidths, RunCalibration, TubeFile, path_table, read_tube
from .fit import LoggedRun, logged_run, require_alike

SCALE_EVERY: Final = 5
"""Of five runs, the fifth gives the scale; the others are scored."""

_DIRECTIONS: Final = ("along", "across")
_SAME_TUBE: Final = 1e-3  # share of a half width; that of a log is rounded to single precision


@dataclass(frozen=True)
class DrivenRun(LoggedRun):
    """Deviations of one run that was driven in a tube, from its nominal state, after start-up."""

    largest: FloatArray  # (4,) largest absolute deviation, columns as `Containment.POINTS` [m]
    half_width: FloatArray  # (4,) of the tube at the first tick, before anything is learnt [m]


def driven_run(record: Record, scenario: Scenario) -> DrivenRun:
    """Return the deviations of a run."""
    run = logged_run(record, scenario)
    if not run.drives_in_a_tube:
        raise InvalidFit(f"{run.controller} does not drive in a tube")
    deviation = containment(record).deviation[:, Containment.POINTS]
    half_widths = record[TUBE].columns(*(f"{name}_half_width" for name in QUANTITIES))
    return DrivenRun(
        **vars(run),
        largest=np.abs(deviation).max(axis=0, initial=0.0),
        half_width=half_widths[0, Containment.POINTS],
    )


def calibrated_widths(
    largest: FloatArray, coverage: float, every: int = SCALE_EVERY
) -> tuple[FloatArray, Calibration]:
    """Return half widths that the next run keeps in all quantities, and their calibration.

    Constant half widths, in the proportion of the mean largest deviations of the scale runs: the
    scale must not depend on the runs that are scored.

    `largest`: largest absolute deviations of each run, (n, q), all above 0; of `every` runs, the
    last gives the scale. Raises `InvalidFit` where there are too few runs for the coverage.
    """
    for_scale = np.arange(1, len(largest) + 1) % every == 0
    needed = fewest_scores(coverage)
    if (~for_scale).sum() < needed or not for_scale.any():
        least = max(every, needed + (needed - 1) // (every - 1))
        raise InvalidFit(
            f"got {len(largest)} runs, a coverage of {coverage:g} for the next run takes {least} "
            f"at least: {needed} to score, and every {every}th for the scale"
        )
    scale = largest[for_scale].mean(axis=0)
    scores = [largest_score(row[None], scale) for row in largest[~for_scale]]
    calibration = calibrate(scores, coverage)
    return calibration.factor * scale, calibration


def calibrate_tube(runs: Sequence[DrivenRun], coverage: float) -> TubeFile:
    """Return the file of the tube that the runs were driven in, with calibrated half widths.

    Raises:
        InvalidFit: the runs are too few, not of one field and controller, have a seed in common,
            or were driven in another tube than their scenario names.
        InvalidTube: the coverage is not between 0 and 1.
    """
    require_alike(runs)
    largest = np.array([run.largest for run in runs])
    half_widths, calibration = calibrated_widths(largest, coverage)
    first = runs[0]
    tube = read_tube(first.settings.controller.tube_name)
    ticks = round(first.reference.duration_s / PAPER_PERIOD_S)  # the tube looks ahead
    along = ReferenceTube.along(tube.design(), first.reference, ticks)
    designed = along.half_widths[0, Containment.POINTS]
    for run in runs:
        if not np.allclose(run.half_width, designed, rtol=_SAME_TUBE):
            raise InvalidFit(
                f"{run.label}: driven in another tube than {first.settings.controller.tube_name} "
                f"is now: its half widths differ by up to "
                f"{100.0 * np.abs(run.half_width / designed - 1.0).max():.1f} %"
            )
    seeds = [run.seed for run in runs]
    return replace(
        tube,
        calibration=RunCalibration(
            scenario=first.scenario,
            controller=first.controller,
            reference=path_table(first.settings.path),
            coverage=coverage,
            guaranteed=calibration.coverage,
            scored_seeds=[seed for n, seed in enumerate(seeds, 1) if n % SCALE_EVERY],
            scale_seeds=seeds[SCALE_EVERY - 1 :: SCALE_EVERY],
            half_widths=PointHalfWidths(*map(float, half_widths)),
            versions=versions(),
        ),
    )


def format_calibration(tube: TubeFile) -> str:
    """Return a table of the calibrated half widths and their premise."""
    calibration = tube.calibration
    if calibration is None:
        return "not calibrated"
    scored = len(calibration.scored_seeds)
    given = Calibration(1.0, round(calibration.guaranteed * (scored + 1)), scored)
    low, high = given.coverage_interval()
    widths = asdict(calibration.half_widths)
    rows = [
        f"{f'  {body}':<24}"
        + "".join(f"{widths[f'{body}_{direction}_m']:>10.4f}" for direction in _DIRECTIONS)
        for body in Containment.ACROSS
    ]
    return "\n".join(
        [
            f"Runs      {calibration.scenario}, {calibration.controller}: {scored} scored, "
            f"{len(calibration.scale_seeds)} for the scale",
            f"Coverage  {calibration.guaranteed:.4f} for the next run of this scenario; given "
            f"these runs {low:.4f} to {high:.4f} (95 %)",
            "",
            f"{'half width [m]':<24}" + "".join(f"{direction:>10}" for direction in _DIRECTIONS),
            *rows,
        ]
    )
