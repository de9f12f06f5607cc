"""Growth of cost and memory with the size of what is asked, with exponents.

    python -m proving_ground.experiments.papers growth

Leave the machine idle. Processor times of all threads, the fastest of several repeats. An exponent
of 1 is in proportion to the size, 0 does not depend on it.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from ...testbed.recording.channels import TIMING
from ...testbed.recording.record import Recorder, Tee
from ..run.assembly import assemble
from ..run.run_log import describe, open_log
from ..run.simulate import drive_into, simulate
from ..scenario.scenario import load
from ..studies.sweep.plan import SweepPlan
from ..studies.sweep.results import Results, frame, rows
from ..studies.sweep.row import Row, figures, line
from ..studies.sweep.study import DrawnAxis, Study
from .markdown import markdown
from .table import Table

SEED: Final = 1
REPEATS: Final = 3
_SHORT: Final = "path={kind='straight', length_m=15}"

Figures = dict[str, float]
"""Measured values by what they are, with their unit in brackets."""


@dataclass(frozen=True)
class Growth:
    """What grows, its sizes, and how its figures at a size are measured."""

    sizes: Sequence[int]
    measure: Callable[[int], Figures]


def _processor_s(work: Callable[[], object]) -> float:
    """Return the processor time of the fastest repeat, all threads counted [s]."""
    taken = []
    for _ in range(REPEATS):
        begin = time.process_time()
        work()
        taken.append(time.process_time() - begin)
    return min(taken)


# --- Sweeps ---------------------------------------------------------------------------------------


def of_points(count: int) -> Figures:
    """Return what the driver of a sweep of drawn points does before its first run."""
    axis = DrawnAxis(kind="random", key="soil.cone_index_kpa", low=600.0, high=1500.0)
    study = Study(samples=count, axis=(axis,))
    return {"survey [s]": _processor_s(lambda: SweepPlan("growth", study).extent())}


def of_rows(count: int) -> Figures:
    """Return what the rows of a sweep take when it goes on, and when they are read as a frame."""
    name, scenario = load("grass", [_SHORT])
    summary, _ = simulate(name, scenario, SEED)
    row: Row = {"run": 0, "point": 0, "scenario": name, "seed": SEED, **figures(summary)}
    with TemporaryDirectory() as folder:
        file = Path(folder) / "results.jsonl"
        with file.open("w", encoding="utf-8") as stream:
            stream.writelines(line({**row, "run": run}) for run in range(count))
        table = frame(rows(file))
        return {
            "resume [s]": _processor_s(lambda: Results(file, count).__exit__()),
            "read as a frame [s]": _processor_s(lambda: frame(rows(file))),
            "frame [kB a row]": 1e-3 * float(table.memory_usage(deep=True).sum()) / count,
            "file [kB a row]": 1e-3 * file.stat().st_size / count,
        }


# --- Runs -----------------------------------------------------------------------------------------


def _drive(*overrides: str) -> Figures:
    """Return quantiles of the control step, and the processor time of a simulated second."""
    recorder = Recorder()
    assembly = assemble(load("grass", overrides)[1], SEED)
    begin = time.process_time()
    outcome = drive_into(recorder, assembly, prepared=False)
    spent = time.process_time() - begin
    step = recorder.record()[TIMING]["control_step_us"][1:]  # the first tick sets up
    return {
        "step, median [µs]": float(np.median(step)),
        "step, p99 [µs]": float(np.quantile(step, 0.99)),
        "run [ms a simulated s]": 1e3 * spent / outcome.duration_s,
    }


def _fastest(*overrides: str) -> Figures:
    """Return the least of each figure over the repeats."""
    found = [_drive(*overrides) for _ in range(REPEATS)]
    return {name: min(one[name] for one in found) for name in found[0]}


def of_rate(rate_hz: int) -> Figures:
    """Return the cost of a run at a control rate."""
    return _fastest(_SHORT, f"control.rate_hz={rate_hz}")


def of_horizon(periods: int) -> Figures:
    """Return the cost of a run with a horizon of the MPC, at 5 Hz."""
    return _fastest(_SHORT, f"controller.options.horizon={periods}")


def of_field(side_m: int) -> Figures:
    """Return the set-up of a run on a square field."""
    scenario = load("grass", [_SHORT, f"terrain.size_x_m={side_m}", f"terrain.size_y_m={side_m}"])
    return {"set-up [s]": _processor_s(lambda: assemble(scenario[1], SEED))}


def of_laps(laps: int) -> Figures:
    """Return the cost of a run by its length, with its log."""
    name, scenario = load("grass", [f"path.laps={laps}"])
    assembly = assemble(scenario, SEED)
    recorder = Recorder()
    with TemporaryDirectory() as folder:
        file = Path(folder) / "log.mcap"
        about = describe(name, scenario, SEED, assembly)
        begin = time.process_time()
        with open_log(file, scenario, assembly, assembly.scenery, about) as log:
            drive_into(Tee(recorder, log), assembly, prepared=False)
        spent = time.process_time() - begin
        record = recorder.record()
        held = sum(table.values.nbytes + table.time_s.nbytes for table in record.tables.values())
        return {
            "run with log [s]": spent,
            "log [MB]": 1e-6 * file.stat().st_size,
            "record [MB]": 1e-6 * held,
        }


GROWTHS: Final[Mapping[str, Growth]] = {
    "drawn points of a sweep": Growth((100, 1_000, 10_000), of_points),
    "rows of a sweep": Growth((1_000, 10_000, 100_000), of_rows),
    "control rate [Hz]": Growth((5, 10, 25, 50, 100), of_rate),
    "horizon [periods]": Growth((10, 20, 40, 80, 120), of_horizon),
    "side of the field [m]": Growth((50, 100, 200, 400), of_field),
    "laps": Growth((1, 2, 4, 8), of_laps),
}
"""What grows, by name."""


def exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """Return the exponent p of the power law value = c size^p that fits best, by logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def table() -> str:
    """Measure every growth and return its figures with their exponents (Markdown)."""
    lines = []
    for name, growth in GROWTHS.items():
        found = [growth.measure(size) for size in growth.sizes]
        for figure in found[0]:
            values = [one[figure] for one in found]
            pairs = zip(growth.sizes, values, strict=True)
            at_sizes = ", ".join(f"{size:,}: {value:.3g}" for size, value in pairs)
            power = round(exponent(growth.sizes, values), 2) + 0.0  # no sign of a zero
            lines.append((name, figure, at_sizes, f"{power:.2f}"))
    return markdown(("what grows", "figure", "at sizes", "exponent"), lines)


TABLES: Final = (Table(name="growth", make=lambda runner: table()),)
