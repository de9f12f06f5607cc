"""`ttempc fit vehicle`: lengths from a log, the vehicle file, refusals."""

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidReplay
from proving_ground.experiments.logs import calibrate as module
from proving_ground.experiments.run.simulate import run
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.vehicle.vehicle import DEFAULT_VEHICLE, read_vehicle

from tests.experiments.conftest import STRAIGHT
from ttempc.learning.lengths import LengthFit

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


def test_a_hitch_that_no_vehicle_can_have_gives_way_along_the_covariance(log, monkeypatch):
    best, sd = np.array([1.4, 0.17, 0.93, 1.3]), 0.06  # with it the drawbar meets the rear wheels
    covariance = np.diag([1e-4, sd**2, sd**2, 1e-4])
    covariance[1, 2] = covariance[2, 1] = -(sd**2)  # their sum is known
    fit = LengthFit(best, covariance, 0.0)
    monkeypatch.setattr(module, "fit_lengths", lambda *arguments: fit)
    found = module.calibrate(log)
    after = np.array([item.after for item in found.changes])
    assert 0.0 < found.moved_sd <= 2.0
    np.testing.assert_allclose(after - best, found.moved_sd * sd * np.array([0, 1, -1, 0]))
    assert f"hitch {found.moved_sd:.1f} sd" in found.format()[-1]
    monkeypatch.setattr(module, "_MOST_SD", found.moved_sd - 0.1)  # less makes no vehicle
    with pytest.raises(InvalidReplay, match="make no vehicle"):
        module.calibrate(log)


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
