"""From the logs of runs to a tube: residuals, their sets, what a hold-out says, gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from proving_ground.testbed.errors import LogError
from proving_ground.testbed.log.log_reader import read_log
from proving_ground.testbed.recording.provenance import versions
from proving_ground.testbed.recording.record import Record
from ttempc.limits import CommandLimits
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.reference.feedforward import exact_feedforward
from ttempc.reference.reference import Reference
from ttempc.tube.ancillary import AncillaryWeights, InputRoom, search_weights
from ttempc.tube.disturbance_set import DisturbanceSet, Shape
from ttempc.tube.reference_tube import ReferenceTube, TubeDesign
from ttempc.types import FloatArray, State

from ..errors import InvalidFit, InvalidScenario
from ..results.statistics import fewest_samples, proportion
from ..run.assembly import CONTROL_PERIOD_S, geared
from ..scenario.scenario import Scenario, load
from ..scenario.tube_file import HoldOut, Provenance, TubeFile, residual_table, tube_file
from .residuals import Errors, Residuals, errors, residuals

WINDOW_STEPS = 10  # two seconds: by then the vehicle has moved by two thirds of its length
COVERAGE = 0.9
RESERVE = 0.2  # share of each steering range that the tube shall leave free
_HOLD_OUT_EVERY = 3  # of three runs, the third is held out
_N = len(State)


@dataclass(frozen=True)
class FitRun:
    """One run, as a fit sees it."""

    scenario: str
    controller: str
    seed: int
    settings: Scenario
    reference: Reference
    errors: Errors
    residuals: Residuals


@dataclass(frozen=True)
class Fit:
    """A tube file with its tube along the reference of the runs."""

    file: TubeFile
    along: ReferenceTube
    straight: int  # tick of the smallest curvature
    curve: int  # tick of the sharpest


def fit_run(record: Record, scenario: Scenario) -> FitRun:
    """Return what a fit needs of a run.

    Raises:
        InvalidFit: the run is too short.
    """
    course = scenario.path.course()
    reference = Reference(course.path, geared(course, scenario), course.speed)
    seen = errors(record, reference, CONTROL_PERIOD_S)
    return FitRun(
        record.metadata["scenario"],
        record.metadata["controller"],
        int(record.metadata["seed"]),
        scenario,
        reference,
        seen,
        residuals(seen, reference, CONTROL_PERIOD_S),
    )


def read_runs(folders: Sequence[Path]) -> list[FitRun]:
    """Return the runs in the folders, and in folders below them, in the order of their names.

    Raises:
        InvalidFit: there is no run in a folder, a log or its scenario cannot be read, a run is too
            short, or the runs are of different vehicles.
    """
    runs = []
    for folder in folders:
        logs = sorted(folder.rglob("log.mcap"))
        if not logs:
            raise InvalidFit(f"{folder}: there is no log.mcap in it or below")
        for log in logs:
            try:
                _, scenario = load(str(log.parent / "scenario.toml"))
                runs.append(fit_run(read_log(log), scenario))
            except (LogError, InvalidScenario) as error:
                raise InvalidFit(str(error)) from None
            except InvalidFit as error:
                raise InvalidFit(f"{log}: {error}") from None
    for run in runs:
        if run.reference.vehicle != runs[0].reference.vehicle:
            raise InvalidFit(
                f"{run.scenario}, seed {run.seed}: is of another vehicle than {runs[0].scenario}, "
                f"seed {runs[0].seed}: a tube is for one"
            )
    return runs


def fit_set(
    runs: Sequence[FloatArray], coverage: float, window: int, shape: Shape
) -> DisturbanceSet:
    """Return the set that holds the share `coverage` of all windows of the `runs` (n, 7) each.

    The axes are those of the coordinates for a box, else those of the correlations' principal
    components, scaled by the standard deviations. An ellipsoid has one radius; else every axis
    has its own, the same quantile on each, such that together they hold the coverage: what has
    heavy tails along one axis does not widen the others.
    """
    samples = np.concatenate(runs)
    spread = samples.std(axis=0)
    if not np.all(spread > 0.0):
        raise InvalidFit(f"residuals without spread: standard deviations {spread.tolist()}")
    axes = np.diag(spread)
    if shape != "box":
        vectors, values, _ = np.linalg.svd(np.corrcoef(samples.T))
        axes = spread[:, None] * vectors * np.sqrt(values)
    if shape == "ellipsoid":
        unit = DisturbanceSet(axes, window, shape)
        radius = np.quantile(np.concatenate([unit.fill(run) for run in runs]), coverage)
        return DisturbanceSet(radius * axes, window, shape)
    single = [
        np.concatenate([_axis_fill(axes, run, window)[:, axis] for run in runs])
        for axis in range(len(axes))
    ]
    return DisturbanceSet(axes * _joint_quantile(np.array(single).T, coverage), window, shape)


def hold_out(made: DisturbanceSet, runs: Sequence[FloatArray], confidence: float) -> HoldOut:
    """Return how many windows of the `runs`, one after the other without overlap, lie inside."""
    fills = np.concatenate([made.fill(run)[:: made.window] for run in runs])
    found = proportion(int((fills <= 1.0).sum()), len(fills), confidence)
    return HoldOut(found.total, found.count, found.low, found.high)


def fit_tube(
    runs: Sequence[FitRun],
    coverage: float = COVERAGE,
    window: int = WINDOW_STEPS,
    shape: Shape = "box",
    confidence: float = 0.95,
) -> Fit:
    """Return the tube that the runs ask for, every third of them held out.

    Raises:
        InvalidFit: there are too few data for the coverage; with the numbers.
        InvalidTube: no gain makes a tube that fits into the inputs; with the numbers.
    """
    fitted = [run for place, run in enumerate(runs, 1) if place % _HOLD_OUT_EVERY]
    held_out = [run for place, run in enumerate(runs, 1) if place % _HOLD_OUT_EVERY == 0]
    _require_enough(fitted, held_out, coverage, window, confidence)
    seen = [run.residuals.seen for run in fitted]
    blur = [run.errors.estimation for run in fitted]
    disturbance = fit_set(seen, coverage, window, shape)
    estimate_error = fit_set(blur, coverage, 1, "zonotope")
    reference = runs[0].reference
    ticks = int(reference.duration_s / CONTROL_PERIOD_S)
    bend = np.abs(reference.at(np.arange(ticks) * CONTROL_PERIOD_S).curvature)
    straight, curve = int(np.argmin(bend)), _longest(bend >= 0.999 * bend.max())
    weights = design_weights(reference, [straight, curve], disturbance)
    design = TubeDesign(reference.vehicle, CONTROL_PERIOD_S, disturbance, estimate_error, weights)
    provenance = Provenance(
        scenarios=sorted({run.scenario for run in runs}),
        controllers=sorted({run.controller for run in runs}),
        fitted_seeds=[run.seed for run in fitted],
        held_out_seeds=[run.seed for run in held_out],
        reference={
            name: str(value)
            for name, value in sorted(vars(runs[0].settings.path).items())
            if not name.startswith("_")
        },
        coverage=coverage,
        confidence=confidence,
        disturbance=hold_out(disturbance, [run.residuals.seen for run in held_out], confidence),
        estimate_error=hold_out(
            estimate_error, [run.errors.estimation for run in held_out], confidence
        ),
        seen=residual_table(np.concatenate([run.residuals.seen for run in runs])),
        true=residual_table(np.concatenate([run.residuals.true for run in runs])),
        estimation=residual_table(np.concatenate([run.errors.estimation for run in runs])),
        versions=versions(),
    )
    about = "Tube for the controller ttempc-tube, written by ttempc fit-tube"
    along = ReferenceTube.along(design, reference, ticks)
    return Fit(tube_file(design, about, provenance), along, straight, curve)


def design_weights(
    reference: Reference, ticks: Sequence[int], disturbance: DisturbanceSet
) -> AncillaryWeights:
    """Return the weights of the ancillary gain for roads as at the `ticks` of the reference.

    Raises:
        InvalidTube: no gain makes a tube.
    """
    vehicle, rows = reference.vehicle, list(ticks)
    a, b, c = error_dynamics(reference, CONTROL_PERIOD_S, max(rows) + 1)
    feedforward = exact_feedforward(reference, max(rows) + 1, CONTROL_PERIOD_S)
    room = InputRoom.of(feedforward[rows], CommandLimits.of(vehicle, CONTROL_PERIOD_S))
    return search_weights(
        *(a[rows, :_N, :_N], b[rows, :_N], c[rows, :, :_N], disturbance, room),
        reserve=RESERVE * np.array([vehicle.steering_limit_t, vehicle.steering_limit_i, 0.0]),
    )


def _require_enough(
    fitted: Sequence[FitRun],
    held_out: Sequence[FitRun],
    coverage: float,
    window: int,
    confidence: float,
) -> None:
    if not 0.0 < coverage < 1.0:
        raise InvalidFit(f"coverage: got {coverage}, must be between 0 and 1")
    if not held_out:
        raise InvalidFit(
            f"got {len(fitted)} runs, at least {_HOLD_OUT_EVERY} are needed: every third is held "
            "out to check the fit"
        )
    windows = sum(len(run.residuals.seen) // window for run in fitted)
    needed = fewest_samples(coverage, confidence)
    if windows < needed:
        raise InvalidFit(
            f"got {windows} windows of {window} steps in {len(fitted)} runs, a coverage of "
            f"{coverage:g} with a confidence of {confidence:g} takes {needed} at least"
        )


def _axis_fill(axes: FloatArray, run: FloatArray, window: int) -> FloatArray:
    """Return the root of the energy of every window along each axis, (n - window + 1, 7)."""
    energy = np.linalg.solve(axes, run.T) ** 2
    windows = np.lib.stride_tricks.sliding_window_view(energy, window, axis=1)
    return np.sqrt(windows.sum(axis=2)).T


def _joint_quantile(samples: FloatArray, coverage: float) -> FloatArray:
    """Return the quantiles (n,), all of one order, within which the `coverage` of rows lies."""
    low, high = coverage, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        inside = (samples <= np.quantile(samples, middle, axis=0)).all(axis=1).mean()
        low, high = (middle, high) if inside < coverage else (low, middle)
    return np.quantile(samples, high, axis=0)


def _longest(flags: np.ndarray) -> int:
    """Return the middle of the longest stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts))
    return int((starts[longest] + ends[longest]) // 2)
