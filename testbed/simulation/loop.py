"""Simulation loop: the stages of a control period, in the order in which data flows.

`STAGES` has the order of a tick:

    prepare      the guidance computes what needs no samples
    sense        truths since the last tick -> samples
    estimate     samples -> estimate
    control      estimate -> command
    log_control  command and diagnostics -> record and log
    advance      command -> truths: the plant drives for a control period
    log_truth    truths beside their reference -> record and log
    log_timing   computation times -> record and log
    terminate    last truth -> whether the run ends early

`periods` runs them tick by tick and says how the run ended.
"""

import gc
import math
import traceback
from collections.abc import Callable, Generator, Sequence
from time import perf_counter_ns
from typing import Final

import numpy as np

from ttempc.errors import GuidanceFailed
from ttempc.layout import TICK

from ..errors import PlantDiverged, StageFailed
from ..recording import channels
from ..recording.channels import PREDICTED_PATH_TOPIC, PREDICTED_TRAILER_PATH_TOPIC
from ..recording.record import LEARNT, OVERRUN, REACTION, REACTION_ENDED, Event
from ..truth import STATE_COLUMNS, TYRE_COLUMNS, TruthBlock
from .outcome import LONGEST, End, Outcome, end_of, end_without_arrival
from .setup import SimulationSetup, Stage, TickContext
from .termination import check_termination


def prepare(setup: SimulationSetup, tick: TickContext) -> None:
    """Let the guidance do what needs no samples."""
    with setup.deadline:
        setup.guidance.prepare()


def sense(setup: SimulationSetup, tick: TickContext) -> None:
    """Sample the sensors at every truth since the previous tick."""
    truths = tick.truths.rows
    samples, at = setup.sensors.sample(truths, tick.steps[0], tick.stride)
    tick.sensed(samples)
    if len(samples):
        rows = channels.measurement_rows(samples, at, truths[:, 0])
        setup.sink.rows(channels.MEASUREMENT, *rows)


def estimate(setup: SimulationSetup, tick: TickContext) -> None:
    """Turn measurements into an estimate."""
    setup.guidance.wait()  # the simulation is faster than real time: not a part of the step
    with setup.deadline:
        start = perf_counter_ns()
        tick.estimate = setup.guidance.update(tick.now.time_s, tick.samples)
        tick.estimator_ns = perf_counter_ns() - start
    record = setup.guidance.estimate_record
    setup.sink.row(channels.ESTIMATE, tick.now.time_s, channels.estimate_row(record))


def control(setup: SimulationSetup, tick: TickContext) -> None:
    """Turn the estimate into a command within the vehicle's limits."""
    tick.reference_tick = setup.guidance.reference_tick
    with setup.deadline:
        start = perf_counter_ns()
        tick.command = setup.guidance.step()
        tick.control_ns = perf_counter_ns() - start
    tick.waits = setup.guidance.reference_tick == tick.reference_tick


def log_control(setup: SimulationSetup, tick: TickContext) -> None:
    """Log the record of the command."""
    guidance = setup.guidance
    time = tick.now.time_s
    sink = setup.sink
    record = guidance.tick_record
    solver = record[channels.SOLVER_COLUMNS]
    tube = record[channels.TUBE_COLUMNS]
    sink.row(channels.CONTROL, time, record[channels.CONTROL_COLUMNS])
    sink.row(channels.TRACKING, time, record[channels.TRACKING_COLUMNS])
    sink.row(channels.SOLVER, time, solver)
    if not math.isnan(tube[0]):
        sink.row(channels.TUBE, time, tube)
    foresight = record[channels.FORESIGHT_COLUMNS]
    if not math.isnan(foresight[0]):
        sink.row(channels.FORESIGHT, time, foresight)
    if sink.draws and (path := guidance.predicted_path()) is not None:
        sink.path(PREDICTED_PATH_TOPIC, time, path[:, :2])
        sink.path(PREDICTED_TRAILER_PATH_TOPIC, time, path[:, 2:])
    if guidance.learnt:
        sink.event(Event(time, "info", LEARNT + ", ".join(guidance.learnt)))
    fallback = guidance.diagnostics.fallback if record.view(TICK)[0]["fallback"] else ""
    if fallback != tick.fallback:
        text = f"{REACTION}{fallback}" if fallback else REACTION_ENDED
        warns = fallback and not guidance.waits_for_estimate
        sink.event(Event(time, "warning" if warns else "info", text))
        tick.fallback = fallback


def advance(setup: SimulationSetup, tick: TickContext) -> None:
    """Run the plant for one control period, with stops where a sensor or the record needs it."""
    assert tick.command is not None
    begin = tick.k * setup.control_steps
    end = begin + setup.control_steps
    tick.commands.append((begin + _late_steps(setup, tick), tick.command))

    start_ns = perf_counter_ns()
    blocks = []
    step = begin
    while step < end:
        command, until = tick.command_at(step, end)
        # a command that comes due within a stride acts after it
        stops = -(-(until - step) // tick.stride)
        blocks.append(setup.plant.drive(command, stops, tick.stride))
        step += stops * tick.stride
    tick.plant_ns = perf_counter_ns() - start_ns

    truths = blocks[0]
    if len(blocks) > 1:
        truths = TruthBlock(*map(np.concatenate, zip(*blocks, strict=True)))
    tick.drive_to(end, truths)


def _late_steps(setup: SimulationSetup, tick: TickContext) -> int:
    """Return the physics steps by which the command of this tick comes late; log an overrun."""
    took_s = 1e-9 * (tick.estimator_ns + tick.control_ns)
    period_s = setup.control_steps * tick.timestep_s
    if took_s <= period_s:
        return 0
    text = f"{OVERRUN}the step took {took_s:.3f} s, the control period is {period_s:g} s"
    setup.sink.event(Event(tick.k * period_s, "warning", text))
    return math.ceil(took_s / tick.timestep_s) if setup.realtime else 0


def log_truth(setup: SimulationSetup, tick: TickContext) -> None:
    """Log the truth beside its reference."""
    truths = tick.truths
    steps = tick.steps
    every = setup.record_steps // tick.stride
    if every > 1:
        due = slice(-steps[0] % setup.record_steps // tick.stride, None, every)
        truths = TruthBlock(*(part[due] for part in truths))
        steps = steps[due]

    first = tick.reference_step(steps[0], setup.control_steps)
    stride = 0 if tick.waits else setup.record_steps
    times = truths.rows[:, 0]
    references = setup.reference_rows(first, stride, truths)

    sink = setup.sink
    sink.scenes(truths)
    sink.rows(channels.STATE, times, truths.rows[:, STATE_COLUMNS])
    sink.rows(channels.REFERENCE, times, references)
    sink.rows(channels.TYRES, times, truths.rows[:, TYRE_COLUMNS])
    if truths.tools.size:
        sink.rows(channels.TOOL, times, channels.tool_rows(truths.tools, references))
    for channel, judged in setup.judges:
        sink.rows(channel, times, judged(truths, references))


def log_timing(setup: SimulationSetup, tick: TickContext) -> None:
    """Log the computation times of the period."""
    # A QP that was answered without the solver (time 0) has no time of one.
    qp_us = 1e6 * setup.guidance.solve_time_s or channels.NAN
    plant_us = 1e-3 * tick.plant_ns / setup.control_steps
    row = (1e-3 * tick.estimator_ns, 1e-3 * tick.control_ns, qp_us, plant_us)
    setup.sink.row(channels.TIMING, tick.now.time_s, row)


def terminate(setup: SimulationSetup, tick: TickContext) -> None:
    """Check the conditions under which a run ends early."""
    now = tick.now
    limits = setup.termination
    step = tick.reference_step(tick.steps[-1], setup.control_steps)
    place = now.tractor[:2]
    distance_m = math.dist(place, setup.reference_row(step, *place)[:2].tolist())
    slip = tick.slip.update(now, limits.stuck_time)
    stands = abs(now.speed) < limits.standing

    # since when the supervisor stops the vehicle, and why
    if not setup.guidance.stopping:
        tick.stopping = None
    elif tick.stopping is None:
        tick.stopping = (now.time_s, setup.guidance.diagnostics.fallback)
    since_s, reason = tick.stopping or (-math.inf, "")
    stopping = tick.stopping is not None and (stands or now.time_s - since_s <= limits.stop_time)
    tick.lost = check_termination(now, distance_m, setup.terrain, limits, slip, stopping=stopping)

    # a stopped vehicle may stand for a time, unless its reference has gone on without it
    if not (reason and stands):
        tick.standing_s = None
    elif tick.standing_s is None:
        tick.standing_s = now.time_s
    waited = tick.standing_s is not None and now.time_s - tick.standing_s >= limits.wait_time
    tick.stopped = reason if stands and (distance_m > limits.deviation or waited) else ""


STAGES: Final[tuple[Stage, ...]] = (
    prepare,
    sense,
    estimate,
    control,
    log_control,
    advance,
    log_truth,
    log_timing,
    terminate,
)
"""Stages of a period, in order; faults act in sensors, actuators, ground and stages."""


def with_stages(
    extra: Sequence[tuple[str, Stage]], stages: Sequence[Stage] = STAGES
) -> tuple[Stage, ...]:
    """Return `stages` with more of them, each after the stage of the given name and in order.

    Raises:
        ValueError: there is no stage of a given name.
    """
    names = [stage.__name__ for stage in stages]
    if unknown := sorted({name for name, _ in extra} - {*names}):
        raise ValueError(f"after {unknown[0]!r}: no such stage, must be one of {', '.join(names)}")
    extended: list[Stage] = []
    for stage in stages:
        extended.append(stage)
        extended += [more for name, more in extra if name == stage.__name__]
    return tuple(extended)


def drive(
    setup: SimulationSetup,
    ticks: int,
    stages: Sequence[Stage] = STAGES,
    on_tick: Callable[[int], object] = lambda k: None,
) -> Outcome:
    """Run to tick `ticks` of the reference, or until the run terminates early.

    A reference that waits for a vehicle that the supervisor slows or stops makes a run longer, up
    to three times. So does a vehicle that follows its reference by place and is still more than
    `TerminationLimits.deviation` before the place of that tick.

    The plant must have been reset. `on_tick` is called after every period. An exception in a
    user's controller, estimator or stage ends the run as invalid; its traceback is in the log.
    """
    run = periods(setup, ticks, stages, on_tick)
    with setup.deadline.watch():
        while True:
            try:
                next(run)
            except StopIteration as end:
                return end.value


def periods(
    setup: SimulationSetup, ticks: int, stages: Sequence[Stage], on_tick: Callable[[int], object]
) -> Generator[TickContext, None, Outcome]:
    """Do as `drive`, and pause before every `control`: an estimate is there, a command is not."""
    tick = TickContext(setup)
    for text in setup.notes:
        setup.sink.event(Event(tick.now.time_s, "info", text))
    log_truth(setup, tick)

    end: End | None = None
    trace: str | None = None
    start_ns = perf_counter_ns()
    try:
        setup.guidance.warm_up()
        gc.freeze()  # the collector does not look through 200,000 older objects again and again
        start_ns = perf_counter_ns()
        for k in range(LONGEST * ticks):
            tick.k = k
            for stage in stages:
                if stage is control:
                    yield tick
                stage(setup, tick)
            on_tick(k)
            end = end_of(setup, tick, ticks)
            if end:
                break
        else:
            end = end_without_arrival(setup, tick, ticks)
    except (PlantDiverged, GuidanceFailed, StageFailed, TimeoutError) as error:
        end = ("invalid", str(error))
        if error.__cause__ is not None:
            trace = "".join(traceback.format_exception(error.__cause__))
    finally:
        gc.unfreeze()

    status, failure = end or ("completed", None)
    time_s = tick.now.time_s
    for text in filter(None, (failure, trace)):
        setup.sink.event(Event(time_s, "error", text))
    return Outcome(status, failure, time_s, 1e-9 * (perf_counter_ns() - start_ns), trace)
