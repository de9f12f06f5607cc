"""Termination conditions, each with its reason."""

import math

import pytest

from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.simulation.termination import TerminationLimits, check_termination
from tests.testbed.truths import truth

FIELD = flat(size_m=(80.0, 50.0))


def verdict(state, reference=(0.0, 0.0)):
    return check_termination(state, reference, FIELD, TerminationLimits())


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
