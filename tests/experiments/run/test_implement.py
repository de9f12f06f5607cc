"""Runs with an implement: errors of its tool point, with the trailer steered and locked."""

import math
from dataclasses import replace

import pytest
from proving_ground.experiments.results.tracking_errors import tracking_errors
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import TOOL

PATH = "path={kind='straight', length_m=25}"
LOCKED = "stages=[{make='tests.experiments.run.test_implement:locked', after='control'}]"


def locked(_generator):
    """Return a stage that steers the tractor along the x axis and locks the trailer's steering."""

    def steer(_setup, tick):
        truth = tick.now
        course = truth.tractor.yaw + math.atan2(truth.lateral_speed, truth.speed)
        delta_t = min(0.5, max(-0.5, -0.8 * truth.tractor.y - 1.6 * course))
        tick.command = replace(tick.command, delta_t=delta_t, delta_i=0.0)

    return steer


def driven(scenario, *overrides, seed=5):
    name, content = load(scenario, (PATH, 'controller.name="pid"', *overrides))
    return simulate(name, content, seed)


def test_on_a_side_slope_a_steered_trailer_keeps_the_tool_where_a_locked_one_does_not():
    """Veal (2009): an unsteered implement slides aside behind a guided tractor."""
    steered, aside = (
        driven("side-slope", "implement={}", *more)[0].tracking.all for more in ((), (LOCKED,))
    )
    assert aside.tractor.cross_p95_m < 0.06
    assert aside.tool.cross_p95_m > 2.0 * steered.tool.cross_p95_m
    assert aside.tool.cross_mean_m < -0.03  # downhill


def test_the_log_of_a_run_has_its_tool_and_the_path_has_its_reference():
    summary, record = driven(
        "cultivate", "implement.work_m=[[3.0, 20.0]]", "implement.behind_m=0.9"
    )
    assert summary.status == "completed"
    tool, errors = record[TOOL], tracking_errors(record)
    assert tool["x_reference_m"][-1] == pytest.approx(25.0 - 2.4 - 0.9, abs=0.1)
    works = tool["lowered"] == 1.0
    assert tool["distance_m"][works].min() > 3.0
    assert tool["distance_m"][works].max() < 20.0
    assert errors.tool.euclidean_m[works].max() < 0.2
    assert summary.implement.draft_mean_n == pytest.approx(990.0, rel=0.15)
    assert record.events[0].text.startswith("implement: field-cultivator-second, 1.2 m wide")


def test_a_run_without_an_implement_has_no_tool():
    summary, record = driven("grass")
    assert summary.implement is None
    assert summary.tracking.all.tool is None
    assert not len(record[TOOL])
