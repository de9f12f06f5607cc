"""Outcome of a run: how it ended, and why."""

from dataclasses import dataclass
from typing import Final, Literal

from .setup import SimulationSetup, TickContext

LONGEST: Final = 3  # a run may take that many times its own length; assumed

Status = Literal["completed", "stopped", "lost", "invalid"]

End = tuple[Status, str | None]
"""Status of a run, and why it did not complete."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended."""

    status: Status
    failure: str | None  # why, where it did not complete
    duration_s: float  # simulated time
    wall_s: float
    traceback: str | None = None  # of an exception in a user's controller or estimator


def end_of(setup: SimulationSetup, tick: TickContext, ticks: int) -> End | None:
    """Return how the run ends after this tick, None where it goes on."""
    if tick.lost:
        return "lost", tick.lost
    if tick.stopped:
        return "stopped", tick.stopped
    if setup.guidance.reference_tick < ticks:
        return None
    if _distance_left_m(setup, tick, ticks) > setup.termination.deviation:
        return None
    return "completed", None


def end_without_arrival(setup: SimulationSetup, tick: TickContext, ticks: int) -> End:
    """Return how a run ends that has taken `LONGEST` times its own length."""
    if setup.guidance.reference_tick < ticks:
        why = setup.guidance.diagnostics.fallback
        return "stopped", f"{why}: the reference waited too long"
    left_m = _distance_left_m(setup, tick, ticks)
    after = f"after {LONGEST} times the time of its reference"
    return "lost", f"{left_m:.0f} m of its path are left {after}"


def _distance_left_m(setup: SimulationSetup, tick: TickContext, ticks: int) -> float:
    """Return the distance along the reference from the tractor to tick `ticks` of it [m]."""
    return setup.distance_left_m(ticks * setup.control_steps, *tick.now.tractor[:2])
