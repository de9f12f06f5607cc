"""Fit of a tube to logged runs: one-step residuals, a set of them, its check on held-out runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.stats import binomtest

from ttempc.guidance.controllers import CONTROLLERS
from ttempc.mpc.articulated_error import error_dynamics, error_state
from ttempc.reference.reference import Reference, exact_feedforward
from ttempc.tube.reference_tube import (
    AncillaryWeights,
    ReferenceTube,
    TubeDesign,
    search_weights,
)
from ttempc.tube.sets import DisturbanceSet, fit_set
from ttempc.types import Estimate, FloatArray, State
from ttempc.vehicle import CommandLimits

from ....testbed.errors import LogError
from ....testbed.log.reader import read_log
from ....testbed.recording.channels import CONTROL, ESTIMATE, STATE
from ....testbed.recording.provenance import versions
from ....testbed.recording.record import Record
from ...errors import InvalidFit, InvalidScenario
from ...results.statistics import fewest_samples, proportion
from ...results.tracking_errors import START_UP_S, Containment
from ...run.assembly import model_vehicle
from ...scenario.plant import PAPER_PERIOD_S
from ...scenario.scenario import Scenario, load
from ...scenario.tube_file import (
    HoldOut,
    Provenance,
    TubeFile,
    path_table,
    tube_file,
)

WINDOW_STEPS = 10  # two seconds, in which the vehicle moves by two thirds of its length
COVERAGE = 0.9
CONFIDENCE = 0.95
RESERVE = 0.2  # share of each steering range that the tube leaves free
_HOLD_OUT_EVERY = 3  # of three runs, the third is held out
_N = len(State)
_STATE = ("x_t_m", "y_t_m", "psi_t_rad", "psi_i_rad", "delta_t_rad", "delta_i_rad", "v_mps")
# In the order of `Disturbance` and `MapDisturbance`.
_DISTURBANCE = ("slip_t_rad", "slip_i_rad", "steering_rad", "drive_mps2", "wheel_slip")
_MAP_DISTURBANCE = ("side_x_rad", "side_y_rad", "climb_x", "climb_y")
_COMMAND = ("delta_t_rad_command", "delta_i_rad_command", "hp_command")
_LARGEST = 1e6  # entry of an estimate in SI units: beyond it there is no vehicle
_SAME_TIME_S = 1e-6
Run = TypeVar("Run")


@dataclass(frozen=True)
class LoggedRun:
    """A run that drove its whole path, by its settings."""

    scenario: str
    controller: str
    seed: int
    settings: Scenario
    reference: Reference

    @property
    def label(self) -> str:
        """Name of the run in messages."""
        return f"{self.scenario}, seed {self.seed}"

    @property
    def drives_in_a_tube(self) -> bool:
        """Whether the controller keeps the vehicle in a tube."""
        entry = CONTROLLERS.get(self.controller)
        return entry is not None and entry.tube == "required"


def logged_run(record: Record, scenario: Scenario) -> LoggedRun:
    """Return the settings of a run."""
    if scenario.control.period_s != PAPER_PERIOD_S:
        raise InvalidFit(
            f"control.rate_hz = {scenario.control.rate_hz:g}: a tube is fitted to runs at "
            f"{1.0 / PAPER_PERIOD_S:g} Hz"
        )
    mission = scenario.mission()
    vehicle = model_vehicle(mission, scenario, scenario.vehicles())
    reference = Reference(mission.path, vehicle, mission.speed)
    end_s = max(record[CONTROL].time_s, default=0.0)
    if end_s < reference.duration_s - 2.0 * PAPER_PERIOD_S:
        raise InvalidFit(
            f"the run ended after {end_s:.1f} s of {reference.duration_s:.1f} s: runs must complete"
        )
    return LoggedRun(
        scenario=record.metadata["scenario"],
        controller=record.metadata["controller"],
        seed=int(record.metadata["seed"]),
        settings=scenario,
        reference=reference,
    )


def read_runs(folders: Sequence[Path], make: Callable[[Record, Scenario], Run]) -> list[Run]:
    """Return what `make` takes from all runs in the folders and their subfolders, by name.

    Raises:
        InvalidFit: a folder holds no run, a log or its scenario cannot be read, or `make` refuses
            a run.
    """
    runs = []
    for folder in folders:
        logs = sorted(folder.rglob("log.mcap"))
        if not logs:
            raise InvalidFit(f"{folder}: there is no log.mcap in it or below")
        for log in logs:
            try:
                _, scenario = load(str(log.parent / "scenario.toml"))
                runs.append(make(read_log(log), scenario))
            except (LogError, InvalidScenario) as error:
                raise InvalidFit(str(error)) from None
            except InvalidFit as error:
                raise InvalidFit(f"{log}: {error}") from None
    return runs


def require_alike(runs: Sequence[LoggedRun]) -> None:
    """Refuse runs that are not of one scenario with a seed of its own each."""
    first = asdict(runs[0].settings) if runs else {}
    labels: dict[int, str] = {}
    for run in runs:
        if difference := _difference(first, asdict(run.settings)):
            raise InvalidFit(
                f"{run.label}: {difference} in {runs[0].label}: all runs must be of one field and "
                "one controller"
            )
        if run.seed in labels:
            raise InvalidFit(f"{run.label}: there twice: every run must have a seed of its own")
        labels[run.seed] = run.label


def _difference(first: Mapping[str, object], other: Mapping[str, object], above: str = "") -> str:
    """Return the first key with another value, and both values; "" where all are equal."""
    for key in sorted({*first, *other}):
        one = first.get(key)
        two = other.get(key)
        if one == two:
            continue
        if isinstance(one, Mapping) and isinstance(two, Mapping):
            return _difference(one, two, f"{above}{key}.")
        return f"{above}{key} = {two!r}, but {one!r}"
    return ""


@dataclass(frozen=True)
class RunErrors:
    """Errors of one run, see `error_state`, at consecutive control ticks after start-up."""

    tick: FloatArray  # (n,) whole numbers
    state: FloatArray  # (n, 16) error of the estimate, with the estimated disturbances
    true: FloatArray  # (n, 7)
    command: FloatArray  # (n, 3) as sent

    @property
    def estimated(self) -> FloatArray:
        """Error z_e of the estimate, (n, 7)."""
        return self.state[:, :_N]

    @property
    def estimation(self) -> FloatArray:
        """True error minus estimated error, (n, 7)."""
        return self.true - self.estimated


def run_errors(record: Record, reference: Reference) -> RunErrors:
    """Return the errors of a run from the end of start-up to the first missing tick."""
    time_s = record[ESTIMATE].time_s
    ticks = np.round(time_s / PAPER_PERIOD_S)
    for table in (record[ESTIMATE], record[STATE], record[CONTROL]):
        if not (np.diff(table.time_s) > 0.0).all():
            raise InvalidFit(f"{table.channel.topic}: its times must increase from row to row")
    kept = (time_s >= START_UP_S) & (np.abs(ticks * PAPER_PERIOD_S - time_s) < _SAME_TIME_S)
    for table in (record[STATE], record[CONTROL]):
        kept &= np.isin(time_s, table.time_s)
    kept &= (np.abs(record[ESTIMATE].columns(*_STATE)) < _LARGEST).all(axis=1)
    first = int(np.argmax(kept))
    gaps = np.flatnonzero(~kept[first:])
    last = first + int(gaps[0]) if len(gaps) else len(kept)
    if not kept.any() or last - first < 2:
        raise InvalidFit(
            f"the run has {int(kept.sum())} control ticks after {START_UP_S:g} s, at least 2 in a "
            "row are needed"
        )
    at = time_s[first:last]
    sample = reference.at(at)
    estimates = record[ESTIMATE].columns(*_STATE, *_DISTURBANCE, *_MAP_DISTURBANCE)[first:last]
    true = record[STATE].columns(*_STATE)[np.searchsorted(record[STATE].time_s, at)]
    command = record[CONTROL].columns(*_COMMAND)[np.searchsorted(record[CONTROL].time_s, at)]

    def errors(states: FloatArray) -> FloatArray:
        """Return the errors (n, 16) of states (n, 7), with the disturbances of the estimate."""
        rows = zip(sample.state, states, estimates, strict=True)
        return np.array([_error(target, state, row, reference) for target, state, row in rows])

    return RunErrors(ticks[first:last], errors(estimates[:, :_N]), errors(true)[:, :_N], command)


def residuals(run: RunErrors, reference: Reference) -> FloatArray:
    """Return the one-step residuals of the estimated error along its reference, (n - 1, 7).

        w = z_e(k+1) - A z_e(k) - B u_e(k) + E s(k)

    The estimated disturbances s, map disturbance included, are part of the model. A controller
    acts on the estimate: its correction in a step is one more disturbance to the controller.
    """
    tick = run.tick[:-1].astype(int)
    count = int(tick[-1]) + 1
    a, b, _ = error_dynamics(reference, PAPER_PERIOD_S, count)
    u_e = exact_feedforward(reference, count, PAPER_PERIOD_S)[tick] - run.command[:-1]
    driven = np.einsum("kij,kj->ki", b[tick, :_N], u_e)
    return run.estimated[1:] - np.einsum("kij,kj->ki", a[tick, :_N], run.state[:-1]) - driven


def _error(
    target: FloatArray, state: FloatArray, estimate: FloatArray, reference: Reference
) -> FloatArray:
    """Return the augmented error (z_e, s, m), (16,), of a state (7,) from its target (7,).

    The disturbances are those of `estimate`, a row (16,).
    """
    end = _N + len(_DISTURBANCE)
    estimated = Estimate(
        time_s=0.0,
        state=state,
        covariance=np.zeros((_N, _N)),
        trailer_xy=np.zeros(2),
        hitch_angle=0.0,
        disturbance=estimate[_N:end],
        map_disturbance=estimate[end:],
    )
    return error_state(target, estimated, reference.vehicle)


def hold_out(disturbance: DisturbanceSet, runs: Sequence[FloatArray]) -> HoldOut:
    """Count the windows of held-out runs inside the set, one every `WINDOW_STEPS`."""
    fills = np.concatenate([disturbance.fill(run)[::WINDOW_STEPS] for run in runs])
    inside = proportion(int((fills <= 1.0).sum()), len(fills))
    return HoldOut(inside.total, inside.count, inside.low, inside.high)


def contradiction(count: HoldOut, what: str, coverage: float) -> str:
    """Return a sentence where a one-sided binomial test contradicts the coverage, else ""."""
    if not count.windows:
        return ""
    p = binomtest(count.inside, count.windows, coverage, alternative="less").pvalue
    if p >= 1.0 - CONFIDENCE:
        return ""
    return (
        f"{count.inside} of {count.windows} held-out windows of the {what} lie in its set, a "
        f"coverage of {coverage:g} is contradicted (binomial test, p = {p:.2g}): fit to more runs"
    )


@dataclass(frozen=True)
class FitRun(LoggedRun):
    """Data of one run for a fit."""

    errors: RunErrors
    residuals: FloatArray  # (n - 1, 7), see `residuals`


@dataclass(frozen=True)
class Fit:
    """A fitted tube: its file, and the tube along the reference of the runs."""

    file: TubeFile
    along: ReferenceTube
    straight: int  # tick of the smallest curvature of the reference
    curve: int  # tick in the middle of the longest sharpest curve
    warnings: tuple[str, ...] = ()  # reasons not to rely on it, a sentence each


def fit_run(record: Record, scenario: Scenario) -> FitRun:
    """Return the data of one run for a fit."""
    run = logged_run(record, scenario)
    errors = run_errors(record, run.reference)
    return FitRun(**vars(run), errors=errors, residuals=residuals(errors, run.reference))


def fit_tube(
    runs: Sequence[FitRun],
    coverage: float = COVERAGE,
) -> Fit:
    """Fit a tube to runs. Every third run is held out to check the fit.

    Args:
        runs: in the order in which they are held out.
        coverage: share of the windows inside the disturbance set.

    Raises:
        InvalidFit: there are too few data for the coverage, or the runs are not of one field and
            controller with a seed of its own each. The message gives the numbers.
        InvalidTube: no gain yields a tube within the input limits. The message gives the numbers.
    """
    require_alike(runs)
    fitted = [run for number, run in enumerate(runs, 1) if number % _HOLD_OUT_EVERY]
    held_out = [run for number, run in enumerate(runs, 1) if number % _HOLD_OUT_EVERY == 0]
    _require_enough(fitted, held_out, coverage)

    # Sets of the runs that are fitted, and the same samples of those held out
    disturbance = fit_set([run.residuals for run in fitted], coverage, WINDOW_STEPS, "box")
    estimate_error = fit_set([run.errors.estimation for run in fitted], coverage, 1, "zonotope")
    held_residuals = [run.residuals for run in held_out]
    held_estimation = [run.errors.estimation for run in held_out]

    # Gains for the straightest place and for the longest curve
    reference = runs[0].reference
    ticks = int(reference.duration_s / PAPER_PERIOD_S)
    curvature = np.abs(reference.at(np.arange(ticks) * PAPER_PERIOD_S).curvature)
    straight = int(np.argmin(curvature))
    curve = _longest(curvature >= 0.999 * curvature.max())
    weights = design_weights(reference, [straight, curve], disturbance)
    design = TubeDesign(reference.vehicle, PAPER_PERIOD_S, disturbance, estimate_error, weights)
    along = ReferenceTube.along(design, reference, ticks)

    # The file, with what the tube rests on and what contradicts it
    provenance = Provenance(
        scenarios=sorted({run.scenario for run in runs}),
        controllers=sorted({run.controller for run in runs}),
        fitted_seeds=[run.seed for run in fitted],
        held_out_seeds=[run.seed for run in held_out],
        reference=path_table(runs[0].settings.path),
        coverage=coverage,
        confidence=CONFIDENCE,
        disturbance=hold_out(disturbance, held_residuals),
        estimate_error=hold_out(estimate_error, held_estimation),
        versions=versions(),
    )
    about = "Tube for the controller ttempc-tube, written by ttempc fit tube"
    warnings = [
        contradiction(provenance.disturbance, "disturbance", coverage),
        contradiction(provenance.estimate_error, "error of the estimate", coverage),
    ]
    if not runs[0].drives_in_a_tube:
        warnings.append(
            f"the runs were driven by {runs[0].controller}, which does not drive in a tube: drive "
            "in this tube and fit again"
        )
    file = tube_file(design, about, provenance)
    return Fit(file, along, straight, curve, tuple(filter(None, warnings)))


def design_weights(
    reference: Reference, ticks: Sequence[int], disturbance: DisturbanceSet
) -> AncillaryWeights:
    """Return the weights of the ancillary gain for the error models at `ticks` of a reference,
    as its straight and its sharpest curve; `disturbance` is the set of one-step residuals.
    """
    vehicle = reference.vehicle
    rows = list(ticks)
    a, b, c = error_dynamics(reference, PAPER_PERIOD_S, max(rows) + 1)
    feedforward = exact_feedforward(reference, max(rows) + 1, PAPER_PERIOD_S)[rows]
    limits = CommandLimits.of(vehicle, PAPER_PERIOD_S)
    reserve = RESERVE * np.array([vehicle.steering_limit_t, vehicle.steering_limit_i, 0.0])
    a = a[rows, :_N, :_N]
    b = b[rows, :_N]
    c = c[rows, :, :_N]
    return search_weights(a, b, c, disturbance, feedforward, limits, reserve)


def _require_enough(
    fitted: Sequence[FitRun],
    held_out: Sequence[FitRun],
    coverage: float,
) -> None:
    """Raise `InvalidFit` if there are too few runs or windows for the coverage."""
    if not 0.0 < coverage < 1.0:
        raise InvalidFit(f"coverage: got {coverage}, must be between 0 and 1")
    if not held_out:
        raise InvalidFit(
            f"got {len(fitted)} runs, at least {_HOLD_OUT_EVERY} are needed: every third is held "
            "out to check the fit"
        )
    windows = sum(len(run.residuals) // WINDOW_STEPS for run in fitted)
    needed = fewest_samples(coverage)
    if windows < needed:
        raise InvalidFit(
            f"got {windows} windows of {WINDOW_STEPS} steps in {len(fitted)} runs, a coverage of "
            f"{coverage:g} with a confidence of {CONFIDENCE:g} takes {needed} at least"
        )


def _longest(flags: np.ndarray) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    starts = edges[::2]
    ends = edges[1::2]
    longest = int(np.argmax(ends - starts))
    return int((starts[longest] + ends[longest]) // 2)


def format_fit(fit: Fit) -> str:
    """Return a table of the half widths, the free input ranges and the hold-out counts."""
    provenance = fit.file.provenance
    certificate = fit.along.tube.certificate
    disturbance = fit.file.disturbance
    lines = [
        f"Runs      {', '.join(provenance.scenarios)}: {len(provenance.fitted_seeds)} fitted, "
        f"{len(provenance.held_out_seeds)} held out",
        f"Set       {disturbance.shape}, windows of {disturbance.window} steps, "
        f"coverage {provenance.coverage:g}",
        f"Hold-out  disturbance {_inside(provenance.disturbance)}",
        f"          error of the estimate {_inside(provenance.estimate_error)}",
        f"Tube      alpha {certificate.alpha:.3f} after {certificate.terms} windows",
        "",
        f"{'half width':<24}{'straight':>10}{'curve':>10}{'largest':>10}",
    ]
    for body, column in Containment.ACROSS.items():
        widths = fit.along.half_widths[:, column]
        lines.append(_row(f"{body} cross-track [m]", widths, fit, widths.max()))
    lines.append(f"{'free share of range':<24}{'straight':>10}{'curve':>10}{'least':>10}")
    for column, name in enumerate(("front steering", "trailer steering", "hydrostat")):
        free = fit.along.free_share[:, column]
        lines.append(_row(name, free, fit, free.min()))
    return "\n".join(lines)


def _inside(count: HoldOut) -> str:
    return (
        f"{count.inside} of {count.windows} windows inside ({100.0 * CONFIDENCE:g} %: "
        f"{count.low:.4f} to {count.high:.4f})"
    )


def _row(name: str, values: FloatArray, fit: Fit, extreme: float) -> str:
    cells = values[fit.straight], values[fit.curve], extreme
    return f"{f'  {name}':<24}" + "".join(f"{cell:>10.3f}" for cell in cells)
