"""Driving in reverse, where the trailer falls aside of itself: on the plant, in closed loop."""

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import CONTROL, REFERENCE, STATE

BACK = "path={kind='straight', length_m=20.0, reverse=true}"


def driven(*overrides, seed=1):
    name, scenario = load("grass", ('controller.name="ttempc-nominal"', *overrides))
    summary, record = simulate(name, scenario, seed)
    state, wanted = record[STATE], record[REFERENCE]
    points = [("x_t_m", "y_t_m"), ("x_i_m", "y_i_m")]
    away = [np.hypot(*(state.columns(*p) - wanted.columns(*p)).T) for p in points]
    return summary, record, np.array(away)


def test_a_straight_reverse_on_grass_keeps_both_points_within_20_cm():
    """Acceptance of the project, start-up included."""
    summary, record, away = driven(BACK, seed=11)
    assert summary.status == "completed"
    assert away.max() < 0.20
    state = record[STATE]
    assert np.all(state["v_mps"] < 0.0)
    assert state["x_t_m"][-1] - state["x_t_m"][0] == pytest.approx(20.0, abs=0.2), "to the east"
    assert np.abs(np.abs(state["psi_t_rad"]) - np.pi).max() < 0.3, "looking west"
    command = record[CONTROL]["hp_command"]
    assert np.all((command >= -1.0) & (command <= 0.0))


def test_curves_hold_in_reverse_too():
    summary, _, away = driven(
        "path={kind='headland', passes=2, length_m=4.0, width_m=15.0, reverse=true}"
    )
    assert summary.status == "completed"
    assert away.max() < 0.20


def test_without_feedback_the_trailer_folds():
    summary, _, _ = driven(BACK, 'controller.name="feedforward"')
    assert summary.status == "lost"
    assert "jack-knife" in summary.failure


def test_a_vehicle_that_drives_forward_only_is_refused(tmp_path, capsys):
    arguments = ["run", "farm", "--out", str(tmp_path / "new"), "--set", "path.reverse=true"]
    assert main(arguments) == 2
    assert "farm4500 drives forward only" in capsys.readouterr().err
