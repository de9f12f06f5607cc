"""What a film shows beside the vehicle: faults, errors, ghosts."""

import dataclasses
import math

import numpy as np
import pytest
from PIL import Image
from proving_ground.experiments.pictures.film.hud import Hud
from proving_ground.experiments.pictures.film.plan_view import PlanView
from proving_ground.experiments.pictures.film.playback import Ghost, rotation
from proving_ground.experiments.pictures.film.settings import FilmSettings
from proving_ground.testbed.recording.channels import REFERENCE
from proving_ground.testbed.recording.record import Event


def test_the_display_names_a_fault_while_it_acts_and_hides_nothing_below_the_sky(playback):
    events = (Event(2.0, "warning", "fault: gust begins"), Event(4.0, "info", "fault: gust ends"))
    plain, faulty = (
        dataclasses.replace(playback, record=dataclasses.replace(playback.record, events=each))
        for each in ((), events)
    )

    def shown(run, time_s):
        hud = Hud(run, (1280, 720))
        picture = Image.new("RGB", hud.size)
        hud.draw_onto(picture, time_s)
        return np.asarray(picture), hud.view_size[1]

    (before, _), (same, _) = (shown(run, 1.9) for run in (plain, faulty))
    assert np.array_equal(before, same)
    (quiet, height), (alarm, _) = (shown(run, 3.9) for run in (plain, faulty))
    top = slice(0, 120), slice(0, 200)
    assert not np.array_equal(quiet[top], alarm[top])
    assert not alarm[120:height].any(), "the picture between sky and band is free"


def test_the_ghost_of_the_reference_has_both_axle_points_on_their_references(playback):
    time_s = 6.0
    placed, turned = playback.reference_poses(time_s)
    _, quat = playback.poses(time_s)
    for point, letter in (("tractor", "t"), ("trailer", "i")):
        body = playback.body(point)
        due = [playback.value(REFERENCE, f"{name}_{letter}_m", time_s) for name in "xy"]
        np.testing.assert_allclose(placed[body, :2], due, atol=1e-3)
        ahead = rotation(turned[body]).apply([1.0, 0.0, 0.0])
        yaw = playback.value(REFERENCE, f"psi_{letter}_rad", time_s)
        turn = math.atan2(ahead[1], ahead[0]) - yaw
        assert math.remainder(turn, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
        tilt = [rotation(each[body]).apply([0.0, 0.0, 1.0])[2] for each in (quat, turned)]
        assert tilt[0] == pytest.approx(tilt[1])


def test_a_ghost_of_another_run_is_seen_and_stands_where_that_run_was(playback):
    names, colour = playback.motion.body_names, (0, 255, 255)
    own = Ghost("own", colour, playback.poses_of(names))
    np.testing.assert_array_equal(own.poses(6.0)[0], playback.poses(6.0)[0])
    motion = dataclasses.replace(playback.motion, time_s=playback.motion.time_s + 2.0)
    late = Ghost("late", colour, dataclasses.replace(playback, motion=motion).poses_of(names))
    np.testing.assert_allclose(late.poses(8.0)[0], playback.poses(6.0)[0], atol=1e-9)
    seen = []
    for ghost in (own, late):
        view = PlanView(playback, FilmSettings(camera="plan"), (640, 278), [ghost])
        seen.append(np.sum(np.all(np.abs(view.picture("plan", 8.0) - [0, 255, 255]) < 90, -1)))
    assert seen[1] > 4 * seen[0] + 20
