"""One run: the stages of a control period, in the order in which data flows through them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter_ns
from typing import Final, Literal

from ttempc.types import (
    Command,
    Controller,
    ControlStep,
    Estimate,
    Estimator,
    FloatArray,
    Measurement,
    Preparing,
)
from ttempc.vehicle import Vehicle

from ..errors import ControllerFailed, PlantDiverged
from ..ground.terrain import Terrain
from ..recording import channels
from ..recording import record_rows as rows
from ..recording.record import Event
from ..recording.sink import Sink
from ..recording.topics import PREDICTED_PATH_TOPIC, PREDICTED_TRAILER_PATH_TOPIC
from ..sensing.sensors import SensorSuite
from ..truth import Truth
from .command_guard import Border
from .plant import Plant
from .termination import TerminationLimits, check_termination


@dataclass(frozen=True, slots=True)
class Rig:
    """Everything that one run is made of."""

    plant: Plant
    sensors: SensorSuite
    estimator: Estimator
    controller: Controller
    vehicle: Vehicle  # as the controller believes it; gives the bounds in the log
    sink: Sink
    reference: FloatArray  # (n, len(REFERENCE.fields)) one row every `record_steps`
    control_steps: int  # physics steps in a control period
    record_steps: int  # physics steps from one row of the truth to the next
    terrain: Terrain  # to see whether the vehicle is still on it
    mishaps: TerminationLimits = field(default_factory=TerminationLimits)
    notes: tuple[str, ...] = ()  # on the reference, for the log

    @property
    def border(self) -> Border:
        """What the controller's commands must keep to."""
        return Border(self.vehicle, self.control_steps * self.plant.timestep_s)


@dataclass(slots=True)
class Period:
    """What flows through the stages; a stage reads what earlier ones left and adds its own."""

    k: int = 0  # control tick, counted
    truths: list[tuple[int, Truth]] = field(default_factory=list)  # physics step, plant
    measurements: list[Measurement] = field(default_factory=list)
    estimate: Estimate | None = None
    control: ControlStep | None = None
    command: Command | None = None  # as it reaches the actuators; until then the previous one
    fallback: str = ""
    lost: str | None = None
    estimator_ns: int = 0
    control_ns: int = 0
    plant_ns: int = 0

    @property
    def now(self) -> Truth:
        """The plant at the latest moment."""
        return self.truths[-1][1]


Stage = Callable[[Rig, Period], None]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended."""

    status: Literal["completed", "lost", "invalid"]
    failure: str | None  # why, where it did not complete
    duration_s: float  # simulated
    wall_s: float


def announce(rig: Rig, period: Period) -> None:
    """Say where the path is from, and what of actuators and sensors is not as the paper has it."""
    specifications = rig.plant.actuators.specification, rig.sensors.specification
    said = (note for specification in specifications for note in specification.notes())
    for text in (*rig.notes, *said):
        rig.sink.event(Event(period.now.time_s, "info", text))


def prepare(rig: Rig, period: Period) -> None:
    """Let the controller get ready, where it can, before the samples are there."""
    if isinstance(rig.controller, Preparing):
        rig.controller.prepare(period.k)


def sense(rig: Rig, period: Period) -> None:
    """Sample the sensors at every moment since the previous tick."""
    period.measurements = []
    for step, truth in period.truths:
        samples = rig.sensors.sample(truth, step)
        if samples:
            rig.sink.row(channels.MEASUREMENT, truth.time_s, rows.measurement_row(samples))
            period.measurements += samples


def estimate(rig: Rig, period: Period) -> None:
    """Turn measurements into an estimate."""
    start = perf_counter_ns()
    period.estimate = rig.estimator.update(period.now.time_s, period.measurements, period.command)
    period.estimator_ns = perf_counter_ns() - start
    rig.sink.row(channels.ESTIMATE, period.now.time_s, rows.estimate_row(period.estimate))


def control(rig: Rig, period: Period) -> None:
    """Turn the estimate into a command within the vehicle's limits."""
    assert period.estimate is not None
    start = perf_counter_ns()
    made = rig.border.ask(rig.controller, period.estimate, period.k, period.command)
    period.control_ns = perf_counter_ns() - start
    period.control, period.command = made, made.command


def note(rig: Rig, period: Period) -> None:
    """Write down what the controller decided and why."""
    assert period.control is not None
    said, time = period.control.diagnostics, period.now.time_s
    rig.sink.row(channels.CONTROL, time, rows.control_row(period.control, rig.vehicle))
    rig.sink.row(channels.TRACKING, time, rows.tracking_row(said))
    rig.sink.row(channels.SOLVER, time, rows.solver_row(said))
    if said.tube is not None:
        rig.sink.row(channels.TUBE, time, rows.tube_row(said.tube))
    if said.predicted_path is not None:
        rig.sink.path(PREDICTED_PATH_TOPIC, time, said.predicted_path[:, :2])
        rig.sink.path(PREDICTED_TRAILER_PATH_TOPIC, time, said.predicted_path[:, 2:])
    if said.fallback != period.fallback:
        text = f"fallback: {said.fallback}" if said.fallback else "fallback ended"
        rig.sink.event(Event(time, "warning" if said.fallback else "info", text))
        period.fallback = said.fallback


def advance(rig: Rig, period: Period) -> None:
    """Let the plant run for one control period, stopping where a sensor or the record looks."""
    assert period.command is not None
    start_step = period.k * rig.control_steps
    stride = math.gcd(rig.control_steps, rig.record_steps, rig.sensors.every)
    truths = []
    start = perf_counter_ns()
    for step in range(start_step + stride, start_step + rig.control_steps + 1, stride):
        truths.append((step, rig.plant.advance(period.command, stride)))
    period.plant_ns = perf_counter_ns() - start
    period.truths = truths


def observe(rig: Rig, period: Period) -> None:
    """Write down the truth beside its reference."""
    for step, truth in period.truths:
        if step % rig.record_steps == 0:
            rig.sink.row(channels.STATE, truth.time_s, rows.state_row(truth))
            rig.sink.row(
                channels.REFERENCE,
                truth.time_s,
                rig.reference[step // rig.record_steps].tolist(),
            )
            rig.sink.row(channels.TYRES, truth.time_s, rows.tyres_row(truth))
            rig.sink.scene(truth)


def time_costs(rig: Rig, period: Period) -> None:
    """Write down what the period cost."""
    assert period.control is not None
    report = period.control.diagnostics.solver
    rig.sink.row(
        channels.TIMING,
        period.now.time_s,
        (
            *(1e-3 * period.estimator_ns, 1e-3 * period.control_ns),
            rows.NAN if report is None else 1e6 * report.solve_time_s,
            1e-3 * period.plant_ns / rig.control_steps,
        ),
    )


def judge(rig: Rig, period: Period) -> None:
    """Say whether the vehicle is lost."""
    step, truth = period.truths[-1]
    x, y = rig.reference[step // rig.record_steps, :2]
    period.lost = check_termination(truth, (float(x), float(y)), rig.terrain, rig.mishaps)


STAGES: Final[tuple[Stage, ...]] = (
    prepare,
    sense,
    estimate,
    control,
    note,
    advance,
    observe,
    time_costs,
    judge,
)
"""A disturbance or a fault is one more stage in this list, at the place where it acts."""


def drive(
    rig: Rig,
    ticks: int,
    stages: Sequence[Stage] = STAGES,
    on_tick: Callable[[int], object] = lambda k: None,
) -> Outcome:
    """Run `ticks` control periods, or fewer where the vehicle is lost.

    The plant must have been reset to its start. `on_tick` is told of every period that ended.
    """
    start = perf_counter_ns()
    period = Period(truths=[(0, rig.plant.truth())])
    announce(rig, period)
    observe(rig, period)
    status: Literal["completed", "lost", "invalid"] = "completed"
    failure: str | None = None
    try:
        for k in range(ticks):
            period.k = k
            for stage in stages:
                stage(rig, period)
            on_tick(k)
            if period.lost:
                status, failure = "lost", period.lost
                break
    except (PlantDiverged, ControllerFailed) as error:
        status, failure = "invalid", str(error)
    time = period.now.time_s
    if failure:
        rig.sink.event(Event(time, "error", failure))
    return Outcome(status, failure, time, 1e-9 * (perf_counter_ns() - start))
