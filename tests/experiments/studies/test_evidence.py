"""Evidence: verdicts, the experiments' own arithmetic, and their machinery on cheap cases."""

import math
from functools import partial

import numpy as np
import pytest
from proving_ground.experiments.studies import batch
from proving_ground.experiments.studies.evidence import handling, page, passes, tillage, wheel
from proving_ground.experiments.studies.evidence.evidence import (
    Evidence,
    around,
    table,
    verdict_line,
)
from proving_ground.experiments.sweep.engine import engine
from proving_ground.testbed.validation.check import between


def item(figure, low=1.0, high=2.0, **about):
    check = between("a figure", figure=figure, low=low, high=high, unit="m", source="a source")
    return Evidence(check, "1 to 2 m", "the source's range", "a drive", **about)


@pytest.mark.parametrize(
    ("figure", "verdict", "reason"),
    [
        (1.0, "in band", ""),
        (2.0, "in band", ""),
        (0.99, "below", "too little"),
        (2.01, "above", "unknown"),
        (math.nan, "no figure", "unknown"),
    ],
)
def test_verdict_follows_from_figure_and_band(figure, verdict, reason):
    evidence = item(figure, below="too little")
    assert evidence.verdict == verdict
    assert evidence.reason == reason
    text = table([evidence])
    assert ("- Outside, 1: " in text) == bool(reason)
    assert f"{verdict}" in text


def test_notes_of_one_method_and_reasons_stand_together():
    text = table([item(0.0), item(0.5), item(1.5)])
    assert "**1 to 3.** a source." in text
    assert "- Outside, 1, 2: unknown." in text


def test_a_figure_without_a_band_is_not_judged_and_not_counted():
    free = item(5.0, -math.inf, math.inf)
    assert free.verdict == "not judged"
    assert verdict_line([free, item(1.5), item(3.0)]).startswith("1 of 2 figures from 1 sources")


def test_band_about_a_negative_value_is_ordered():
    low, high = around(-4.0, 0.5)
    assert (low, high) == (-6.0, -2.0)


def test_nearest_points_overestimate_as_the_closed_form_has_it():
    """Mean of sqrt(e^2 + u^2) over u within half a spacing d, over e; no more for a small d."""
    offset, spacing = 0.1, 0.2
    x = np.arange(0.0, 10.0, spacing)
    first = np.column_stack([x, np.zeros_like(x)])
    fine = np.arange(0.05, 9.5, spacing / 20)
    second = np.column_stack([fine, np.full_like(fine, offset)])
    u = np.linspace(-0.5, 0.5, 2001) * spacing
    expected = np.hypot(offset, u).mean() / offset - 1.0
    assert passes.nearest_point_excess(first, second) == pytest.approx(expected, rel=0.02)
    assert passes.nearest_point_excess(second - [0.0, offset], second) < expected / 50


def test_relative_error_is_that_of_a_lap_to_the_lap_before():
    lap, time = 20.0, np.arange(0.0, 70.0, 0.04)
    straight = time % lap < 12.0
    same = np.sin(2.0 * math.pi * time / lap)
    np.testing.assert_allclose(passes.relative_error(time, same, straight, lap), 0.0, atol=1e-4)
    drift = passes.relative_error(time, same + 0.01 * time, straight, lap)
    np.testing.assert_allclose(drift, 0.01 * lap, atol=1e-4)


def test_autocorrelation_of_several_series():
    rng, memory = np.random.default_rng(5), 0.8
    series = []
    for _ in range(40):
        values = [rng.standard_normal()]
        for noise in rng.standard_normal(500):
            values.append(memory * values[-1] + math.sqrt(1 - memory**2) * noise)
        series.append(np.array(values))
    for lag in (1, 3, 12):
        assert tillage.autocorrelation(series, lag) == pytest.approx(memory**lag, abs=0.05)
    levels = [np.full(10, 1.0), np.full(10, -1.0)]  # the mean is common to all series
    assert tillage.autocorrelation(levels, 3) == pytest.approx(1.0)


def test_side_force_of_a_wheel_opposes_its_slip_angle_and_falls_with_slip():
    angle = math.radians(15.0)
    free, half = (wheel.side_ratio(angle, slip, 20.0) for slip in (0.0, 0.5))
    assert free < half < 0.0
    assert wheel.side_ratio(-angle, 0.5, 20.0) == pytest.approx(-half, rel=1e-6)
    assert wheel.side_ratio(0.0, 0.2, 20.0) == pytest.approx(0.0, abs=1e-9)


def test_slow_yaw_response_is_ackermann():
    assert handling.yaw_gain(handling.farm(), 0.5, periods=1) == pytest.approx(1.0, abs=0.02)


def test_responses_follow_a_larger_change_of_stiffness_more():
    small, large = (each.check.figure for each in handling.sensitivity((0.1, 0.5), seconds=1.0))
    assert 0.0 < small < large


@pytest.fixture
def short(monkeypatch):
    """Passes of 44 m; experiments in this process."""
    for module in (passes, tillage):
        drive = partial(module.straight_pass, length_m=44.0)
        monkeypatch.setattr(module, "straight_pass", drive)
    monkeypatch.setattr(batch, "engine", partial(engine, 0))


def test_figures_of_short_passes(short):
    experiments = (
        partial(tillage.working_slip, 1),
        partial(tillage.tool_forces, 1),
        partial(passes.receivers, 1),
    )
    items = page.evidence(experiments)
    assert len(items) == 5 + 2 + 3
    assert all(math.isfinite(each.check.figure) for each in items)
    slip, (draft, stiffness) = items[0].check.figure, (each.check.figure for each in items[5:7])
    assert slip > 0.0
    assert draft > 0.0
    assert stiffness > 0.0


def test_page_has_a_row_for_every_figure(short):
    content = page.evidence_page((lambda: [item(1.5), item(3.0)], lambda: [item(0.0)]))
    assert "1 of 3 figures" in content
    assert sum(line.startswith("| ") for line in content.splitlines()) == 1 + 3


def test_unsteered_tool_slides_further_on_a_steeper_slope(short, monkeypatch):
    errors = []
    for slope in (0.05, 0.25):
        monkeypatch.setattr(tillage, "_SLOPE", slope)
        monkeypatch.setattr(tillage, "FIELD_SENSORS", ("sensors.gnss_sd_m=0.001",))
        errors.append(tillage.unsteered_tool(1)[1].check.figure)
    assert errors[1] > 2.0 * errors[0]
