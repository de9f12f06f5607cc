"""How a run ends."""

from types import SimpleNamespace

import pytest
from proving_ground.testbed.simulation.outcome import end_of
from proving_ground.testbed.simulation.termination import TerminationLimits

TICKS = 10
FAR_M = 2.0 * TerminationLimits().deviation


@pytest.mark.parametrize(
    ("reference_tick", "left_m", "end"),
    [
        (TICKS - 1, 0.0, None),
        (TICKS, 0.0, ("completed", None)),
        (TICKS, FAR_M, None),  # by place, and slower than its reference
        (TICKS + 1, 0.0, ("completed", None)),
    ],
)
@pytest.mark.parametrize("early", [None, "lost", "stopped"])
def test_a_run_ends_with_its_reference_and_near_its_place_or_early(
    reference_tick, left_m, end, early
):
    why = {"lost": None, "stopped": None}
    if early:
        why[early] = "a reason"
        end = (early, "a reason")
    setup = SimpleNamespace(
        guidance=SimpleNamespace(reference_tick=reference_tick),
        distance_left_m=lambda step, x, y: left_m,
        control_steps=100,
        termination=TerminationLimits(),
    )
    tick = SimpleNamespace(now=SimpleNamespace(tractor=(0.0, 0.0, 0.0)), **why)
    assert end_of(setup, tick, TICKS) == end
