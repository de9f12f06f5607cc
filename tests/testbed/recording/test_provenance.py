"""Provenance: equal runs have the same identity, different runs different ones."""

from proving_ground.testbed.recording import provenance


def test_the_identity_of_a_run_is_its_scenario_and_its_code():
    code = {"ttempc": "0.1.0", "mujoco": "4.0.0"}
    same = provenance.run_id("seed = 1\n", dict(reversed(code.items())))
    assert provenance.run_id("seed = 1\n", code) == same
    assert provenance.run_id("seed = 2\n", code) != same
    assert provenance.run_id("seed = 1\n", {**code, "mujoco": "4.0.1"}) != same
