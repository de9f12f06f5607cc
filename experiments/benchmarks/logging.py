"""Cost of a log: its share of a run's time, and the size of the file.

    python -m experiments.benchmarks.logging [RATE_HZ]

Times are thread times, so that the ratio does not depend on other processes; a run never waits, so
that on an idle machine they equal wall times. The time of the log includes opening and closing. The
cost of reading the clock is subtracted from both.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from proving_ground.testbed.recording.channels import Channel
from proving_ground.testbed.recording.record import Event, Recorder
from proving_ground.testbed.recording.sink import Sink, Tee
from proving_ground.testbed.truth import Truth
from ttempc.types import FloatArray

from ..run.assembly import assemble
from ..run.log_file import describe, open_log
from ..run.simulate import drive_into
from ..scenario.scenario import load

LARGEST_SHARE: Final = 0.10  # of the time of the run
LARGEST_MB: Final = 30.0  # for two laps
RATE_HZ: Final = 50.0


class Timed:
    """A sink that measures the thread time spent in it."""

    def __init__(self, inner: Sink) -> None:
        self.inner, self.spent_ns, self.calls = inner, 0, 0

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Pass one row on."""
        start = time.thread_time_ns()
        self.inner.row(channel, time_s, values)
        self._stop(start)

    def event(self, event: Event) -> None:
        """Pass one event on."""
        start = time.thread_time_ns()
        self.inner.event(event)
        self._stop(start)

    def scene(self, truth: Truth) -> None:
        """Pass one scene on."""
        start = time.thread_time_ns()
        self.inner.scene(truth)
        self._stop(start)

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Pass one path on."""
        start = time.thread_time_ns()
        self.inner.path(topic, time_s, points)
        self._stop(start)

    def _stop(self, start_ns: int) -> None:
        self.spent_ns += time.thread_time_ns() - start_ns
        self.calls += 1


def _reading_ns() -> float:
    """Return the cost of reading the clock [ns]; a system call takes a microsecond."""
    readings = [time.thread_time_ns() for _ in range(20_001)]
    return (readings[-1] - readings[0]) / (len(readings) - 1)


def measure(record_hz: float, overrides: Sequence[str] = ()) -> tuple[float, float, float]:
    """Return the time of a run and of its log [s], and the size of the log [MB]."""
    name, scenario = load("grass", list(overrides))
    assembly = assemble(scenario, 1)
    recorder = Recorder()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "log.mcap"
        start = time.thread_time_ns()
        metadata = describe(name, scenario, 1, assembly)
        log = open_log(file, scenario, assembly, assembly.plant.scenery, metadata)
        opened = time.thread_time_ns()
        with log:
            timed = Timed(log)
            drive_into(Tee(recorder, timed), assembly, record_hz)
            driven = time.thread_time_ns()
        closed = time.thread_time_ns()
        size = file.stat().st_size
    reading = timed.calls * _reading_ns()  # half of the two readings of each call are in its time
    spent = opened - start + timed.spent_ns - reading + closed - driven
    return 1e-9 * (closed - start - 2.0 * reading), 1e-9 * spent, 1e-6 * size


def main(record_hz: float = RATE_HZ, overrides: Sequence[str] = ()) -> None:
    """Print the figures; exit code 1 if a log exceeds a limit."""
    measure(record_hz, ["path={kind='straight', length_m=15}"])  # compiles functions on first use
    wall, spent, size = measure(record_hz, overrides)
    print(f"two laps of grass, truth at {record_hz:g} Hz")
    print(f"  run           {wall:7.2f} s, log included")
    print(f"  log           {spent:7.2f} s")
    print(f"  share         {100 * spent / wall:7.1f} %   (at most {100 * LARGEST_SHARE:.0f})")
    print(f"  size          {size:7.1f} MB  (at most {LARGEST_MB:.0f})")
    if spent > LARGEST_SHARE * wall or size > LARGEST_MB:
        raise SystemExit(1)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else RATE_HZ)
