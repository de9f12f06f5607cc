"""Termination conditions, each with its reason."""

import math
import re

import pytest
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.simulation.termination import (
    MeanSlip,
    TerminationLimits,
    check_termination,
)

from tests.testbed.truths import truth

FIELD = flat(size_m=(80.0, 50.0))


def verdict(state, reference=(0.0, 0.0), slip=0.0):
    distance_m = math.dist(state.tractor[:2], reference)
    return check_termination(state, distance_m, FIELD, TerminationLimits(), slip)


def test_normal_driving_does_not_terminate():
    assert verdict(truth()) is None
    assert verdict(truth(tractor={"roll": 0.3, "pitch": -0.3}, beta=0.6, delta_i=-0.4)) is None


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        (truth(tractor={"roll": -1.2}), "roll-over of the tractor"),
        (truth(trailer={"pitch": 1.2}), "roll-over of the trailer"),
        (truth(trailer={"x": -40.5}), "the trailer left the field"),
        (truth(tractor={"y": 26.0}), "the tractor left the field"),
        (truth(beta=math.radians(-85)), "jack-knife"),
        (truth(delta_i=math.radians(85)), "jack-knife"),
        (truth(tractor={"x": 3.0, "y": 4.5}), "diverged, the tractor is 5.4 m"),
    ],
)
def test_each_limit_terminates_with_its_reason(state, reason):
    text = verdict(state)
    assert text is not None
    assert text.startswith(reason)


def slips(speeds, period_s=0.2, window_s=5.0):
    """Return the mean slip at each moment, for pairs of rim and ground speed [m/s]."""
    mean = MeanSlip()
    return [
        mean.update(truth(time_s=k * period_s, wheel_speed=rim, speed=speed), window_s)
        for k, (rim, speed) in enumerate(speeds)
    ]


@pytest.mark.parametrize(("rim", "speed"), [(1.4, 0.7), (1.0, 1.0), (-1.0, -0.2), (0.5, -0.1)])
def test_mean_slip_of_a_steady_motion_is_its_slip_after_a_metre(rim, speed):
    mean = slips([(rim, speed)] * 60)
    metre = math.ceil(1.0 / (0.2 * abs(rim)) - 1e-9)
    assert mean[:metre] == [0.0] * metre
    assert mean[metre:] == pytest.approx([1.0 - speed / rim] * (60 - metre))


def test_a_vehicle_that_stands_stops_or_turns_back_does_not_slip():
    stop = [(1.0 - k / 25, 0.98 * (1.0 - k / 25)) for k in range(26)]
    back_and_forth = [(0.9 * sign, 0.88 * sign) for sign in [1] * 15 + [-1] * 15 + [1] * 15]
    standing = [(0.02, 0.0)] * 60
    for motion in (stop + [(0.0, 0.0)] * 60, back_and_forth, standing):
        assert max(slips(motion)) < 0.05


def test_stuck_needs_slip_and_distance():
    assert verdict(truth(tractor={"x": 4.5}, time_s=9.0), slip=0.7).startswith(
        "stuck: slip 0.70 over 5 s, the tractor is 4.5 m"
    )
    assert verdict(truth(tractor={"x": 3.5}), slip=0.7) is None
    assert verdict(truth(tractor={"x": 4.5}), slip=0.2) is None
    assert verdict(truth(tractor={"x": 5.5}), slip=0.2).startswith("diverged")


def test_a_run_on_ground_that_does_not_carry_ends_before_it_digs_in():
    """The vehicle makes no way: a detector stops it before it counts as stuck."""
    ground = ["terrain.iso_class='F'", "soil.cone_index_kpa=60.0", "path.laps=1"]
    summary, _ = simulate(*load("grass", ground), seed=1)
    assert summary.status == "stopped"
    assert re.search(r"GNSS moves at 0\.\d+ m/s: stopped", summary.failure)
