"""Benchmarks of cost and speed beside their limits.

    python -m proving_ground.experiments.papers.benchmarks

Leave the machine idle. Processor times and ratios inside one run, the fastest of several repeats,
so that other processes matter little; latencies are wall times and count once per step. A figure
beyond its limit is marked as missed.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false
import contextlib
import copy
import ctypes
import importlib
import importlib.util
import itertools
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType, FunctionType, ModuleType
from typing import Final

import mujoco
import numpy as np

from ttempc.guidance.guidance import Guidance
from ttempc.types import Command

from ...testbed.foreign_files import read_bounded
from ...testbed.ground import terrain
from ...testbed.ground.soil import SoilMap
from ...testbed.randomness import generator
from ...testbed.recording.channels import TIMING
from ...testbed.recording.provenance import machine
from ...testbed.recording.record import Recorder, Tee
from ...testbed.simulation.fast_mujoco.library import Clock
from ...testbed.simulation.loop import STAGES
from ...testbed.simulation.plant import Plant
from ...testbed.vehicle.vehicle import PlantVehicle
from ..numerics import settle_numerics
from ..run.assembly import assemble
from ..run.run_log import describe, open_log
from ..run.simulate import drive_into
from ..scenario.scenario import load
from ..studies.sweep.engine import engine
from ..studies.sweep.folder import Origin, SweepFolder
from ..studies.sweep.plan import SweepPlan
from ..studies.sweep.results import rows
from ..studies.sweep.row import Row
from ..studies.sweep.study import ListAxis, Study
from ..studies.sweep.sweep import sweep
from .markdown import markdown
from .memory import peak_mb
from .studies.effects import BASE, EFFECTS
from .table import Table

SEED: Final = 1


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


# --- Guidance -------------------------------------------------------------------------------------

PAUSES: Final = {
    "without a pause": (0.0, False),
    "after 20 ms of sleep": (0.02, False),
    "after 20 ms of sleep, prepared": (0.02, True),
}
"""Sleep before a tick [s], after which caches hold the work of others, and use of `prepare`."""


def ticks(overrides: Sequence[str] = ("path.laps=1",)) -> list[Figure]:
    """Return quantiles of `Guidance.update` and `Guidance.step` along `grass`, by kind of pause."""
    found = []
    quantiles = {"median": 0.5, "p99": 0.99, "max": 1.0}
    for kind, (pause_s, prepared) in PAUSES.items():
        recorder = Recorder()
        assembly = assemble(load("grass", overrides)[1], SEED)

        def wait(_: int, pause_s: float = pause_s) -> None:
            time.sleep(pause_s)

        drive_into(recorder, assembly, on_tick=wait, prepared=prepared)
        update, step, qp = recorder.record()[TIMING].values[1:, :3].T  # the first tick sets up
        for name, share in quantiles.items():
            found.append(Figure(f"step, {kind}, {name}", float(np.quantile(step, share)), "µs"))
        if pause_s:
            tail = float(np.quantile(step[~(qp > 0.0)], 0.99))
            found.append(Figure(f"step, {kind}, p99 without PIQP", tail, "µs", most=100.0))
        else:
            both = float(np.median(update + step))
            found.append(Figure(f"update and step, {kind}, median", both, "µs", most=200.0))
    return found


# --- Loop ----------------------------------------------------------------------------------


def bare_step_s(steps: int = 500, blocks: int = 20) -> float:
    """Return the time of a bare `mj_step` [s]: the frozen unit of all ratios.

    The vehicle is a file: that of release 0.2.0 in motion, with its two constraints of the
    steering, without ground, gravity, contacts and MuJoCo's clock. The fastest block counts.
    """
    model = mujoco.MjModel.from_xml_path(str(Path(__file__).parent / "baseline" / "vehicle.xml"))
    moving = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, moving, 0)
    return _step_s(model, moving, steps, blocks)


def own_bare_step_s(plant: Plant, steps: int = 500, blocks: int = 20) -> float:
    """Return the time of a bare `mj_step` of a plant's own model [s], the fastest block.

    At 1 m/s, without gravity, contacts and MuJoCo's clock.
    """
    model = copy.copy(plant.model)
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    plant.reset(0.0, 0.0, 0.0, 1.0)
    return _step_s(model, plant.data, steps, blocks)


def _step_s(
    model: mujoco.MjModel, start: mujoco.MjData, steps: int, blocks: int, clocked: bool = False
) -> float:
    """Return the time of a step from a state [s], the fastest block of so many steps."""
    data = mujoco.MjData(model)
    clock = Clock.of_library()
    times = []
    if not clocked:
        clock.variable[0] = 0
    for _ in range(blocks):
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start.qpos
        data.qvel[:] = start.qvel
        data.act[:] = start.act
        data.ctrl[:] = start.ctrl
        begin = time.thread_time()
        mujoco.mj_step(model, data, steps)
        times.append(time.thread_time() - begin)
    clock.variable[0] = clock.address
    return min(times) / steps


def soil_step_s(vehicle: PlantVehicle, timestep_s: float = 0.002, blocks: int = 20) -> float:
    """Return the time of a step on rough soil with its truths at 25 Hz [s], the fastest block."""
    rough = terrain.rough("D", generator(1, "terrain"))
    plant = Plant(vehicle, rough, SoilMap(600.0), timestep_s=timestep_s)
    times = []
    plant.reset(0.0, 0.0, 0.0, 1.0)
    command = Command(0.05, 0.0, 0.4)
    stride = round(0.04 / timestep_s)
    plant.advance(command, 25 * stride)
    start = plant.snapshot()
    for _ in range(blocks):
        plant.restore(start)
        begin = time.thread_time()
        for _ in range(5):
            plant.drive(command, 5, stride)
        times.append((time.thread_time() - begin) / (25 * stride))
    return min(times)


def gymnasium_ratios(environments: Sequence[str], steps: int = 500) -> list[Figure]:
    """Return what a step of environments of gymnasium costs, their own bare step being 1.

    Nothing where its package is not installed (`pip install 'gymnasium[mujoco]'`). As its users
    have them: with contacts, MuJoCo's clock and random actions.
    """
    if importlib.util.find_spec("imageio") is None:  # gymnasium itself is always there
        return []
    import gymnasium

    figures = []
    for name in environments:
        environment = gymnasium.make(name).unwrapped
        environment.reset(seed=SEED)
        environment.action_space.seed(SEED)
        times = []
        for _ in range(5):
            begin = time.thread_time()
            for _ in range(steps):
                environment.step(environment.action_space.sample())
            times.append((time.thread_time() - begin) / (steps * environment.frame_skip))
            environment.reset()
        bare = _step_s(environment.model, environment.data, steps, 10, clocked=True)
        figures.append(Figure(f"gymnasium {name} / its own bare step", min(times) / bare))
    return figures


def _straight(length_m: float) -> str:
    return f"path={{kind='straight',length_m={length_m}}}"


def _drive(path: str, logged: bool) -> tuple[float, float, float]:
    """Return processor time of all threads, simulated time [s] and log [MB] of a path."""
    name, scenario = load("grass", [path])
    assembly = assemble(scenario, SEED)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "log.mcap"
        about = describe(name, scenario, SEED, assembly)
        begin = time.process_time()
        if logged:
            with open_log(file, scenario, assembly, assembly.scenery, about) as log:
                outcome = drive_into(Tee(Recorder(), log), assembly, prepared=False)
        else:
            outcome = drive_into(Recorder(), assembly, prepared=False)
        spent = time.process_time() - begin
        return spent, outcome.duration_s, 1e-6 * file.stat().st_size if logged else 0.0


def loop_ratio(
    lengths: tuple[float, float] = (12.0, 32.0), repeats: int = 8, blocks: int = 20
) -> list[Figure]:
    """Return the cost of the physics and of the whole loop, the frozen bare step being 1.

    Everything alternates in one process; the fastest of the repeats counts. The loop is the slope
    between two straights, so that its set-up drops out.
    """
    vehicle = assemble(load("grass", ())[1], SEED).plant.vehicle
    spent = defaultdict(list)
    simulated = {}
    size = {}
    for _ in range(repeats):
        spent["bare"].append(bare_step_s(blocks=blocks))
        for timestep_s in (0.002, 0.004):
            spent[timestep_s].append(soil_step_s(vehicle, timestep_s, blocks))
        for logged, length in itertools.product((False, True), lengths):
            taken, simulated[length], size[length] = _drive(_straight(length), logged)
            spent[logged, length].append(taken)
    least = {what: min(times) for what, times in spent.items()}
    bare = least["bare"]
    short, long = lengths
    duration_s = simulated[long] - simulated[short]
    steps = duration_s / 0.002
    plain, logged = ((least[log, long] - least[log, short]) / steps for log in (False, True))
    return [
        Figure("frozen bare `mj_step`", 1e6 * bare, "µs"),
        Figure("physics on soil / bare step", least[0.002] / bare, most=1.05),
        Figure("the same at 4 ms", least[0.004] / bare, most=1.05),
        Figure("loop without log / bare step", plain / bare, most=1.4),
        Figure("loop with log / bare step", logged / bare, most=1.6),
        Figure("loop without log, simulated s a s", 0.002 / plain, least=150.0),
        Figure("log, kB a simulated s", 1e3 * (size[long] - size[short]) / duration_s, most=100.0),
    ]


def eight_ratio(repeats: int = 4) -> list[Figure]:
    """Return the cost of a lap of the default path, all in, in frozen and in own bare steps.

    The log's opening and closing count, the set-up of the run does not: it has a figure of its
    own. Everything alternates in one process; the fastest of the repeats counts.
    """
    scenario = load("grass", ["path.laps=1"])[1]
    spent = defaultdict(list)
    duration_s = 0.0
    for _ in range(repeats):
        begin = time.process_time()
        plant = assemble(scenario, SEED).plant
        spent["set-up"].append(time.process_time() - begin)
        spent["frozen"].append(bare_step_s())
        spent["own"].append(own_bare_step_s(plant))
        for logged in (False, True):
            taken, duration_s, _ = _drive("path.laps=1", logged)
            spent[logged].append(taken)
    least = {what: min(times) for what, times in spent.items()}
    steps = duration_s / 0.002
    figures = [
        Figure("own bare `mj_step`", 1e6 * least["own"], "µs"),
        Figure("set-up of a run in a warm process", least["set-up"], "s"),
    ]
    for logged, words, most in ((False, "without log", 2.0), (True, "with log", 2.4)):
        step = least[logged] / steps
        frozen = step / least["frozen"]
        figures += [
            Figure(f"lap {words} / frozen bare step", frozen),
            Figure(f"lap {words} / own bare step", step / least["own"], most=most),
        ]
    run_s = least["set-up"] + least[False]
    for runs in (1_000, 10_000, 100_000):
        figures.append(Figure(f"{runs} laps, set-up included", runs * run_s / 3600.0, "core h"))
    return figures + gymnasium_ratios(("Humanoid-v5", "Ant-v5", "HalfCheetah-v5"))


def effect_ratios(repeats: int = 6, blocks: int = 6) -> list[Figure]:
    """Return what each effect of the table `effects` adds to a step of the physics on `farm`.

    In frozen bare steps; plants with and without it alternate, the fastest block counts.
    """
    plants = {}
    for name, changes in EFFECTS.items():
        plant = plants[name] = assemble(load("farm", (*BASE, *changes))[1], SEED).plant
        plant.reset(0.0, 0.0, 0.0, 1.5)
        plant.advance(Command(0.05, 0.0, 0.5), 1000)
    starts = {name: plant.snapshot() for name, plant in plants.items()}
    spent = defaultdict(list)
    for _ in range(repeats):
        spent["bare"].append(bare_step_s())
        for (name, plant), _ in itertools.product(plants.items(), range(blocks)):
            plant.restore(starts[name])
            begin = time.thread_time()
            plant.drive(Command(0.05, 0.0, 0.5), 25, 20)
            spent[name].append((time.thread_time() - begin) / 500)
    least = {name: min(times) for name, times in spent.items()}
    ratios = {name: (least[name] - least["none"]) / least["bare"] for name in EFFECTS}
    return [Figure(f"{name}, bare steps", ratio) for name, ratio in ratios.items()][1:]


def calls_of_a_period(
    overrides: Sequence[str] = (), ticks: int = 40, scenario: str = "grass"
) -> dict[str, float]:
    """Return the Python calls of a control period in memory, by stage: exact counts.

    Calls of `Guidance.update` and `Guidance.step` stand under their own names, those of no stage
    under "loop". The first ticks of the run do not count.
    """
    parts = {stage.__code__: stage.__name__ for stage in STAGES if isinstance(stage, FunctionType)}
    parts |= {Guidance.update.__code__: "update", Guidance.step.__code__: "step"}
    counts = Counter[str]()
    inside = ["loop"]

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

    assembly = replace(assemble(load(scenario, overrides)[1], SEED), ticks=2 * ticks + 1)
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
        Figure("Python calls of `Guidance.update` and `step`", guidance),
        Figure("Python calls of the loop beside them", own),
        Figure("Python calls of a whole period", guidance + own, most=150.0),
        Figure(
            "Python calls of a whole period of `cultivate`",
            sum(calls_of_a_period(scenario="cultivate").values()),
            most=150.0,
        ),
    ]


# --- Processes ------------------------------------------------------------------------------------

_METRE: Final = "path={kind='straight',length_m=1}"
_COMMAND: Final = (sys.executable, "-m", "proving_ground.experiments.commands.cli")


_ADOPT: Final = 36  # PR_SET_CHILD_SUBREAPER of prctl(2)


def _children() -> set[int]:
    """Return the numbers of the processes whose parent is this one."""
    files = Path("/proc/self/task").glob("*/children")
    return {int(number) for file in files for number in read_bounded(file).split()}


def process_s(*command: str, cache: str | None = None) -> float:
    """Return the processor time of a process and of all that it starts [s], to the end of the last.

    Those that it does not wait for, such as the second compiler of a first run, become children of
    this process when it ends (Linux), which waits for them.

    Args:
        command: words of the command.
        cache: folder for its kernels; None: that of this process.
    """
    ctypes.CDLL(None).prctl(_ADOPT, 1, 0, 0, 0)
    before = _children()
    begin = resource.getrusage(resource.RUSAGE_CHILDREN)
    own = {"NUMBA_CACHE_DIR": cache} if cache else {}
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, **own})
    while adopted := _children() - before:
        os.waitpid(adopted.pop(), 0)
    end = resource.getrusage(resource.RUSAGE_CHILDREN)
    return end.ru_utime + end.ru_stime - begin.ru_utime - begin.ru_stime


def start_up(repeats: int = 5) -> list[Figure]:
    """Return the processor time of help, import, and a run of 1 m, the first one compiling."""
    with tempfile.TemporaryDirectory() as folder:
        outs = (f"{folder}/{k}" for k in itertools.count())

        def run(cache: str | None = None) -> float:
            words = ("run", "grass", "--out", next(outs), "--set", _METRE)
            return process_s(*_COMMAND, *words, cache=cache)

        run()  # kernels are in the cache from here on
        warm = min(run() for _ in range(repeats))
        first = run(f"{folder}/kernels")
        kernels = len([*Path(folder, "kernels").rglob("*.code")])
    imports = (sys.executable, "-c", "from ttempc import Guidance")
    return [
        Figure("`ttempc --help`", min(process_s(*_COMMAND, "--help") for _ in "12345"), "s", 0.3),
        Figure("`from ttempc import Guidance`", min(process_s(*imports) for _ in "12345"), "s"),
        Figure("`ttempc run` of 1 m", warm, "s", most=3.0),
        Figure("compilation of its kernels", first - warm, "s", most=12.0),
        Figure("kernels", kernels, most=60.0),
    ]


# --- Sweep ----------------------------------------------------------------------------------------


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Hide the main module of this process: workers load what workers of `ttempc sweep` load."""
    kept = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = kept


def _sweep(study: Study, workers: int, parent: Path) -> tuple[float, list[Row], float]:
    """Return the time of a sweep on warm workers [s], its rows, and a worker's peak [MB]."""
    taken = 0.0
    folder = None
    with _without_main(), engine(workers) as cores:
        for seeds in (workers, study.seeds):
            plan = SweepPlan("benchmark", replace(study, seeds=seeds))
            folder = SweepFolder(Path(tempfile.mkdtemp(dir=parent)), Origin.here("", plan.size))
            begin = time.perf_counter()
            sweep(plan, folder, cores)
            taken = time.perf_counter() - begin
        peak = cores.executor.submit(peak_mb).result()
    assert folder is not None
    return taken, list(rows(folder.results)), peak


def sweeps(seeds: int = 4) -> list[Figure]:
    """Return speed, overhead and memory of workers."""
    axis = ListAxis(kind="list", key="controller", values=("ttempc-nominal", "paper"))
    found = []
    taken = {}
    with tempfile.TemporaryDirectory() as folder:
        for workers, timestep_s, least in ((1, 0.002, 150.0), (2, 0.002, 150.0), (2, 0.004, 250.0)):
            changes = {"path": {"laps": 1}, "plant": {"timestep_s": timestep_s}}
            study = Study(seeds=seeds, set=changes, axis=(axis,))
            spent, driven, peak = _sweep(study, workers, Path(folder))
            taken.setdefault(workers, spent)
            busy = sum(float(row["wall_s"] or 0.0) for row in driven)
            simulated = sum(float(row["duration_s"] or 0.0) for row in driven)
            overhead = 100.0 * (workers * spent / busy - 1.0)
            on = f"{workers} worker{'s' * (workers > 1)}, {1e3 * timestep_s:g} ms"
            found += [
                Figure(f"{on}, simulated s a s and core", simulated / busy, least=least),
                Figure(f"{on}, time without a run", overhead, "%", most=5.0),
                Figure(f"{on}, peak memory of one", peak, "MB", most=250.0),
            ]
    found.append(Figure("parallel efficiency", taken[1] / (2.0 * taken[2]), least=0.95))
    return found


def threads(repeats: int = 3) -> list[Figure]:
    """Return how much faster two threads of a process drive two runs than one thread does."""
    scenario = load("grass", ["path.laps=1"])[1]

    def wall_s(width: int) -> float:
        runs = [assemble(scenario, SEED) for _ in range(2)]
        begin = time.perf_counter()
        with ThreadPoolExecutor(width) as pool:
            list(pool.map(lambda run: drive_into(Recorder(), run, prepared=False), runs))
        return time.perf_counter() - begin

    one, two = (min(wall_s(width) for _ in range(repeats)) for width in (1, 2))
    return [Figure("two threads of one process / one thread", one / two, least=1.7)]


# --- Table ----------------------------------------------------------------------------------------

PARTS: Final[Mapping[str, Callable[[], list[Figure]]]] = {
    "ticks": ticks,
    "loop": loop_ratio,
    "eight": eight_ratio,
    "effects": effect_ratios,
    "calls": calls,
    "start-up": start_up,
    "sweep": sweeps,
    "threads": threads,
}
"""Benchmarks by name."""


def table() -> str:
    """Measure all parts and return the machine and their figures beside their limits (Markdown)."""
    load_ = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    where = ", ".join(f"{name} {value}" for name, value in {**machine(), "load": load_}.items())
    lines = []
    for part, measure in PARTS.items():
        print(part, file=sys.stderr, flush=True)
        for item in measure():
            value = f"{item.value:.0f}" if abs(item.value) >= 100.0 else f"{item.value:.3g}"
            lines.append((part, item.name, f"{value} {item.unit}".rstrip(), item.limit))
    return f"{where}\n\n{markdown(('part', 'figure', 'value', 'limit'), lines)}"


TABLES: Final = (Table(name="performance", make=lambda runner: table()),)


def main() -> None:
    """Measure and print the table."""
    settle_numerics()
    print(table())


if __name__ == "__main__":  # as a module of its own name, by which processes find its functions
    importlib.import_module(f"{__package__}.benchmarks").main()
