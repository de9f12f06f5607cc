"""Short runs with their logs, driven once for all tests that look at logs."""

import pytest
from proving_ground.experiments.run.run_folder import run
from proving_ground.experiments.scenario.scenario import load

STRAIGHT = "path={kind='straight', length_m=12}"


@pytest.fixture(scope="session")
def short_runs(tmp_path_factory):
    """Folders of two controllers on one straight line, and a slower drive along it."""
    folder = tmp_path_factory.mktemp("short-runs")
    for name, overrides in (
        ("paper", [STRAIGHT, 'controller.name="paper"']),
        ("nominal", [STRAIGHT, 'controller.name="ttempc-nominal"']),
        ("slower", ["path={kind='straight', length_m=12, speed_mps=0.8}"]),
    ):
        scenario_name, scenario = load("grass", overrides)
        run(scenario_name, scenario, 3, folder / name)
    return folder
