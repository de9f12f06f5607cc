"""Films and pictures of logs: poses and projections as logged, formats, refusals."""

import ctypes.util
import dataclasses
import math
import shutil
import sys
from types import SimpleNamespace

import av
import mujoco
import numpy as np
import pytest
from PIL import Image

from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidFilm
from proving_ground.experiments.film.camera import FIELD_OF_VIEW
from proving_ground.experiments.film.composition import FilmSetup
from proving_ground.experiments.film.drawing.body_poses import place_bodies, rotation
from proving_ground.experiments.film.drawing.field import FieldMesh, mown
from proving_ground.experiments.film.drawing.ribbon import Ribbon
from proving_ground.experiments.film.error_trace import ErrorTrace
from proving_ground.experiments.film.ghosts import ReferenceGhost, RunGhost
from proving_ground.experiments.film.hud import Overlay, Scales
from proving_ground.experiments.film.mujoco_scene import MujocoScene
from proving_ground.experiments.film.plan_view import PlanView
from proving_ground.experiments.film.render import render_frames
from proving_ground.experiments.film.replay import read_replay
from proving_ground.experiments.film.shot import FRAME_RATE, Shot
from proving_ground.experiments.film.writer import FilmWriter
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.recording.channels import REFERENCE, STATE
from proving_ground.testbed.recording.record import Event

SMALL = (320, 180)
needs_gl = pytest.mark.skipif(
    not (ctypes.util.find_library("EGL") and ctypes.util.find_library("GL")),
    reason="off-screen rendering needs libEGL and libGL (Debian: libegl1 libgl1)",
)


@pytest.fixture(scope="module")
def log(short_runs):
    return short_runs / "nominal" / "log.mcap"


@pytest.fixture(scope="module")
def replay(log):
    return read_replay(log)


@pytest.fixture
def bumps():
    return Terrain(np.random.default_rng(4).normal(size=(101, 161)), 0.1, (-8.0, -5.0))


def test_frames_are_evenly_spaced_from_the_first_moment_and_none_lies_beyond_the_last():
    shot = Shot("plan", 3.0, 11.0, 4.0, SMALL)
    assert len(shot.times) == 2 * FRAME_RATE
    assert shot.times[0] == 3.0
    np.testing.assert_allclose(np.diff(shot.times), 4.0 / FRAME_RATE)
    assert shot.times[-1] < 11.0
    assert len(Shot("plan", 0.0, 1e-6, 1.0, SMALL).times) == 1


def test_poses_are_those_of_the_log_and_go_straight_in_between(replay):
    motion = replay.motion
    for k in (0, 17, len(motion.time_s) - 1):
        xyz, quat = replay.poses(float(motion.time_s[k]))
        np.testing.assert_allclose(xyz, motion.xyz[k], atol=1e-9)
        np.testing.assert_allclose(abs(np.sum(quat * motion.quat[k], axis=1)), 1.0, atol=1e-9)
    middle, turned = replay.poses(float(motion.time_s[20:22].mean()))
    np.testing.assert_allclose(middle, motion.xyz[20:22].mean(axis=0), atol=1e-9)
    halves = [abs(np.sum(turned * motion.quat[k], axis=1)) for k in (20, 21)]
    np.testing.assert_allclose(*halves, atol=1e-12)


def test_bodies_at_given_places_carry_their_shapes_as_mujoco_does(replay):
    model = mujoco.MjSpec.from_string(replay.mjcf).compile()
    joints, placed = mujoco.MjData(model), mujoco.MjData(model)
    rng = np.random.default_rng(2)
    joints.qpos[:] = rng.normal(size=model.nq)
    mujoco.mj_kinematics(model, joints)
    bodies = np.arange(1, model.nbody)
    place_bodies(model, placed, bodies, joints.xpos[bodies], joints.xquat[bodies])
    moving = model.geom_bodyid > 0
    np.testing.assert_allclose(placed.geom_xpos[moving], joints.geom_xpos[moving], atol=1e-9)
    np.testing.assert_allclose(placed.geom_xmat[moving], joints.geom_xmat[moving], atol=1e-9)


def test_a_ribbon_lies_on_the_ground_with_its_width_and_hides_unused_points(bumps):
    along = np.linspace(0.0, 2.0, 30)
    points = np.column_stack([3.0 * np.cos(along), 3.0 * np.sin(along)])
    ribbon, mesh = Ribbon("ribbon", 40, 0.2, 0.01), SimpleNamespace(vertices=np.empty((80, 3)))
    ribbon.lay(mesh, points, bumps)
    right, left = mesh.vertices[:30], mesh.vertices[40:70]
    np.testing.assert_allclose(np.hypot(*(left - right)[:, :2].T), 0.2)
    np.testing.assert_allclose(0.5 * (left + right)[:, :2], points, atol=1e-12)
    for edge in (left, right):
        np.testing.assert_allclose(edge[:, 2], bumps.height(edge[:, 0], edge[:, 1]) + 0.01)
    assert np.all(mesh.vertices[30:40] == right[-1])
    turn = np.cross(np.diff(right, axis=0), (left - right)[:-1])
    assert np.all(turn[:, 2] > 0.0), "faces look up"


def test_the_field_mesh_covers_the_field_with_its_heights_and_is_fine_near_its_centre(bumps):
    field = FieldMesh(bumps, 1.0)
    spec = mujoco.MjSpec()
    spec.add_hfield(name="ground", nrow=2, ncol=2, size=[1, 1, 1, 1], userdata=[0.0] * 4)
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="ground")
    for name in ("ground", "meadow"):
        spec.add_material(name=name)
    field.add_to(spec)
    count = spec.compile().mesh("field").vertnum[0]
    parts = {name: np.empty((count, 3)) for name in ("vertices", "normals")}
    mesh = SimpleNamespace(**parts, texture_coordinates=np.empty((count, 2)))
    assert field.lay(mesh, 2.0, 1.0)
    assert not field.lay(mesh, 2.1, 1.0), "near enough to leave it"
    x, y, z = mesh.vertices.T
    np.testing.assert_allclose(z, bumps.height(x, y))
    np.testing.assert_allclose([x.min(), x.max(), y.min(), y.max()], [-8.0, 8.0, -5.0, 5.0])
    lines = np.unique(x)
    spacing = np.diff(lines)
    assert spacing[np.abs(lines[:-1] - 2.0) < 4.0].max() < 0.151
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0)


def projected(place, view, size):
    """Return the pixel of a position (3,) in a pinhole camera: to the right and down."""
    width, height = size
    upright = [0.0, 1.0, 0.0] if abs(view.forward[2]) > 1.0 - 1e-9 else [0.0, 0.0, 1.0]
    right = np.cross(view.forward, upright)
    right = right / np.linalg.norm(right)
    offset = place - view.eye
    scale = 0.5 * height / (math.tan(0.5 * FIELD_OF_VIEW) * (offset @ view.forward))
    up = np.cross(right, view.forward)
    return 0.5 * width + scale * (offset @ right), 0.5 * height - scale * (offset @ up)


@needs_gl
def test_the_cameras_show_the_tractor_at_its_projected_position(replay):
    scene = MujocoScene(replay, Shot("side", 0.0, 11.0, 1.0, SMALL))
    try:
        for camera, geom in (("side", "bonnet"), ("top", "roof"), ("chase", "roof")):
            picture = scene.picture(camera, 6.0).astype(float)
            place = scene.data.geom(geom).xpos
            x, y = projected(place, scene.camera.view(camera, 6.0), SMALL)
            red, green, blue = picture[round(y), round(x)]
            assert red > 90.0, (camera, x, y)
            assert red > 2.0 * max(green, blue), (camera, x, y)
        xyz, _ = replay.poses(6.0)
        positions = [scene.data.body(name).xpos for name in replay.motion.body_names]
        np.testing.assert_array_equal(positions, xyz)
    finally:
        scene.close()


@needs_gl
def test_no_site_is_drawn(replay):
    """Sites do not move with the bodies of a replay."""
    scene = MujocoScene(replay, Shot("side", 0.0, 11.0, 1.0, SMALL))
    try:
        before = scene.picture("side", 6.0)
        scene.model.site_rgba[:] = (1.0, 0.0, 1.0, 1.0)
        scene.model.site_size[:] = 1.0
        np.testing.assert_array_equal(scene.picture("side", 6.0), before)
    finally:
        scene.close()


@needs_gl
@pytest.mark.parametrize("camera", ["chase", "side"])
def test_a_frame_shows_field_sky_and_vehicle_and_depends_on_its_time_alone(camera, log, tmp_path):
    line = ["frame", str(log), "--at", "6", "--camera", camera, "--size", "320x180"]
    for name in ("one.png", "two.png"):
        assert main([*line, "-o", str(tmp_path / name)]) == 0
    one, two = (np.asarray(Image.open(tmp_path / name)) for name in ("one.png", "two.png"))
    np.testing.assert_array_equal(one, two)
    assert one.shape == (180, 320, 3)
    red, green, blue = np.moveaxis(one.astype(float), -1, 0)
    assert np.mean((red > 90) & (red > 2 * green)) > 0.002  # paint of the tractor
    assert np.mean((green > 1.4 * red) & (green > 1.2 * blue)) > 0.005  # boards of the trailer
    assert np.mean((blue > 180) & (blue > red)) > 0.05  # sky
    assert np.mean((green > red) & (red > 1.2 * blue)) > 0.3  # grass


def decoded(file):
    with av.open(str(file)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        return stream.codec_context.name, stream.codec_context.pix_fmt, frames


def test_a_plan_film_needs_no_opengl_and_plays_in_a_browser(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    file = tmp_path / "plan.mp4"
    line = ["video", str(log), "--camera", "plan", "--from", "2", "--to", "6", "--speed", "4"]
    assert main([*line, "--size", "320x180", "-o", str(file)]) == 0
    assert "25 frames, 1.0 s" in capsys.readouterr().out
    codec, pixels, frames = decoded(file)
    assert (codec, pixels, len(frames)) == ("h264", "yuv420p", FRAME_RATE)
    assert frames[0].shape == (180, 320, 3)
    content = file.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat"), "index first: plays while it loads"
    assert list(tmp_path.iterdir()) == [file]
    assert np.abs(frames[0].astype(float) - frames[-1]).max() > 60.0, "something moves"


def test_processes_share_a_film_without_changing_it(replay):
    setup = FilmSetup((replay,), Shot("plan", 0.0, 11.0, 5.0, SMALL))
    alone, shared = (list(render_frames(setup, workers)) for workers in (1, 2))
    assert len(alone) == 55
    np.testing.assert_array_equal(alone, shared)


def test_the_plan_shows_the_tractor_where_it_was(replay):
    scene = FilmSetup(
        (replay,), Shot("plan", 0.0, 5.0, 1.0, (1280, 720)), moving=False
    ).frame_source()
    early, late = (scene.picture(t)[60:550, :880].astype(int) for t in (1.0, 9.0))
    centroids = []
    for picture in (early, late):
        red, green, blue = np.moveaxis(picture, -1, 0)
        rows, columns = np.nonzero((red > 150) & (red > 2 * green) & (red > 2 * blue))
        centroids.append((columns.mean(), -rows.mean()))
    x, y = np.subtract(centroids[1], centroids[0])
    east, north = np.diff([replay.positions(STATE, t)[0] for t in (1.0, 9.0)], axis=0)[0]
    assert math.atan2(y, x) == pytest.approx(math.atan2(north, east), abs=0.1)


def test_without_opengl_the_packages_and_the_plan_are_named(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    file = tmp_path / "film.mp4"
    assert main(["video", str(log), "-o", str(file)]) == 2
    message = capsys.readouterr().err
    assert "libegl1 libgl1" in message
    assert "--camera plan" in message
    assert message.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_missing_h264_encoder_is_reported(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(av, "codecs_available", {"mpeg4"})
    assert main(["video", str(log), "--camera", "plan", "-o", str(tmp_path / "f.mp4")]) == 2
    assert "no H.264 encoder" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_film_that_fails_leaves_nothing(tmp_path):
    def broken():
        with FilmWriter(tmp_path / "film.mp4", SMALL) as writer:
            writer.add(np.zeros((180, 320, 3), np.uint8))
            raise InvalidFilm("no")

    with pytest.raises(InvalidFilm):
        broken()
    assert not list(tmp_path.iterdir())


@pytest.fixture
def bad_logs(log, tmp_path):
    folder = tmp_path / "bad"
    folder.mkdir()
    shutil.copy(log, folder / "log.mcap")
    (folder / "text.mcap").write_text("nothing of the kind")
    content = log.read_bytes()
    (folder / "torn.mcap").write_bytes(content[: len(content) // 2])
    (folder / "taken.mp4").write_text("mine")
    return folder


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["video", "none.mcap"], "cannot be read"),
        (["video", "text.mcap"], "is not an MCAP log"),
        (["video", "torn.mcap"], "is torn"),
        (["video", "log.mcap", "--size", "321x180"], "even"),
        (["video", "log.mcap", "--size", "16x16"], "must be from 320x180"),
        (["video", "log.mcap", "--size", "big"], "WIDTHxHEIGHT"),
        (["video", "log.mcap", "--to", "99"], "the log reaches from 0 to 1"),
        (["video", "log.mcap", "--from", "-1"], "the log reaches from"),
        (["video", "log.mcap", "--from", "5", "--to", "5"], "must end after it begins"),
        (["video", "log.mcap", "--speed", "0"], "--speed: got 0"),
        (["video", "log.mcap", "--speed", "nan"], "--speed: got nan"),
        (["video", "log.mcap", "--exaggerate", "0.5"], "--exaggerate: got 0.5, must be from 1"),
        (["video", "log.mcap", "--ghost", "none.mcap"], "none.mcap: cannot be read"),
        (["video", "log.mcap", "--quality", "best"], "--quality"),
        (["video", "log.mcap", "--camera", "plan", "-o", "taken.mp4"], "exists already"),
        (["video", "log.mcap", "--camera", "plan", "-o", "film.avi"], "must end in .mp4"),
        (["video", "log.mcap", "--camera", "plan", "-o", "no/film.mp4"], "there is no folder"),
        (["frame", "log.mcap", "--at", "99"], "the log reaches from"),
        (["frame", "log.mcap", "--at", "nan"], "must be a finite number"),
        (["frame", "log.mcap", "--at", "5", "-o", "still.gif"], "must end in .png or .jpg"),
    ],
)
def test_bad_input_is_refused_in_one_line(bad_logs, line, words, monkeypatch, capsys):
    monkeypatch.chdir(bad_logs)
    before = sorted(bad_logs.iterdir())
    try:
        code = main(line)
    except SystemExit as exit:
        code = exit.code
    printed = capsys.readouterr()
    assert code == 2
    assert words in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert sorted(bad_logs.iterdir()) == before
    assert (bad_logs / "taken.mp4").read_text() == "mine"


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
    spec = mujoco.MjSpec()
    spec.add_hfield(name="ground", nrow=2, ncol=2, size=[1, 1, 1, 1], userdata=[0.0] * 4)
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="ground")
    for name in ("ground", "meadow"):
        spec.add_material(name=name)
    field.add_to(spec)
    mesh = SimpleNamespace(vertices=np.empty((spec.compile().mesh("meadow").vertnum[0], 3)))
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


def test_an_animation_has_every_second_frame_and_loops(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    file = tmp_path / "plan.webp"
    line = ["video", str(log), "--camera", "plan", "--from", "2", "--to", "3.6", "--speed", "4"]
    assert main([*line, "--size", "320x180", "-o", str(file)]) == 0
    with Image.open(file) as animation:
        assert (animation.n_frames, animation.size) == (5, (320, 180))
        assert animation.info["loop"] == 0
        animation.seek(1)
        animation.load()
        assert animation.info["duration"] == 80
    assert list(tmp_path.iterdir()) == [file]


def test_an_animation_of_more_frames_than_memory_is_refused(log, tmp_path, capsys):
    line = ["video", str(log), "--camera", "plan", "--speed", "0.05", "--size", "320x180"]
    assert main([*line, "-o", str(tmp_path / "plan.webp")]) == 2
    assert "at most 500 as WebP" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
