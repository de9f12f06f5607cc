"""Evidence: verdicts, the experiments' own arithmetic, and some experiments on short passes."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from proving_ground.experiments.papers.studies import evidence
from proving_ground.experiments.papers.studies.evidence import Evidence, page


def item(figure, band=(1.0, 2.0), **about):
    texts = {"name": "a figure", "unit": "m", "published": "1 to 2 m", "method": "a drive"}
    return Evidence(figure=figure, band=band, source="a source.", **texts, **about)


def test_verdict_follows_from_figure_and_band_and_reasons_stand_together():
    verdicts = {1.0: "in band", 2.0: "in band", 0.99: "below", 2.01: "above"}
    for figure, verdict in {**verdicts, math.nan: "no figure"}.items():
        one = item(figure, below="too little")
        assert one.verdict == verdict
        assert one.reason == {"in band": "", "below": "too little"}.get(verdict, "unknown")
        assert ("- Outside, 1: " in page([one])) == bool(one.reason)
    assert "- Outside, 1, 2: unknown." in page([item(0.0), item(0.5), item(1.5)])
    assert page([item(1.5), item(3.0)]).startswith("1 of 2 figures from 1 sources")


def test_autocorrelation_of_several_series():
    rng, memory = np.random.default_rng(5), 0.8
    series = []
    for _ in range(40):
        values = [rng.standard_normal()]
        for noise in rng.standard_normal(500):
            values.append(memory * values[-1] + math.sqrt(1 - memory**2) * noise)
        series.append(np.array(values))
    for lag in (1, 3, 12):
        assert evidence.autocorrelation(series, lag) == pytest.approx(memory**lag, abs=0.05)
    levels = [np.full(10, 1.0), np.full(10, -1.0)]  # the mean is common to all series
    assert evidence.autocorrelation(levels, 3) == pytest.approx(1.0)


def test_side_force_of_a_wheel_opposes_its_slip_angle_and_falls_with_slip():
    angle = math.radians(15.0)
    free, half = (evidence.side_ratio(angle, slip, 20.0) for slip in (0.0, 0.5))
    assert free < half < 0.0
    assert evidence.side_ratio(-angle, 0.5, 20.0) == pytest.approx(-half, rel=1e-6)
    assert evidence.side_ratio(0.0, 0.2, 20.0) == pytest.approx(0.0, abs=1e-9)


def test_slow_yaw_response_is_ackermann():
    assert evidence.yaw_gain(evidence.farm(), 0.5, periods=1) == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
def test_an_unsteered_tool_slides_further_on_a_steeper_slope(monkeypatch):
    short = partial(evidence.straight_pass, length_m=44.0)
    monkeypatch.setattr(evidence, "straight_pass", short)
    quiet = ("sensors.gnss_sd_m=0.001",)
    (_, little), (_, much) = (
        evidence.unsteered_tool(slope, quiet, (201,)) for slope in (0.05, 0.25)
    )
    assert much > 2.0 * little
    figures = [*evidence.tool_forces((201,)), *evidence.receivers((201,))]
    assert all(figure > 0.0 for figure in figures)
