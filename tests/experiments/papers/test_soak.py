"""Random scenarios from the JSON schema with a random fault: refused, or driven to a status."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.errors import ExperimentError
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import drive_into
from proving_ground.experiments.scenario.scenario import read_scenario, shipped
from proving_ground.experiments.scenario.schema import json_schema
from proving_ground.testbed.errors import TestbedError
from proving_ground.testbed.recording.channels import STATE
from proving_ground.testbed.recording.record import Recorder

from ttempc.errors import TtempcError

SCHEMA = json_schema()


def drawn(schema, rng, share):
    """Return a table with some keys of a schema: numbers near their defaults, choices at will."""
    schema = SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
    table = {}
    for key, value in schema.get("properties", {}).items():
        default = value.get("default")
        if "$ref" in value and (below := drawn(value, rng, share)):
            table[key] = below
        elif key not in schema.get("required", ()) and rng.random() > share:
            continue
        elif "enum" in value:
            table[key] = str(rng.choice(value["enum"]))
        elif value.get("type") == "number":
            number = (default or 1.0) * math.exp(rng.uniform(-0.4, 0.4))
            table[key] = min(max(number, value.get("minimum", -1e3)), value.get("maximum", 1e3))
        elif value.get("type") == "boolean":
            table[key] = bool(rng.random() < 0.5)
    return table


@pytest.mark.slow
@pytest.mark.parametrize("number", range(30))
def test_a_random_scenario_ends_with_a_status_and_finite_states(number):
    rng, kinds = np.random.default_rng(number), SCHEMA["properties"]["faults"]["items"]
    for _ in range(200):
        kind = str(rng.choice(list(kinds["discriminator"]["mapping"])))
        fault = drawn({"$ref": kinds["discriminator"]["mapping"][kind]}, rng, 0.3)
        fault = {k: v for k, v in fault.items() if k != "at_m"} | {"kind": kind, "start_s": 3.0}
        settings = drawn({k: v for k, v in SCHEMA.items() if k != "$ref"}, rng, 0.04)
        file = read_scenario(str(rng.choice(shipped())))
        try:
            scenario = file.scenario(settings | {"faults": [fault]}, changed_by="random")
            assembly, recorder = assemble(scenario, number), Recorder()
        except (ExperimentError, TestbedError, TtempcError):
            continue
        ended = drive_into(recorder, replace(assembly, ticks=min(75, assembly.ticks)))
        assert ended.status in {"completed", "stopped", "lost"}, ended.failure
        assert np.isfinite(recorder.record()[STATE].values).all()
        return
    pytest.fail("no scenario could be driven")
