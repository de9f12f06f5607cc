"""What a film shows beside the vehicle: faults, ghosts, errors, meadow and mown grass."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from proving_ground.experiments.film.drawing.body_poses import rotation
from proving_ground.experiments.film.drawing.field import FieldMesh, mown
from proving_ground.experiments.film.drawing.overlay_box import OverlayBox, text_length
from proving_ground.experiments.film.error_trace import ErrorTrace
from proving_ground.experiments.film.ghosts import ReferenceGhost, RunGhost
from proving_ground.experiments.film.hud import Overlay, Scales
from proving_ground.experiments.film.plan_view import PlanView
from proving_ground.experiments.film.shot import Shot
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.recording.channels import REFERENCE
from proving_ground.testbed.recording.record import Event

from tests.experiments.film.conftest import compiled_with


def test_the_overlay_names_a_fault_while_it_acts(replay):
    events = (Event(2.0, "warning", "fault: gust begins"), Event(4.0, "info", "fault: gust ends"))
    plain, faulty = (
        dataclasses.replace(replay, record=dataclasses.replace(replay.record, events=each))
        for each in ((), events)
    )

    def shown(film, time_s):
        picture = Image.new("RGB", (640, 360))
        shot = Shot("plan", 0.0, 11.0, 1.0, picture.size)
        Overlay(film, shot, Scales(0.4, 0.1), moving=False).draw_onto(picture, time_s)
        return np.asarray(picture)

    assert np.array_equal(shown(plain, 1.9), shown(faulty, 1.9))
    top = slice(0, 120), slice(0, 200)  # below the headline, beside the caption of the event
    assert not np.array_equal(shown(plain, 3.9)[top], shown(faulty, 3.9)[top])
    assert np.array_equal(shown(plain, 7.5), shown(faulty, 7.5))


@pytest.mark.parametrize("scale", [0.3, 0.375, 0.5, 0.61, 1.0, 1.5])
def test_a_box_as_wide_as_its_text_holds_it_at_every_size(scale):
    text, margin = "grass-ttempc-1 · ttempc · seed 201", 8.0
    width = text_length(text, 15, bold=True) + 2.0 * margin
    empty, box = (OverlayBox(width, 26.0, scale) for _ in range(2))
    box.text(margin, 13.0, text, points=15, bold=True)
    written = np.any(np.asarray(box.image) != np.asarray(empty.image), axis=(0, 2))
    assert written.any()
    assert not written[-max(1, int(0.5 * margin * scale)) :].any()


def test_the_ghost_of_the_reference_has_both_axle_points_on_their_references(replay):
    ghost, time_s = ReferenceGhost(replay), 6.0
    placed, turned = ghost.poses(time_s)
    xyz, quat = replay.poses(time_s)
    for point, letter, wheels in (
        ("tractor", "t", ("rear_left", "front_right")),
        ("trailer", "i", ("trailer_left", "drawbar")),
    ):
        body = replay.body(point)
        due = [replay.value(REFERENCE, f"{name}_{letter}_m", time_s) for name in "xy"]
        np.testing.assert_allclose(placed[body, :2], due, atol=1e-3)
        ahead = rotation(turned[body]).apply([1.0, 0.0, 0.0])
        yaw = replay.value(REFERENCE, f"psi_{letter}_rad", time_s)
        turn = math.atan2(ahead[1], ahead[0]) - yaw
        assert math.remainder(turn, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
        tilt = [rotation(each[body]).apply([0.0, 0.0, 1.0])[2] for each in (quat, turned)]
        assert tilt[0] == pytest.approx(tilt[1])
        for wheel in map(replay.body, wheels):
            distances = [np.linalg.norm(each[wheel] - each[body]) for each in (xyz, placed)]
            assert distances[0] == pytest.approx(distances[1]), "the vehicle moves as one"


def test_a_ghost_of_the_run_itself_hides_behind_the_vehicle_and_another_is_seen(replay):
    own, other = (RunGhost(replay, replay.motion.body_names, (0, 255, 255)) for _ in range(2))
    np.testing.assert_array_equal(own.poses(6.0)[0], replay.poses(6.0)[0])
    shot = Shot("plan", 0.0, 11.0, 1.0, (640, 360))
    late = dataclasses.replace(
        replay, motion=dataclasses.replace(replay.motion, time_s=replay.motion.time_s + 2.0)
    )
    other = RunGhost(late, replay.motion.body_names, (0, 255, 255))
    seen = [
        np.sum(np.all(np.abs(PlanView(replay, shot, [each]).picture(8.0) - [0, 255, 255]) < 90, -1))
        for each in (own, other)
    ]
    assert seen[1] > 4 * seen[0] + 20


def test_an_exaggeration_multiplies_the_cross_track_error_and_nothing_else(replay):
    plain, again = replay.driven(8.0, 0.3), replay.driven(8.0, 0.3, 1.0)
    np.testing.assert_array_equal(plain, again)
    tenfold = replay.driven(8.0, 0.3, 10.0)
    errors = replay.errors
    for point, letter in enumerate("ti"):
        table = replay.record[REFERENCE]
        yaw = float(np.interp(8.0, table.time_s, np.unwrap(table[f"psi_{letter}_rad"])))
        moved = tenfold[point, -1] - plain[point, -1]
        along, cross = (
            moved @ [math.cos(yaw), math.sin(yaw)],
            moved @ [-math.sin(yaw), math.cos(yaw)],
        )
        cross_m = (errors.tractor, errors.trailer)[point].cross_m
        error = float(np.interp(8.0, errors.time_s, cross_m))
        assert along == pytest.approx(0.0, abs=1e-9)
        assert cross == pytest.approx(9.0 * error, abs=1e-9)


def test_the_trace_ends_at_the_error_of_its_time_and_reaches_back_over_its_window(replay):
    trace = ErrorTrace(replay, 4.0, 0.1, narrow=False)
    errors = replay.errors
    zero = ErrorTrace(replay, 4.0, 1e9, narrow=False).points("tractor", 9.0)[-1, 1]
    full = 2.0 * (zero - 26.0)  # from the lower to the upper end of the axis
    points = trace.points("tractor", 9.0)
    row = np.searchsorted(errors.time_s, 9.0 + 1e-9) - 1
    assert (zero - points[-1, 1]) / full == pytest.approx(
        0.5 * np.clip(errors.tractor.cross_m[row] / 0.1, -1.0, 1.0), abs=1e-9
    )
    assert np.all(np.diff(points[:, 0]) > 0.0)
    right, left = trace.points("tractor", 9.0)[-1, 0], trace.points("tractor", 9.0)[0, 0]
    assert right - left == pytest.approx(560.0 - 64.0 - 14.0, abs=8.0)


def test_the_meadow_is_level_far_from_a_slope():
    x = np.linspace(-8.0, 8.0, 161)
    slope = Terrain(np.tile(0.1 * x, (101, 1)), 0.1, (-8.0, -5.0))
    field = FieldMesh(slope, 1.0)
    count = compiled_with(field).mesh("meadow").vertnum[0]
    mesh = SimpleNamespace(vertices=np.empty((count, 3)))
    field.lay_meadow(mesh)
    x, y, z = mesh.vertices.T
    far = np.hypot(x, y) > 220.0
    assert np.abs(z[far]).max() < 1.0, "the plane of the field would lie 22 m higher there"
    near = (np.abs(x) < 10.0) & (np.abs(x) > 8.5) & (np.abs(y) < 5.0)
    np.testing.assert_allclose(z[near], 0.1 * x[near], atol=0.25)


def test_mown_colours_change_across_the_swaths_and_at_the_edge_only(bumps):
    grass = np.full((200, 320, 3), 0.5)
    colours = mown(grass, bumps)
    middle = colours[:, 160, 1]
    assert np.ptp(middle[20:-20]) == pytest.approx(0.055, rel=0.05)  # of 0.5, both ways
    assert np.ptp(colours[100, 20:-20], axis=0).max() < 1e-12, "stripes run along x"
    assert colours[0, 160, 1] < middle[20:-20].min()
