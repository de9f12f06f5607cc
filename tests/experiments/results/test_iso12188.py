"""Report in the terms of ISO 12188-2: offsets, directions, interpolation between sparse points."""

import math

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidReplay
from proving_ground.experiments.results.iso12188 import format_report, report
from proving_ground.testbed.recording.channels import REFERENCE, STATE
from proving_ground.testbed.recording.record import Record, Table

SPEED_MPS = 2.5


def record_of(offsets, rate_hz=5.0, wave_m=0.0, *, line=True):
    """Return the record of passes of 100 m to the east and back, each so far left of its line."""
    step = SPEED_MPS / rate_hz
    rows, references = [], []
    for number, offset in enumerate(offsets):
        x = np.arange(-20.0 if number == 0 else 0.0, 100.0, step)  # the start-up does not count
        yaw = math.pi * (number % 2)
        sign = math.cos(yaw)
        cross = offset + wave_m * np.sin(0.4 * x)
        place = x if sign > 0.0 else 100.0 - x
        rows += [(p, sign * c, yaw) for p, c in zip(place, cross, strict=True)]
        references += [(p, 0.0, yaw) for p in place]
    times = np.arange(len(rows)) / rate_hz
    state = np.zeros((len(rows), len(STATE.fields)))
    reference = np.full((len(rows), len(REFERENCE.fields)), np.nan)
    for table, channel, values in ((state, STATE, rows), (reference, REFERENCE, references)):
        if channel is REFERENCE and not line:
            continue
        for name, column in zip(("x_t_m", "y_t_m", "psi_t_rad"), np.array(values).T, strict=True):
            table[:, channel.fields.index(name)] = column
    tables = {"/state": Table(STATE, times, state)}
    return Record({**tables, "/reference": Table(REFERENCE, times, reference)})


def test_an_offset_is_the_mean_error_of_its_pass_and_has_no_spread():
    content = report(record_of([0.05, -0.02]))
    assert [each["mean_m"] for each in content["passes"]] == pytest.approx([0.05, -0.02])
    assert [each["sd_m"] for each in content["passes"]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert content["passes"][1]["length_m"] == pytest.approx(100.0, abs=1.0)
    assert content["passes"][1]["speed_mps"] == pytest.approx(SPEED_MPS, rel=0.01)


def test_a_pass_back_is_compared_at_the_same_places():
    """Left of the way back is right of the way there: 5 cm and 2 cm are 7 cm apart."""
    (pair,) = report(record_of([0.05, 0.02]))["relative"]
    assert pair["mean_m"] == pytest.approx(-0.07)
    assert pair["sd_m"] == pytest.approx(0.0, abs=1e-9)
    assert pair["term"] == "short-term"


@pytest.mark.parametrize("line", [True, False])
def test_relative_errors_need_no_given_line(line):
    (pair,) = report(record_of([0.05, 0.02], line=line))["relative"]
    assert pair["mean_m"] == pytest.approx(-0.07, abs=1e-6)


def test_sparse_points_give_the_error_of_dense_ones():
    """Two passes whose points lie at other places: the nearest point would add to the error."""
    dense = report(record_of([0.0, 0.0], rate_hz=25.0, wave_m=0.1))["relative"][0]
    sparse = report(record_of([0.0, 0.0], rate_hz=2.0, wave_m=0.1))["relative"][0]
    assert sparse["rms_m"] == pytest.approx(dense["rms_m"], rel=0.03)


def test_what_the_standard_asks_and_the_log_lacks_is_said():
    text = "\n".join(format_report(report(record_of([0.05]))))
    assert "no two passes" in text
    assert "ISO 12188-2:2012" in text
    standing = Table(STATE, np.arange(20.0), np.zeros((20, len(STATE.fields))))
    with pytest.raises(InvalidReplay, match="straight pass"):
        report(Record({**record_of([0.05]).tables, "/state": standing}))
