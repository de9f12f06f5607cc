"""A drive whose alarms are listed as they begin."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ttempc.detectors.interface import Alarm, Reaction
from ttempc.guidance.guidance import Guidance
from ttempc.guidance.safety import CORRIDOR
from ttempc.layout import TICK

from ...testbed.recording.record import Record, Recorder
from ...testbed.simulation.outcome import Outcome
from ..run.assembly import assemble
from ..run.simulate import drive_into
from ..studies.sweep.work import SweepJob


@dataclass(frozen=True, slots=True)
class Begun:
    """An alarm, or an act of the supervisor without one, at its first tick."""

    time_s: float
    cause: str  # name of the detector, or the supervisor's words
    reaction: Reaction
    acts: bool  # the vehicle slows down, stops or does without a sensor


class Listener:
    """List of what began, which is told every tick."""

    def __init__(self, guidance: Guidance) -> None:
        self.begun: list[Begun] = []
        self._guidance = guidance
        self._standing: dict[str, Begun] = {}

    def observe(self, k: int) -> None:
        """Note what began at tick k."""
        time_s = k * self._guidance.period_s
        now = {alarm.detector: _of_alarm(time_s, alarm) for alarm in self._guidance.alarms}
        if not now and (words := self._act_without_alarm()):
            now = {words: Begun(time_s, words, Reaction.SLOW, acts=True)}
        self.begun += [one for name, one in now.items() if name not in self._standing]
        self._standing = now

    def _act_without_alarm(self) -> str:
        """Return why the supervisor acts; empty for a corridor, and before the first estimate."""
        tick = self._guidance.tick_record.view(TICK)[0]
        acts = tick["reason"] not in (0.0, CORRIDOR) or tick["cut"].any()
        acts = acts and not self._guidance.waits_for_estimate
        return self._guidance.diagnostics.fallback if acts else ""


def _of_alarm(time_s: float, alarm: Alarm) -> Begun:
    acts = alarm.reaction is not Reaction.WARN or bool(alarm.unused)
    return Begun(time_s, alarm.detector, alarm.reaction, acts)


def drive_and_list(
    job: SweepJob, until_s: float | None = None
) -> tuple[Outcome, Record, list[Begun]]:
    """Drive a run, to a time of its reference where one is given, and list what began in it."""
    assembly = assemble(job.scenario, job.seed)
    if until_s is not None:
        ticks = round(until_s / assembly.guidance.period_s)
        assembly = replace(assembly, ticks=min(assembly.ticks, ticks))
    listener = Listener(assembly.guidance)
    recorder = Recorder()
    outcome = drive_into(recorder, assembly, on_tick=listener.observe, prepared=False)
    return outcome, recorder.record(), listener.begun
