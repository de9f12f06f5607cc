"""Passes: which stretches they are, standard deviations on them, peaks at changes of curvature."""

import math

import numpy as np
import pytest
from proving_ground.experiments.results.passes import pass_spreads, peaks
from proving_ground.experiments.results.stretches import (
    LEAD_M,
    Stretches,
    curvature_changes,
    passes,
    travelled,
)
from proving_ground.experiments.results.summary import RunFacts, summarise
from proving_ground.experiments.results.tracking_errors import tracking_errors
from proving_ground.testbed.recording.channels import ESTIMATE, REFERENCE, STATE

from tests.records import circle, eight, record, straight

FACTS = RunFacts("0", "made-up", "none", 1, "completed", None, {"ttempc": "0"}, None)


def waving(run, channel, amplitude_m, period_s=5.0):
    """Add a wave across the line to both points of a run to the east."""
    table = run[channel]
    for letter in "ti":
        column = table.channel.fields.index(f"y_{letter}_m")
        wave = amplitude_m * np.sin(2.0 * math.pi * table.time_s / period_s)
        table.values[:, column] += wave
    return run


def test_stretches_are_runs_of_true_rows():
    found = Stretches.where(np.array([True, True, False, True, False, False, True]))
    assert found.first.tolist() == [0, 3, 6]
    assert found.end.tolist() == [2, 4, 7]
    assert found.numbers(7).tolist() == [0, 0, -1, 1, -1, -1, 2]
    assert not Stretches.where(np.zeros(3, dtype=bool)).first.size


def test_passes_are_straight_and_long_and_begin_so_far_ahead():
    run = record(eight, duration_s=140.0)
    distance = travelled(run)
    curvature = run[REFERENCE]["curvature_per_m"]
    found = passes(run)
    assert len(found.first) == 2  # 22.4 m before each of the two arcs
    for first, end in zip(found.first, found.end, strict=True):
        assert np.abs(curvature[first:end]).max() <= 0.01 * np.abs(curvature).max()
        assert distance[end - 1] - distance[first] >= 15.0
    early = passes(run, LEAD_M)
    assert distance[found.first[1]] - distance[early.first[1]] == pytest.approx(LEAD_M, abs=0.05)
    assert not passes(record(circle)).first.size


def test_true_and_seen_deviations_of_a_wave_are_its_amplitude_over_the_root_of_two():
    run = waving(waving(record(straight), STATE, 0.03), ESTIMATE, 0.02)
    count, spreads = pass_spreads(run)
    assert count == 1
    for point in ("tractor", "trailer"):
        true_m, seen_m = spreads[point]
        assert true_m == pytest.approx(0.03 / math.sqrt(2.0), rel=0.02)
        assert seen_m == pytest.approx(0.02 / math.sqrt(2.0), rel=0.02)


def test_an_offset_of_the_receiver_is_no_deviation_and_no_pass_has_no_figure():
    offset = summarise(record(straight, cross=(0.1, 0.2), tool=(0.0, 0.05)), FACTS).passes
    for spread in (offset.tractor, offset.trailer, offset.tool):
        assert spread.cross_sd_m == pytest.approx(0.0, abs=1e-9)
        assert spread.seen_cross_sd_m == pytest.approx(0.0, abs=1e-9)
    none = summarise(record(circle), FACTS).passes
    assert none.count == 0
    assert none.trailer.cross_sd_m is None


def test_a_peak_is_the_largest_error_where_the_curvature_changes():
    run = record(eight, duration_s=140.0, cross=(0.1, -0.2))
    errors = tracking_errors(run)
    found = peaks(run, errors)
    assert found["tractor"] == pytest.approx(np.full(len(found["tractor"]), 0.1), abs=1e-6)
    changes = curvature_changes(run)
    assert len(changes.first) == len(found["trailer"]) == 4  # into and out of both arcs
    assert summarise(run, FACTS).peaks.trailer_m == pytest.approx(0.2, abs=1e-6)
    assert summarise(record(straight), FACTS).peaks.trailer_m is None
