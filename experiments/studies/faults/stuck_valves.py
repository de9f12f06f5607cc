"""Detection delay of stuck steering valves: from their start, and from when they show.

    python -m experiments.studies.faults.stuck_valves [SEEDS]                        (default: 16)

Drives `grass` with each steering valve stuck from `START_S` on. The fault shows where the residual
of `StandstillMonitor` is above 2 deg: the measured angle is that far from the response of a healthy
valve, more where noise or play is larger. In a steady curve the commands hardly ask for motion
before. Prints medians and largest times for docs/faults.md.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ttempc.guidance.detection import StandstillMonitor

from ....testbed.recording.record import REACTION, Recorder
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...scenario.scenario import load
from ...seeds import report_seeds
from ..batch import run_tasks
from .cases import START_S
from .study import SCENARIO, SEEDS

VALVES: Final = ("front steering", "trailer steering")
SHOWS: Final = math.radians(2.0)
_SECONDS: Final = 8.0  # after the start of the fault


@dataclass(frozen=True, slots=True)
class StuckValve:
    """A drive with a stuck valve."""

    valve: str  # of `VALVES`
    seed: int


def times_s(task: StuckValve) -> tuple[float, float]:
    """Return when the fault shows and when the supervisor reacts, from its start; NaN: not."""
    kind = f"{task.valve.replace(' ', '_')}_stuck"
    fault = f"faults=[{{kind='{kind}', start_s={START_S}}}]"
    assembly = assemble(load(SCENARIO, [fault])[1], task.seed)
    guidance, period_s = assembly.guidance, assembly.guidance.period_s
    monitors = [item for item in guidance.detectors if isinstance(item, StandstillMonitor)]
    monitor = monitors[VALVES.index(task.valve)]
    shown_s = math.nan

    def observe(k: int) -> None:
        nonlocal shown_s
        since_s = k * period_s - START_S
        if math.isnan(shown_s) and since_s > 0.0 and abs(monitor.residual) > SHOWS:
            shown_s = since_s

    recorder = Recorder()
    ticks = round((START_S + _SECONDS) / period_s)
    drive_into(recorder, replace(assembly, ticks=ticks), on_tick=observe, prepared=False)
    begun = (item.time_s for item in recorder.record().events if item.text.startswith(REACTION))
    return shown_s, next((time_s - START_S for time_s in begun if time_s > START_S), math.nan)


def main(seeds: tuple[int, ...] = SEEDS) -> None:
    """Drive with both valves and print the times."""
    tasks = [StuckValve(valve, seed) for valve in VALVES for seed in seeds]
    times = np.array(list(run_tasks(times_s, tasks, "valves"))).reshape(len(VALVES), -1, 2)
    print("| stuck | shows after [s] | noticed after [s] | after it shows [s] |\n|---|---|---|---|")
    for valve, (shown_s, noticed_s) in zip(VALVES, times.transpose(0, 2, 1), strict=True):
        cells = [
            f"{np.nanmedian(row):.1f}, at most {np.nanmax(row):.1f}"
            for row in (shown_s, noticed_s, noticed_s - shown_s)
        ]
        print(f"| {valve} | {' | '.join(cells)} |")


if __name__ == "__main__":
    count = int((sys.argv[1:] or [str(len(SEEDS))])[0])
    main(report_seeds(count))
