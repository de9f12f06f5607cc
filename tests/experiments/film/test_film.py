"""Films and pictures of logs: poses and projections as logged, formats, refusals."""

import ctypes.util
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
from proving_ground.experiments.film.drawing.body_poses import place_bodies
from proving_ground.experiments.film.drawing.field import FieldMesh
from proving_ground.experiments.film.drawing.ribbon import Ribbon
from proving_ground.experiments.film.mujoco_scene import MujocoScene
from proving_ground.experiments.film.render import render_frames
from proving_ground.experiments.film.shot import FRAME_RATE, Shot
from proving_ground.experiments.film.writer import FilmWriter
from proving_ground.testbed.recording.channels import STATE

from tests.experiments.film.conftest import compiled_with

SMALL = (320, 180)
needs_gl = pytest.mark.skipif(
    not (ctypes.util.find_library("EGL") and ctypes.util.find_library("GL")),
    reason="off-screen rendering needs libEGL and libGL (Debian: libegl1 libgl1)",
)


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
    count = compiled_with(field).mesh("field").vertnum[0]
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
    line = ["render", str(log), "--at", "6", "--camera", camera, "--size", "320x180"]
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
    line = ["render", str(log), "--camera", "plan", "--from", "2", "--to", "6", "--speed", "4"]
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
    assert main(["render", str(log), "-o", str(file)]) == 2
    message = capsys.readouterr().err
    assert "libegl1 libgl1" in message
    assert "--camera plan" in message
    assert message.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_missing_h264_encoder_is_reported(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(av, "codecs_available", {"mpeg4"})
    assert main(["render", str(log), "--camera", "plan", "-o", str(tmp_path / "f.mp4")]) == 2
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
        (["render", "none.mcap"], "cannot be read"),
        (["render", "text.mcap"], "is not an MCAP log"),
        (["render", "torn.mcap"], "is torn"),
        (["render", "log.mcap", "--size", "321x180"], "even"),
        (["render", "log.mcap", "--size", "16x16"], "must be from 320x180"),
        (["render", "log.mcap", "--size", "big"], "WIDTHxHEIGHT"),
        (["render", "log.mcap", "--to", "99"], "the log reaches from 0 to 1"),
        (["render", "log.mcap", "--from", "-1"], "the log reaches from"),
        (["render", "log.mcap", "--from", "5", "--to", "5"], "must end after it begins"),
        (["render", "log.mcap", "--speed", "0"], "--speed: must be above 0"),
        (["render", "log.mcap", "--speed", "nan"], "--speed: must be a finite number"),
        (["render", "log.mcap", "--exaggerate", "0.5"], "--exaggerate: got 0.5, must be from 1"),
        (["render", "log.mcap", "--ghost", "none.mcap"], "none.mcap: cannot be read"),
        (["render", "log.mcap", "--quality", "best"], "--quality"),
        (["render", "log.mcap", "--camera", "plan", "-o", "taken.mp4"], "exists already"),
        (["render", "log.mcap", "--camera", "plan", "-o", "film.avi"], "must end in .mp4"),
        (["render", "log.mcap", "--camera", "plan", "-o", "no/film.mp4"], "there is no folder"),
        (["render", "log.mcap", "--at", "99"], "the log reaches from"),
        (["render", "log.mcap", "--at", "nan"], "must be a finite number"),
        (["render", "log.mcap", "--at", "5", "-o", "still.gif"], "--at: makes .png or .jpg"),
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


def test_an_animation_has_every_second_frame_and_loops(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    file = tmp_path / "plan.webp"
    line = ["render", str(log), "--camera", "plan", "--from", "2", "--to", "3.6", "--speed", "4"]
    assert main([*line, "--size", "320x180", "-o", str(file)]) == 0
    with Image.open(file) as animation:
        assert (animation.n_frames, animation.size) == (5, (320, 180))
        assert animation.info["loop"] == 0
        animation.seek(1)
        animation.load()
        assert animation.info["duration"] == 80
    assert list(tmp_path.iterdir()) == [file]


def test_an_animation_of_more_frames_than_memory_is_refused(log, tmp_path, capsys):
    line = ["render", str(log), "--camera", "plan", "--speed", "0.05", "--size", "320x180"]
    assert main([*line, "-o", str(tmp_path / "plan.webp")]) == 2
    assert "at most 500 as WebP" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
