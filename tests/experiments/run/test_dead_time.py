"""Unknown dead times of the actuators in a whole run."""

from __future__ import annotations

import re

import pytest
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load

DEAD_TIME_S = 0.4
ACTUATORS = ("front", "trailer", "hydrostat")


@pytest.mark.parametrize("controller", ["ttempc", "pid"])
def test_unknown_dead_times_of_the_valves_are_learnt_within_twenty_seconds(controller):
    plant = [f"actuators.{name}.dead_time_s={DEAD_TIME_S}" for name in ACTUATORS]
    path = ["path.kind='straight'", "path.length_m=20.0"]
    name, scenario = load("grass", [*plant, *path, f"controller.name='{controller}'"])
    _, record = simulate(name, scenario, 1)
    told = " ".join(event.text for event in record.events if "learnt" in event.text)
    for field in ("dead_time_t", "dead_time_i"):
        change = re.search(rf"vehicle.{field} 0 -> (\S+) \+- (\S+) s", told)
        assert change, told
        value, sd = change.groups()
        assert abs(float(value) - DEAD_TIME_S) < 4.0 * float(sd) < 0.15
