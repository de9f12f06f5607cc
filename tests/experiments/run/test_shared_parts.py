"""Parts that runs share: the bits of parts of a run's own, and no more of them than allowed."""

import dataclasses

import pytest
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.shared_parts import SharedParts
from proving_ground.experiments.run.simulate import drive_into
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.record import Recorder

TICKS = 12
SHORT = ["path.radius_m=8", "path.centre_distance_m=24", "path.laps=1"]


def driven(scenario, seed, parts=None):
    """Return the bits of every table of a short run but that of computation times."""
    assembly = dataclasses.replace(assemble(scenario, seed, parts=parts), ticks=TICKS)
    recorder = Recorder()
    drive_into(recorder, assembly)
    tables = recorder.record().tables.items()
    return {topic: table.values.tobytes() for topic, table in tables if topic != "/timing"}


@pytest.mark.parametrize("name", ["ttempc", "ttempc-tube", "paper", "lqr", "nmpc"])
def test_a_run_on_shared_parts_has_the_bits_of_a_run_of_its_own(name):
    _, scenario = load("patchy", [f'controller.name="{name}"', *SHORT])
    parts = SharedParts(terrains=1, controllers=1)
    driven(scenario, 1, parts)
    driven(scenario, 2, parts)
    assert driven(scenario, 2, parts) == driven(scenario, 2)


def test_another_path_option_or_vehicle_has_a_controller_of_its_own():
    parts = SharedParts(controllers=8)
    changes = (
        [],
        ["controller.options.horizon=12"],
        ["path.radius_m=9"],
        ["controller.vehicle.trailer_m=1.5"],
    )
    for number, change in enumerate(changes, 1):
        _, scenario = load("grass", [*SHORT, *change])
        assemble(scenario, 1, parts=parts)
        assemble(scenario, 2, parts=parts)
        assert len(parts.controllers._parts) == number
