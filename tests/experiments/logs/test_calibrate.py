"""`ttempc fit vehicle`: lengths from a log, the vehicle file, refusals."""

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.run.simulate import run
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.vehicle.vehicle import DEFAULT_VEHICLE, read_vehicle

from tests.experiments.conftest import STRAIGHT

WRONG = [
    "controller.vehicle.wheelbase_m=1.74",
    "controller.vehicle.hitch_offset_m=0.33",
    "controller.vehicle.drawbar_m=0.96",
    "controller.vehicle.trailer_m=1.2",
]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The log of a lap with a model of wrong lengths, which the run does not learn."""
    folder = tmp_path_factory.mktemp("calibrate") / "run"
    _, scenario = load("grass", ["path.laps=1", "controller.learn=false", *WRONG])
    summary = run("grass", scenario, 2, folder).summary
    assert summary.status == "completed"
    assert summary.learnt == []
    return folder / "log.mcap"


def test_the_lengths_of_the_plant_are_found_and_a_scenario_can_name_them(log, tmp_path, capsys):
    vehicle = tmp_path / "mine" / "vehicle.toml"
    assert main(["fit", "vehicle", str(log), "-o", str(vehicle)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:4]] == [
        "wheelbase_m",
        "hitch_offset_m",
        "drawbar_m",
        "trailer_m",
    ]
    before, after, sd = np.array([np.array(line.split())[[1, 3, 5]] for line in lines[:4]], float).T
    true, fitted = read_vehicle(DEFAULT_VEHICLE), read_vehicle(str(vehicle))
    lengths = np.array(
        [
            (v.tractor.wheelbase_m, v.hitch.offset_m, v.drawbar.length_m, v.trailer.length_m)
            for v in (true, fitted)
        ]
    )
    np.testing.assert_allclose(before, [1.74, 0.33, 0.96, 1.2])
    np.testing.assert_allclose(lengths[1], after, atol=6e-4)  # three decimals on screen
    # 3 % and 3 sd beside: the wheelbase that a tractor with slipping tyres seems to have.
    assert (np.abs(after - lengths[0]) < 3.0 * sd + 0.03 * lengths[0]).all()
    assert abs((after - lengths[0])[1:].sum()) < 0.01
    assert "fitted to" in vehicle.read_text()
    load("grass", [f"plant.vehicle.file='{vehicle}'"])
    assert main(["fit", "vehicle", str(log), "-o", str(vehicle)]) == 2  # exists


def test_a_log_without_curves_or_too_short_is_refused_in_one_line(tmp_path, capsys):
    for path, reason in (
        (STRAIGHT, "s of driving"),
        ("path={kind='straight', length_m=34}", "too few curves"),
    ):
        file = tmp_path / reason / "log.mcap"
        run("grass", load("grass", [path])[1], 1, file.parent)
        out = tmp_path / "vehicle.toml"
        assert main(["fit", "vehicle", str(file), "-o", str(out)]) == 2
        assert not out.exists()
        (line,) = capsys.readouterr().err.splitlines()
        assert reason in line
