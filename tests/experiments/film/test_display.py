"""What a film shows beside the vehicle: faults, errors, ghosts."""

import dataclasses
import math

import numpy as np
import pytest
from PIL import Image
from proving_ground.experiments.film.drawing import OverlayBox, text_length
from proving_ground.experiments.film.hud import Hud
from proving_ground.experiments.film.plan_view import PlanView
from proving_ground.experiments.film.playback import Ghost, rotation
from proving_ground.experiments.film.settings import FilmSettings
from proving_ground.testbed.recording.channels import REFERENCE
from proving_ground.testbed.recording.record import Event


def test_the_display_names_a_fault_while_it_acts_and_hides_nothing_below_the_sky(playback):
    events = (Event(2.0, "warning", "fault: gust begins"), Event(4.0, "info", "fault: gust ends"))
    plain, faulty = (
        dataclasses.replace(playback, record=dataclasses.replace(playback.record, events=each))
        for each in ((), events)
    )

    def shown(run, time_s):
        hud = Hud(run, (1280, 720), 0.1)
        picture = Image.new("RGB", hud.size)
        hud.draw_onto(picture, time_s)
        return np.asarray(picture), hud.view_size[1]

    (before, _), (same, _) = (shown(run, 1.9) for run in (plain, faulty))
    assert np.array_equal(before, same)
    (quiet, height), (alarm, _) = (shown(run, 3.9) for run in (plain, faulty))
    top = slice(0, 120), slice(0, 200)
    assert not np.array_equal(quiet[top], alarm[top])
    assert not alarm[120:height].any(), "the picture between sky and band is free"
    assert alarm[height:].any()


@pytest.mark.parametrize("scale", [0.3, 0.61, 1.5])
def test_a_box_as_wide_as_its_text_holds_it_at_every_size(scale):
    text, margin = "grass-ttempc-1 · ttempc · seed 201", 8.0
    width = text_length(text, 15, bold=True) + 2.0 * margin
    empty, box = (OverlayBox(width, 26.0, scale) for _ in range(2))
    box.text(margin, 13.0, text, points=15, bold=True)
    written = np.any(np.asarray(box.image) != np.asarray(empty.image), axis=(0, 2))
    assert written.any()
    assert not written[-max(1, int(0.5 * margin * scale)) :].any()


def test_the_ghost_of_the_reference_has_both_axle_points_on_their_references(playback):
    time_s = 6.0
    placed, turned = Ghost(playback, (), (0, 0, 0), True).poses(time_s)
    xyz, quat = playback.poses(time_s)
    for point, letter, wheels in (
        ("tractor", "t", ("rear_left", "front_right")),
        ("trailer", "i", ("trailer_left", "drawbar")),
    ):
        body = playback.body(point)
        due = [playback.value(REFERENCE, f"{name}_{letter}_m", time_s) for name in "xy"]
        np.testing.assert_allclose(placed[body, :2], due, atol=1e-3)
        ahead = rotation(turned[body]).apply([1.0, 0.0, 0.0])
        yaw = playback.value(REFERENCE, f"psi_{letter}_rad", time_s)
        turn = math.atan2(ahead[1], ahead[0]) - yaw
        assert math.remainder(turn, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
        tilt = [rotation(each[body]).apply([0.0, 0.0, 1.0])[2] for each in (quat, turned)]
        assert tilt[0] == pytest.approx(tilt[1])
        for wheel in map(playback.body, wheels):
            distances = [np.linalg.norm(each[wheel] - each[body]) for each in (xyz, placed)]
            assert distances[0] == pytest.approx(distances[1]), "the vehicle moves as one"


def test_a_ghost_of_another_run_is_seen_and_stands_where_that_run_was(playback):
    names, colour = playback.motion.body_names, (0, 255, 255)
    own = Ghost(playback, names, colour)
    np.testing.assert_array_equal(own.poses(6.0)[0], playback.poses(6.0)[0])
    motion = dataclasses.replace(playback.motion, time_s=playback.motion.time_s + 2.0)
    late = Ghost(dataclasses.replace(playback, motion=motion), names, colour)
    np.testing.assert_allclose(late.poses(8.0)[0], playback.poses(6.0)[0], atol=1e-9)
    seen = []
    for ghost in (own, late):
        view = PlanView(playback, FilmSettings(camera="plan"), (640, 278), [ghost])
        seen.append(np.sum(np.all(np.abs(view.picture("plan", 8.0) - [0, 255, 255]) < 90, -1)))
    assert seen[1] > 4 * seen[0] + 20


def test_an_exaggeration_multiplies_the_cross_track_error_and_nothing_else(playback):
    plain, tenfold = playback.driven(8.0, 0.3), playback.driven(8.0, 0.3, 10.0)
    np.testing.assert_array_equal(plain, playback.driven(8.0, 0.3, 1.0))
    errors, table = playback.errors, playback.record[REFERENCE]
    for point, letter in enumerate("ti"):
        yaw = float(np.interp(8.0, table.time_s, np.unwrap(table[f"psi_{letter}_rad"])))
        moved = tenfold[point, -1] - plain[point, -1]
        cross_m = (errors.tractor, errors.trailer)[point].cross_m
        error = float(np.interp(8.0, errors.time_s, cross_m))
        assert moved @ [math.cos(yaw), math.sin(yaw)] == pytest.approx(0.0, abs=1e-9)
        cross = moved @ [-math.sin(yaw), math.cos(yaw)]
        assert cross == pytest.approx(9.0 * error, abs=1e-9)


def test_the_trace_ends_at_the_error_of_its_time_and_reaches_back_over_its_window(playback):
    hud, huge = (Hud(playback, (1280, 720), scale_m) for scale_m in (0.1, 1e9))
    points = hud.trace_points("tractor", 9.0)
    zero = huge.trace_points("tractor", 9.0)[-1, 1]
    full = 2.0 * (zero - 26.0)  # from the lower to the upper end of the axis
    errors = playback.errors
    row = np.searchsorted(errors.time_s, 9.0 + 1e-9) - 1
    share = np.clip(errors.tractor.cross_m[row] / 0.1, -1.0, 1.0)
    assert (zero - points[-1, 1]) / full == pytest.approx(0.5 * share, abs=1e-9)
    assert np.all(np.diff(points[:, 0]) > 0.0)
    span = points[-1, 0] - points[0, 0]
    assert span == pytest.approx((9.0 / 30.0) * (560.0 - 64.0 - 14.0), abs=8.0)
