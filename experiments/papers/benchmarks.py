"""Benchmarks of cost and speed beside their limits.

    python -m proving_ground.experiments.papers.benchmarks [PART ...]

Leave the machine idle. Processor times and ratios inside one run, the fastest of several repeats,
so that other processes matter little; latencies are wall times and count once per step. A figure
beyond its limit is marked as missed.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false
import argparse
import importlib
import itertools
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import FrameType, FunctionType
from typing import Any, Final

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from ttempc.guidance.controllers import make_controller
from ttempc.guidance.guidance import Guidance
from ttempc.models.kinematics import articulated, hitch_angle, trailer_point
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Command, Estimate, FloatArray
from ttempc.vehicle import Vehicle

from ...testbed.ground import terrain
from ...testbed.ground.soil import SoilMap
from ...testbed.randomness import generator
from ...testbed.recording.provenance import machine
from ...testbed.recording.record import Recorder, Tee
from ...testbed.simulation import compiled_steps
from ...testbed.simulation.loop import STAGES
from ...testbed.simulation.plant import Plant
from ...testbed.vehicle.vehicle import PlantVehicle
from ..run.assembly import assemble
from ..run.simulate import describe, drive_into, open_log, simulate
from ..scenario.scenario import load
from ..sweep.engine import engine
from ..sweep.folder import Origin, SweepFolder
from ..sweep.plan import SweepPlan
from ..sweep.results import rows
from ..sweep.row import Row
from ..sweep.study import ListAxis
from ..sweep.study import Study as SweepStudy
from ..sweep.sweep import sweep
from ..threads import use_one_thread
from .study import Study
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
    steps, iterations = [], np.zeros(ticks)
    for _ in range(repeats):
        controller = make_controller("ttempc", vehicle, reference, PERIOD_S)
        taken, iterations = timed(controller, estimates)
        steps.append(taken)
    best, active = np.min(steps, axis=0)[1:], iterations[1:] > 0  # the first sets up
    free = float(np.median(best[~active]))
    return [
        Figure("`ttempc` step with PIQP", float(np.median(best[active])), "us"),
        Figure("`ttempc` step, QP without active bounds", free, "us", most=40.0),
    ]


KINDS: Final = ("without preparation", "with preparation")


def latencies(ticks: int, repeats: int, pause_s: float) -> dict[str, FloatArray]:
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


def latency(ticks: int = 340, repeats: int = 4, pause_s: float = 0.02) -> list[Figure]:
    """Return quantiles of the latency by kind, and its tail where the QP needs no solver."""
    found = []
    quantiles = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
    for kind, (times, iterations) in latencies(ticks, repeats, pause_s).items():
        for name, share in quantiles.items():
            found.append(Figure(f"{kind}, {name}", float(np.quantile(times, share)), "us"))
        tail = float(np.quantile(times[iterations == 0], 0.99))
        found.append(Figure(f"{kind}, p99 without active bounds", tail, "us", most=100.0))
    return found


# --- Closed loop ----------------------------------------------------------------------------------


def bare_step_s(steps: int = 500, blocks: int = 20) -> float:
    """Return the time of a bare `mj_step` [s]: the frozen unit of all ratios.

    The vehicle is a file: that of release 0.2.0 in motion, with its two constraints of the
    steering, without ground, gravity, contacts and MuJoCo's clock. The fastest block counts.
    """
    model = mujoco.MjModel.from_xml_path(str(Path(__file__).parent / "baseline" / "vehicle.xml"))
    data, clock, times = mujoco.MjData(model), compiled_steps.clock(), []
    address, clock[0] = int(clock[0]), 0
    for _ in range(blocks):
        mujoco.mj_resetDataKeyframe(model, data, 0)
        begin = time.thread_time()
        mujoco.mj_step(model, data, steps)
        times.append(time.thread_time() - begin)
    clock[0] = address
    return min(times) / steps


def soil_step_s(vehicle: PlantVehicle, timestep_s: float = 0.002, blocks: int = 20) -> float:
    """Return the time of a step on rough soil with its truths at 25 Hz [s], the fastest block."""
    rough = terrain.rough("D", generator(1, "terrain"))
    plant, times = Plant(vehicle, rough, SoilMap(600.0), timestep_s=timestep_s), []
    plant.reset(0.0, 0.0, 0.0, 1.0)
    command, stride = Command(0.05, 0.0, 0.4), round(0.04 / timestep_s)
    plant.advance(command, 25 * stride)
    start = plant.snapshot()
    for _ in range(blocks):
        plant.restore(start)
        begin = time.thread_time()
        for _ in range(5):
            plant.drive(command, 5, stride)
        times.append((time.thread_time() - begin) / (25 * stride))
    return min(times)


def _drive(length_m: float, logged: bool) -> tuple[float, float]:
    """Return processor time of all threads and simulated time of a straight on `grass` [s]."""
    overrides = [f"path={{kind='straight',length_m={length_m}}}"]
    name, scenario = load("grass", overrides)
    assembly = assemble(scenario, SEED)
    with tempfile.TemporaryDirectory() as folder:
        begin = time.process_time()
        if logged:
            file, about = Path(folder) / "log.mcap", describe(name, scenario, SEED, assembly)
            with open_log(file, scenario, assembly, assembly.plant.scenery, about) as log:
                outcome = drive_into(Tee(Recorder(), log), assembly, prepared=False)
        else:
            outcome = drive_into(Recorder(), assembly, prepared=False)
        return time.process_time() - begin, outcome.duration_s


def loop_ratio(
    lengths: tuple[float, float] = (12.0, 32.0), repeats: int = 8, blocks: int = 20
) -> list[Figure]:
    """Return the cost of the physics and of the whole loop, the frozen bare step being 1.

    Everything alternates in one process; the fastest of the repeats counts. The loop is the slope
    between two straights, so that its set-up drops out.
    """
    vehicle, spent = assemble(load("grass", ())[1], SEED).plant.vehicle, defaultdict(list)
    simulated = {}
    for _ in range(repeats):
        spent["bare"].append(bare_step_s(blocks=blocks))
        for timestep_s in (0.002, 0.004):
            spent[timestep_s].append(soil_step_s(vehicle, timestep_s, blocks))
        for logged, length in itertools.product((False, True), lengths):
            taken, simulated[length] = _drive(length, logged)
            spent[logged, length].append(taken)
    least = {what: min(times) for what, times in spent.items()}
    bare, (short, long) = least["bare"], lengths
    steps = (simulated[long] - simulated[short]) / 0.002
    plain, logged = ((least[log, long] - least[log, short]) / steps for log in (False, True))
    return [
        Figure("frozen bare `mj_step`", 1e6 * bare, "us"),
        Figure("physics on soil / bare step", least[0.002] / bare, most=1.05),
        Figure("the same at 4 ms", least[0.004] / bare, most=1.05),
        Figure("loop without log / bare step", plain / bare, most=1.4),
        Figure("loop with log / bare step", logged / bare, most=1.6),
        Figure("loop without log, simulated s a s", 0.002 / plain, least=150.0),
    ]


def closed_loop(overrides: Sequence[str] = ()) -> list[Figure]:
    """Return the cost of the parts of a tick of `grass`, and the size of its log."""
    name, scenario = load("grass", overrides)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "log.mcap"
        timing = simulate(name, scenario, SEED, log=file)[0].timing
        log_mb = 1e-6 * file.stat().st_size
    return [
        Figure("log", log_mb, "MB", most=30.0),
        Figure("estimator, a tick", timing.estimator_us.median or math.nan, "us", most=120.0),
        Figure("control step, a tick", timing.control_step_us.median or math.nan, "us"),
    ]


def calls_of_a_period(overrides: Sequence[str] = (), ticks: int = 40) -> dict[str, float]:
    """Return the Python calls of a control period of `grass` in memory, by stage: exact counts.

    Calls of `Guidance.update` and `Guidance.step` stand under their own names, those of no stage
    under "loop". The first ticks of the run do not count.
    """
    parts = {stage.__code__: stage.__name__ for stage in STAGES if isinstance(stage, FunctionType)}
    parts |= {Guidance.update.__code__: "update", Guidance.step.__code__: "step"}
    counts, inside = Counter[str](), ["loop"]

    def count(frame: FrameType, event: str, argument: object) -> None:
        if event == "call":
            if frame.f_code in parts:
                inside.append(parts[frame.f_code])
            counts[inside[-1]] += 1
        elif event == "return" and frame.f_code in parts:
            inside.pop()

    def on_tick(k: int) -> None:
        if k in (ticks, 2 * ticks):
            sys.setprofile(count if k == ticks else None)

    assembly = replace(assemble(load("grass", overrides)[1], SEED), ticks=2 * ticks + 1)
    try:
        drive_into(Recorder(), assembly, on_tick=on_tick, prepared=False)
    finally:
        sys.setprofile(None)
    return {name: number / ticks for name, number in counts.items()}


def calls() -> list[Figure]:
    """Return the Python calls of a control period in memory."""
    counts = calls_of_a_period()
    guidance = counts.pop("update") + counts.pop("step")
    own = sum(counts.values())
    return [
        Figure("Python calls of `Guidance.update` and `step`", guidance, most=60.0),
        Figure("Python calls of the loop beside them", own, most=60.0),
        Figure("Python calls of a whole period", guidance + own, most=150.0),
    ]


# --- Processes ------------------------------------------------------------------------------------

_METRE: Final = "path={kind='straight',length_m=1}"
_COMMAND: Final = (sys.executable, "-m", "proving_ground.experiments.commands.cli")


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
    """Return the processor time of help, import, and a run of 1 m; kernels are compiled before."""
    runs = []
    for _ in range(1 + repeats):
        with tempfile.TemporaryDirectory() as folder:
            run = ("run", "grass", "--out", f"{folder}/run", "--set", _METRE)
            runs.append(_process_s(*_COMMAND, *run, repeats=1))
    helped = _process_s(*_COMMAND, "--help", repeats=repeats)
    imported = _process_s(sys.executable, "-c", "from ttempc import Guidance", repeats=repeats)
    return [
        Figure("`ttempc --help`", helped, "s", most=0.3),
        Figure("`from ttempc import Guidance`", imported, "s"),
        Figure("`ttempc run` of 1 m", min(runs), "s", most=3.0),
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


# --- Sweep ---------------------------------------------------------------------------------------


def _sweep(seeds: int, workers: int, parent: Path) -> tuple[float, list[Row], float]:
    """Return the time of a sweep on warm workers [s], its rows, and a worker's peak [MB]."""
    axis = ListAxis(kind="list", key="controller", values=("ttempc-nominal", "paper"))
    taken, folder = 0.0, None
    with engine(workers) as cores:
        for name, count in (("first", workers), ("measured", seeds)):
            study = SweepStudy(seeds=count, set={"path": {"laps": 1}}, axis=(axis,))
            plan = SweepPlan("benchmark", study)
            folder = SweepFolder(parent / f"{name}-{workers}", Origin.here("", plan.size))
            folder.path.mkdir()
            begin = time.perf_counter()
            sweep(plan, folder, cores)
            taken = time.perf_counter() - begin
        peak = cores.executor.submit(peak_mb).result()
    assert folder is not None
    return taken, list(rows(folder.results)), peak


def sweeps(seeds: int = 4) -> list[Figure]:
    """Return speed, overhead and memory of workers."""
    found, taken = [], {}
    with tempfile.TemporaryDirectory() as folder:
        parent = Path(folder)
        for workers in (1, 2):
            taken[workers], driven, peak = _sweep(seeds, workers, parent)
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
    return found


# --- Table ----------------------------------------------------------------------------------------

PARTS: Final[Mapping[str, Callable[[], list[Figure]]]] = {
    "control-step": control_step,
    "latency": latency,
    "loop-ratio": loop_ratio,
    "calls": calls,
    "closed-loop": closed_loop,
    "start-up": start_up,
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


STUDIES: Final = (Study(name="performance", make=lambda runner: table(PARTS)),)


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
