"""Benchmarks of cost and speed beside their limits.

    python -m proving_ground.experiments.papers.benchmarks [PART ...]

Leave the machine idle. Processor times and ratios inside one run, the fastest of several repeats,
so that other processes matter little; latencies are wall times and count once per step. A figure
beyond its limit is marked as missed.
"""

from __future__ import annotations

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false
import argparse
import importlib
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from ttempc.guidance.controllers import make_controller
from ttempc.models.kinematics import articulated, hitch_angle, trailer_point
from ttempc.mpc.qp import PersistentSolver
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Command, Estimate, FloatArray
from ttempc.vehicle import Vehicle

from ...testbed.ground import terrain
from ...testbed.ground.soil import SoilMap
from ...testbed.randomness import generator
from ...testbed.recording.provenance import machine
from ...testbed.recording.record import Recorder, Tee
from ...testbed.simulation import loop
from ...testbed.simulation.plant import Plant
from ...testbed.simulation.setup import SimulationSetup, Stage, TickContext
from ...testbed.vehicle.vehicle import PlantVehicle
from ..figures import png
from ..figures.run_figures import histogram
from ..figures.style import blank, dress
from ..run.assembly import assemble
from ..run.simulate import describe, drive_into, open_log
from ..scenario.scenario import load
from ..sweep.engine import engine
from ..sweep.folder import Origin, SweepFolder
from ..sweep.plan import SweepPlan
from ..sweep.results import rows
from ..sweep.row import Row, no_figures
from ..sweep.study import ListAxis
from ..sweep.study import Study as SweepStudy
from ..sweep.sweep import sweep
from ..sweep.work import SweepJob, run_job
from ..threads import use_one_thread
from .runner import Runner
from .study import Block, Study
from .tables import markdown

PERIOD_S: Final = 0.2
SEED: Final = 1
NOISE: Final = np.array([0.01, 0.01, 0.005, 0.005, 0.002, 0.002, 0.01])  # m, rad, m/s


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured value and its limit."""

    name: str
    value: float
    unit: str = ""
    most: float | None = None
    least: float | None = None

    @property
    def limit(self) -> str:
        """Return the limit as text, with a mark where the value is beyond it."""
        if self.most is None and self.least is None:
            return ""
        text = f"<= {self.most:g}" if self.most is not None else f">= {self.least:g}"
        held = (self.most is None or self.value <= self.most) and (
            self.least is None or self.value >= self.least
        )
        return text if held else f"{text} **missed**"


# --- Control step ---------------------------------------------------------------------------------


def estimates_along(name: str, ticks: int) -> tuple[Vehicle, Reference, list[Estimate]]:
    """Return noisy estimates of a controller along half a figure eight on the kinematic model."""
    vehicle = Vehicle()
    reference = Reference(figure_eight(), vehicle, ConstantSpeed(1.0))
    controller = make_controller(name, vehicle, reference, PERIOD_S)
    random, state, estimates = np.random.default_rng(SEED), reference.at(0.0).state, []
    for k in range(ticks):
        noisy = state + NOISE * random.standard_normal(7)
        estimate = Estimate(
            time_s=k * PERIOD_S,
            state=noisy,
            covariance=np.diag(NOISE**2),
            trailer_xy=trailer_point(noisy, vehicle),
            hitch_angle=hitch_angle(noisy),
        )
        estimates.append(estimate)
        command = controller.step(estimate, k).command.as_array()
        state = solve_ivp(
            lambda _, x, u=command: articulated(x, u, vehicle), (0.0, PERIOD_S), state
        ).y[:, -1]
    return vehicle, reference, estimates


def timed(
    controller: Any,  # noqa: ANN401 - a tracking controller
    estimates: Sequence[Estimate],
    pause_s: float = 0.0,
    prepared: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return the times of steps [us] and their solver iterations, (N,) each."""
    steps, iterations = np.zeros(len(estimates)), np.zeros(len(estimates))
    for k, estimate in enumerate(estimates):
        if pause_s:
            time.sleep(pause_s)
        if prepared:
            controller.prepare(k)
        begin = time.perf_counter()
        report = controller.step(estimate, k).diagnostics.solver
        steps[k] = time.perf_counter() - begin
        iterations[k] = report.iterations if report else 0
    return 1e6 * steps, iterations


def control_step(ticks: int = 340, repeats: int = 40) -> list[Figure]:
    """Return medians of the steps of `ttempc`, each step with its fastest of the repeats."""
    vehicle, reference, estimates = estimates_along("ttempc", ticks)
    solve, spent = PersistentSolver.solve, [0.0]

    def solved_in(solver: PersistentSolver, qp: Any) -> Any:  # noqa: ANN401
        begin = time.perf_counter()
        solution = solve(solver, qp)
        spent[0] += time.perf_counter() - begin
        return solution

    whole, without, iterations = [], [], np.zeros(ticks)
    for _ in range(repeats):
        make = partial(make_controller, "ttempc", vehicle, reference, PERIOD_S)
        taken, iterations = timed(make(), estimates)
        whole.append(taken)
        controller, rest = make(), []
        with patch.object(PersistentSolver, "solve", solved_in):
            for k, estimate in enumerate(estimates):
                spent[0], begin = 0.0, time.perf_counter()
                controller.step(estimate, k)
                rest.append(1e6 * (time.perf_counter() - begin - spent[0]))
        without.append(rest)
    best, rest = np.min(whole, axis=0)[1:], np.min(without, axis=0)[1:]  # the first sets up
    active = iterations[1:] > 0
    return [
        Figure("`ttempc` step with PIQP", float(np.median(best[active])), "us"),
        Figure(
            "`ttempc` step, QP without active bounds",
            float(np.median(best[~active])),
            "us",
            most=40.0,
        ),
        Figure("`ttempc` step without its QP", float(np.median(rest)), "us", most=25.0),
    ]


KINDS: Final = ("without preparation", "with preparation")


def latencies(ticks: int = 340, repeats: int = 4, pause_s: float = 0.02) -> dict[str, FloatArray]:
    """Return time [us] and solver iterations of steps after a pause, (2, n), by kind.

    The process sleeps before every step, so that caches hold the work of others. With preparation,
    `prepare` runs between sleep and step, as while a loop waits for the samples.
    """
    vehicle, reference, estimates = estimates_along("ttempc", ticks)
    result = {}
    for kind in KINDS:
        steps = []
        for _ in range(repeats):
            controller = make_controller("ttempc", vehicle, reference, PERIOD_S)
            steps.append(np.stack(timed(controller, estimates, pause_s, kind == KINDS[1]))[:, 1:])
        result[kind] = np.concatenate(steps, axis=1)
    return result


def latency(measured: Mapping[str, FloatArray] | None = None) -> list[Figure]:
    """Return quantiles of the latency by kind, and its tail where the QP needs no solver."""
    found = []
    quantiles = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
    for kind, (times, iterations) in (measured or latencies()).items():
        for name, share in quantiles.items():
            found.append(Figure(f"{kind}, {name}", float(np.quantile(times, share)), "us"))
        tail = float(np.quantile(times[iterations == 0], 0.99))
        found.append(Figure(f"{kind}, p99 without active bounds", tail, "us", most=100.0))
    return found


def latency_picture(measured: Mapping[str, FloatArray]) -> bytes:
    """Return histograms of the latencies (PNG)."""
    figure = blank(2.6)
    places = figure.subplots(1, len(measured), sharex=True, squeeze=False).flat
    for axes, (kind, (times, _)) in zip(places, measured.items(), strict=True):
        dress(axes, "wall-clock time of a step [us]", "steps", kind)
        histogram(axes, times)
    return png(figure)


# --- Closed loop ----------------------------------------------------------------------------------


def physics_steps(vehicle: PlantVehicle, steps: int = 500, repeats: int = 200) -> FloatArray:
    """Return the times of a step on soil and of a bare `mj_step` [s], (2,).

    The bare vehicle floats without gravity and wheel forces. Both alternate in short blocks; their
    5 % quantiles count, as other processes only slow a block down.
    """
    plant = Plant(vehicle, terrain.rough("D", generator(1, "terrain")), SoilMap(600.0))
    plant.reset(0.0, 0.0, 0.0, 1.0)
    command = Command(0.05, 0.0, 1.0 / vehicle.hydrostat.speed_gain_mps)
    plant.advance(command, 500)
    start, model, data = plant.snapshot(), plant.model, plant.data
    gravity = model.opt.gravity[2]

    def bare() -> None:
        for _ in range(steps):
            mujoco.mj_step(model, data)

    times = []
    for _ in range(repeats):
        plant.restore(start)
        begin = time.perf_counter()
        plant.advance(command, steps)
        soil_s = time.perf_counter() - begin
        plant.restore(start)
        data.xfrc_applied[:] = 0.0
        model.opt.gravity[2] = 0.0
        begin = time.perf_counter()
        bare()
        times.append((soil_s, time.perf_counter() - begin))
        model.opt.gravity[2] = gravity
    return np.quantile(times, 0.05, axis=0) / steps


_STAGES: Final[dict[str, Stage]] = {
    "sensors": loop.sense,
    "estimator": loop.estimate,
    "control step": loop.control,
    "physics": loop.advance,
    "termination": loop.terminate,
}


def _clocked(stage: Stage, times: list[int]) -> Stage:
    """Return a stage that appends its processor time [ns], that of every thread included."""

    def clocked(setup: SimulationSetup, tick: TickContext) -> None:
        begin = time.process_time_ns()
        stage(setup, tick)
        times.append(time.process_time_ns() - begin)

    return clocked


def _drive(logged: bool, overrides: Sequence[str]) -> tuple[dict[Stage, FloatArray], float, float]:
    """Return the times of stages in every tick [s], that of the log [s] and its size [MB]."""
    name, scenario = load("grass", overrides)
    assembly = assemble(scenario, SEED)
    times: dict[Stage, list[int]] = {s: [] for s in assembly.stages if s is not loop.prepare}
    run = replace(assembly, stages=tuple(_clocked(s, own) for s, own in times.items()))
    log_s, log_mb, begin = 0.0, 0.0, time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        if logged:
            file = Path(folder) / "log.mcap"
            metadata = describe(name, scenario, SEED, assembly)
            with open_log(file, scenario, assembly, assembly.plant.scenery, metadata) as log:
                log_s = time.process_time() - begin
                drive_into(Tee(Recorder(), log), run, prepared=False)
                begin = time.process_time()
            log_s += time.process_time() - begin
            log_mb = 1e-6 * file.stat().st_size
        else:
            drive_into(Recorder(), run, prepared=False)
    return {stage: 1e-9 * np.array(own) for stage, own in times.items()}, log_s, log_mb


def closed_loop(overrides: Sequence[str] = (), repeats: int = 3, steps: int = 500) -> list[Figure]:
    """Return the cost of two laps of `grass` relative to a bare step, and that of its stages."""
    assembly = assemble(load("grass", overrides)[1], SEED)
    timestep_s = assembly.plant.timestep_s
    per_tick = round(PERIOD_S / timestep_s)
    bare, plain, logged, log_mb = [], [], [], 0.0
    for _ in range(repeats):
        plain.append(_drive(False, overrides)[0])
        times, log_s, log_mb = _drive(True, overrides)
        logged.append(sum(float(own.sum()) for own in times.values()) + log_s)
        bare.append(physics_steps(assembly.plant.vehicle, steps))
    soil_s, bare_s = np.min(bare, axis=0).tolist()
    ticks = len(next(iter(plain[0].values())))
    fastest = min(sum(float(own.sum()) for own in times.values()) for times in plain)
    step_s, logged_s = (spent / (ticks * per_tick) for spent in (fastest, min(logged)))

    def stage_ms(stage: Stage) -> float:
        return 1e3 * float(np.median(np.min([times[stage] for times in plain], axis=0)))

    return [
        Figure("bare `mj_step`", 1e6 * bare_s, "us"),
        Figure("physics on soil / bare step", soil_s / bare_s, most=1.45),
        Figure("loop without log / bare step", step_s / bare_s, most=1.75),
        Figure("loop with log / bare step", logged_s / bare_s, most=2.2),
        Figure("loop without log, simulated s a s", timestep_s / step_s),
        Figure("log", log_mb, "MB", most=30.0),
        *(
            Figure(f"- {name}, a tick", stage_ms(s), "ms", 0.12 if name == "estimator" else None)
            for name, s in _STAGES.items()
        ),
    ]


# --- Processes ------------------------------------------------------------------------------------

_COMMAND: Final = (sys.executable, "-m", "proving_ground.experiments.commands.cli")
_FIRST_TICK: Final = f"stages=[{{make='{__name__}:first_tick_printer', after='advance'}}]"


def first_tick_printer(generator: np.random.Generator) -> Stage:
    """Return a stage that prints the processor time of the process and ends it."""

    def stage(setup: SimulationSetup, tick: TickContext) -> None:
        print(time.process_time(), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)  # without the time of an orderly end

    return stage


def _process_s(*command: str, repeats: int) -> float:
    """Return the least processor time of several processes [s]."""

    def spent() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    times = [spent()]
    for _ in range(repeats):
        subprocess.run(command, check=True, capture_output=True)
        times.append(spent())
    return min(after - before for before, after in pairwise(times))


def start_up(repeats: int = 5) -> list[Figure]:
    """Return the processor time of help, import, and a run to the end of its first period."""
    first = []
    for _ in range(1 + repeats):  # the first of them may compile kernels
        with tempfile.TemporaryDirectory() as folder:
            run = ("run", "grass", "--trust", "--out", f"{folder}/run", "--set", _FIRST_TICK)
            done = subprocess.run([*_COMMAND, *run], check=False, capture_output=True, text=True)
        first.append(float(done.stdout.split()[-1]))
    helped = _process_s(*_COMMAND, "--help", repeats=repeats)
    imported = _process_s(sys.executable, "-c", "from ttempc import Guidance", repeats=repeats)
    return [
        Figure("`ttempc --help`", helped, "s", most=0.3),
        Figure("`from ttempc import Guidance`", imported, "s"),
        Figure("`ttempc run`, end of the first control period", min(first), "s", most=2.0),
    ]


def peak_mb() -> float:
    """Return the peak memory of this process [MB].

    Where there is /proc, it is read there: `getrusage` of a child begins with the parent's peak.
    """
    status = Path("/proc/self/status")
    if status.exists():
        lines = status.read_text(encoding="utf-8").splitlines()
        return float(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


_WITHOUT: Final = """
from proving_ground import load, simulate
simulate(*load("grass", ["path.laps={laps}"]), seed=1)
"""
_WITH: Final = """
from proving_ground.experiments.commands.cli import main
main(["run", "grass", "--json", "--set", "path.laps={laps}", "--out", "{folder}/run"])
"""


def memory(few: int = 2, many: int = 8, laps: int = 40) -> list[Figure]:
    """Return peaks of processes of `few` laps and, on the line through both, of `laps`."""
    found = []
    for name, code, most in (("`simulate`", _WITHOUT, 250.0), ("`ttempc run`", _WITH, 600.0)):
        peaks = []
        for count in (few, many):
            with tempfile.TemporaryDirectory() as folder:
                text = code.format(laps=count, folder=folder)
                text += f"\nfrom {__name__} import peak_mb\nprint(peak_mb())"
                command = [sys.executable, "-c", text]
                done = subprocess.run(command, check=True, capture_output=True, text=True)
            peaks.append(float(done.stdout.splitlines()[-1]))
        at_end = peaks[0] + (laps - few) * (peaks[1] - peaks[0]) / (many - few)
        found += [
            Figure(f"{name}, {few} laps", peaks[0], "MB"),
            Figure(f"{name}, {laps} laps", at_end, "MB", most=most),
        ]
    return found


# --- Sweep ---------------------------------------------------------------------------------------


def synthetic_row(job: SweepJob) -> Row:
    """Return a row without a run."""
    return job.row("completed", None, dict.fromkeys(no_figures(), 0.5), 0.0)


def _sweep(
    seeds: int, workers: int, parent: Path, laps: int, work: Callable[[SweepJob], Row] = run_job
) -> tuple[float, list[Row], float]:
    """Return the time of a sweep on warm workers [s], its rows, and a worker's peak [MB]."""
    axis = ListAxis(kind="list", key="controller", values=("ttempc-nominal", "paper"))
    taken, folder = 0.0, None
    with engine(workers) as cores:
        for name, count in (("first", max(1, workers)), ("measured", seeds)):
            study = SweepStudy(seeds=count, set={"path": {"laps": laps}}, axis=(axis,))
            plan = SweepPlan("benchmark", study)
            folder = SweepFolder(parent / f"{name}-{workers}", Origin.here("", plan.size))
            folder.path.mkdir()
            begin = time.perf_counter()
            sweep(plan, folder, cores, work=work)
            taken = time.perf_counter() - begin
        peak = cores.executor.submit(peak_mb).result()
    assert folder is not None
    return taken, list(rows(folder.results)), peak


def sweeps(seeds: int = 4, count: int = 10_000) -> list[Figure]:
    """Return speed, overhead and memory of workers, and the cost of a row without a run."""
    found, taken = [], {}
    with tempfile.TemporaryDirectory() as folder:
        parent = Path(folder)
        for workers in (1, 2):
            taken[workers], driven, peak = _sweep(seeds, workers, parent, 1)
            busy = sum(float(row["wall_s"] or 0.0) for row in driven)
            simulated = sum(float(row["duration_s"] or 0.0) for row in driven)
            overhead = 100.0 * (workers * taken[workers] / busy - 1.0)
            on = f"{workers} worker{'s' * (workers > 1)}"
            found += [
                Figure(f"{on}, simulated s a s and core", simulated / busy, least=110.0),
                Figure(f"{on}, time without a run", overhead, "%", most=5.0),
                Figure(f"{on}, peak memory of one", peak, "MB", most=300.0),
            ]
        found.append(Figure("parallel efficiency", taken[1] / (2.0 * taken[2]), least=0.95))
        row_s = _sweep(count // 2, 0, parent, 1, synthetic_row)[0] / count
        return [*found, Figure("a row without a run", 1e3 * row_s, "ms")]


# --- Table ----------------------------------------------------------------------------------------

PARTS: Final[Mapping[str, Callable[[], list[Figure]]]] = {
    "control-step": control_step,
    "latency": latency,
    "closed-loop": closed_loop,
    "start-up": start_up,
    "memory": memory,
    "sweep": sweeps,
}
"""Benchmarks by name."""


def table(parts: Mapping[str, Callable[[], list[Figure]]]) -> str:
    """Measure parts and return the machine and their figures beside their limits (Markdown)."""
    load_ = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    where = ", ".join(f"{name} {value}" for name, value in {**machine(), "load": load_}.items())
    lines = []
    for part, measure in parts.items():
        print(part, file=sys.stderr, flush=True)
        for item in measure():
            value = f"{item.value:.0f}" if abs(item.value) >= 100.0 else f"{item.value:.3g}"
            lines.append((part, item.name, f"{value} {item.unit}".rstrip(), item.limit))
    return f"{where}\n\n{markdown(('part', 'figure', 'value', 'limit'), lines)}"


def _page(runner: Runner) -> Block:
    measured = latencies()
    parts = {**PARTS, "latency": partial(latency, measured)}
    alt = "Latency of a control step after 20 ms of idle, without and with preparation"
    text = f"{table(parts)}\n\n![{alt}](latency.png)"
    return Block(text, {"latency.png": latency_picture(measured)})


STUDIES: Final = (Study(name="performance", make=_page, minutes=4.0),)


def main(words: Sequence[str] | None = None) -> None:
    """Measure and print the table."""
    use_one_thread()
    parser = argparse.ArgumentParser(prog="papers.benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"all, or of {', '.join(PARTS)}")
    given = parser.parse_args(words)
    if unknown := [part for part in given.parts if part not in PARTS]:
        parser.error(f"{unknown[0]}: must be one of {', '.join(PARTS)}")
    print(table({part: PARTS[part] for part in given.parts or PARTS}))


if __name__ == "__main__":  # as a module of its own name, by which processes find its functions
    importlib.import_module(f"{__package__}.benchmarks").main()
