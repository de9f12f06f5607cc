"""Evidence: verdicts, the experiments' own arithmetic, and some experiments on short passes."""

from __future__ import annotations

import math

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


def test_side_force_of_a_wheel_opposes_its_slip_angle_and_falls_with_slip():
    angle = math.radians(15.0)
    free, half = (evidence.side_ratio(angle, slip, 20.0) for slip in (0.0, 0.5))
    assert free < half < 0.0
    assert evidence.side_ratio(-angle, 0.5, 20.0) == pytest.approx(-half, rel=1e-6)
    assert evidence.side_ratio(0.0, 0.2, 20.0) == pytest.approx(0.0, abs=1e-9)


def test_slow_yaw_response_is_ackermann():
    assert evidence.yaw_gain(evidence.farm(), 0.5, periods=1) == pytest.approx(1.0, abs=0.02)
