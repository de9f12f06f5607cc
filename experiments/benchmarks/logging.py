"""What a log costs: the share of a run's time that logging takes, and the size of the file.

Run with `python -m experiments.benchmarks.logging [RATE_HZ]`. The clock is that of the thread and
runs whenever the run is inside the log, opening and closing included: a run waits for nothing, so
that on an idle machine this is its wall time, and on a busy one the ratio stays what it is. What
looking at the clock itself takes is no part of either.
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
    """A sink with a stop watch."""

    def __init__(self, inner: Sink) -> None:
        self.inner, self.spent_ns, self.calls = inner, 0, 0

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Hand on one row."""
        start = time.thread_time_ns()
        self.inner.row(channel, time_s, values)
        self._stop(start)

    def event(self, event: Event) -> None:
        """Hand on one event."""
        start = time.thread_time_ns()
        self.inner.event(event)
        self._stop(start)

    def scene(self, truth: Truth) -> None:
        """Hand on one scene."""
        start = time.thread_time_ns()
        self.inner.scene(truth)
        self._stop(start)

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Hand on one path."""
        start = time.thread_time_ns()
        self.inner.path(topic, time_s, points)
        self._stop(start)

    def _stop(self, start_ns: int) -> None:
        self.spent_ns += time.thread_time_ns() - start_ns
        self.calls += 1


def _reading_ns() -> float:
    """Return what one look at the clock takes, a microsecond where that asks the kernel [ns]."""
    looks = [time.thread_time_ns() for _ in range(20_001)]
    return (looks[-1] - looks[0]) / (len(looks) - 1)


def measure(record_hz: float, overrides: Sequence[str] = ()) -> tuple[float, float, float]:
    """Return the time of a run and what of it the log took [s], and the log's size [MB]."""
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
    looking = timed.calls * _reading_ns()  # half of the two looks at each call are in its time
    spent = opened - start + timed.spent_ns - looking + closed - driven
    return 1e-9 * (closed - start - 2.0 * looking), 1e-9 * spent, 1e-6 * size


def main() -> None:
    """Print the figures; exit code 1 where a log costs more than it may."""
    record_hz = float(sys.argv[1]) if len(sys.argv) > 1 else RATE_HZ
    measure(record_hz, ["path={kind='straight', length_m=15}"])  # compiles what is compiled late
    wall, spent, size = measure(record_hz)
    print(f"two laps of grass, truth at {record_hz:g} Hz")
    print(f"  run           {wall:7.2f} s, log included")
    print(f"  log           {spent:7.2f} s")
    print(f"  share         {100 * spent / wall:7.1f} %   (at most {100 * LARGEST_SHARE:.0f})")
    print(f"  size          {size:7.1f} MB  (at most {LARGEST_MB:.0f})")
    if spent > LARGEST_SHARE * wall or size > LARGEST_MB:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
