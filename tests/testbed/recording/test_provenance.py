"""Provenance: equal runs have the same identity, different runs different ones."""

from importlib.metadata import version

from proving_ground.testbed.recording import provenance


def test_versions_are_those_of_what_is_installed():
    software = provenance.versions()
    assert software["mujoco"] == version("mujoco")
    assert software["ttempc"] == version("ttempc")
    assert all(software.values())


def test_the_identity_of_a_run_is_its_scenario_and_its_code():
    code = {"ttempc": "0.1.0", "mujoco": "4.0.0"}
    same = provenance.run_id("seed = 1\n", dict(reversed(code.items())))
    assert provenance.run_id("seed = 1\n", code) == same
    assert provenance.run_id("seed = 2\n", code) != same
    assert provenance.run_id("seed = 1\n", {**code, "mujoco": "4.0.1"}) != same
