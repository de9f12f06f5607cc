"""Second lap on the same line, with and without a map of disturbances by place."""

from typing import Final

import numpy as np

from ....testbed.recording.record import Recorder
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...scenario.scenario import load
from ..study import Case, Row, Study
from ..tables import Cell, grouped, label, lost, numbers

VARIANTS: Final = {
    "`ttempc`": (),
    "`ttempc`, `learn_field`": ("controller.learn_field=true",),
    "`nmpc-rti`, `learn_field`": ("controller.name=nmpc-rti", "controller.learn_field=true"),
}
_BETWEEN_ROWS: Final = ((6.0, 34.0), (88.0, 114.0))  # of a lap of `rows` [m]


def second_lap(case: Case) -> Row:
    """Return the cross-track figures of the second lap [m]: p95 and largest of each point."""
    options = ()
    if case.scenario == "rows" and "`ttempc`" in case["variant"]:
        options = ("controller.options.corridor=false",)  # at full speed
    _, scenario = load(case.scenario, (*case.overrides, *options))
    recorder = Recorder()
    outcome = drive_into(recorder, assemble(scenario, case.seed), prepared=False)
    errors, lap_m = recorder.record()["/error"], scenario.mission().path.lap_m
    along = errors.time_s - lap_m  # at 1 m/s
    counted = along > 0.0
    if case.scenario == "rows":
        counted &= np.any([(a < along) & (along < b) for a, b in _BETWEEN_ROWS], axis=0)
    row: dict[str, float | str] = {"status": outcome.status}
    for point in ("tractor", "trailer"):
        across = np.abs(errors[f"{point}_cross_m"][counted])
        row[f"{point}_p95"] = float(np.quantile(across, 0.95)) if across.size else np.nan
        row[f"{point}_largest"] = float(across.max(initial=0.0))
    return row


def _p95(point: str) -> Cell:
    return lambda runs: f"{100.0 * np.nanmean(numbers(runs, f'{point}_p95')):.2f}"


def _largest(runs) -> str:  # noqa: ANN001 - a frame
    most = np.maximum(numbers(runs, "tractor_largest"), numbers(runs, "trailer_largest"))
    return f"{100.0 * np.median(most):.1f}, {100.0 * most.max():.1f}"


STUDIES: Final = (
    Study(
        name="second-pass",
        scenarios=("rows", "wet-slope", "patchy", "cultivate"),
        axes={"variant": VARIANTS},
        seeds=tuple(range(9701, 9706)),  # tuned on 9801 to 9806
        overrides=("path.laps=2", "sensors.imu.on=true"),
        drive=second_lap,
        table=lambda runs: grouped(
            runs,
            ["scenario", "variant"],
            {
                "scenario": label("scenario"),
                "controller": label("variant", "{}"),
                "tractor, p95": _p95("tractor"),
                "trailer, p95": _p95("trailer"),
                "largest of both: median, most": _largest,
                "lost": lost,
            },
        ),
        checks=(("rows", "ttempc", "controller.learn_field=true", "path.laps=2"),),
    ),
)
