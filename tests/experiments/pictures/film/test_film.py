"""Films and pictures of logs: poses and projections as logged, formats, refusals."""

import ctypes.util
import math
import shutil
import sys
from dataclasses import replace

import av
import numpy as np
import pytest
from PIL import Image
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidFilm, OutputExists
from proving_ground.experiments.pictures.film.camera import FIELD_OF_VIEW
from proving_ground.experiments.pictures.film.mujoco_scene import MujocoScene
from proving_ground.experiments.pictures.film.plan_view import PlanView
from proving_ground.experiments.pictures.film.render import Film
from proving_ground.experiments.pictures.film.settings import FRAME_RATE, FilmSettings
from proving_ground.testbed.recording.channels import STATE

SMALL = (320, 180)
SIDE = FilmSettings(camera="side")
needs_gl = pytest.mark.skipif(
    not (ctypes.util.find_library("EGL") and ctypes.util.find_library("GL")),
    reason="off-screen rendering needs libEGL and libGL (Debian: libegl1 libgl1)",
)


def test_frames_are_evenly_spaced_from_the_first_moment_and_none_lies_beyond_the_last():
    times = FilmSettings(begin_s=3.0, speed=4.0).times(0.0, 11.0)
    assert len(times) == 2 * FRAME_RATE
    assert times[0] == 3.0
    np.testing.assert_allclose(np.diff(times), 4.0 / FRAME_RATE)
    assert times[-1] < 11.0
    assert len(FilmSettings(end_s=1e-6).times(0.0, 11.0)) == 1
    assert FilmSettings(at_s=5.0).times(0.0, 11.0).tolist() == [5.0]


def test_poses_are_those_of_the_log_and_go_straight_in_between(playback):
    motion = playback.motion
    for k in (0, 17, len(motion.time_s) - 1):
        xyz, quat = playback.poses(float(motion.time_s[k]))
        np.testing.assert_allclose(xyz, motion.xyz[k], atol=1e-9)
        np.testing.assert_allclose(abs(np.sum(quat * motion.quat[k], axis=1)), 1.0, atol=1e-9)
    middle, turned = playback.poses(float(motion.time_s[20:22].mean()))
    np.testing.assert_allclose(middle, motion.xyz[20:22].mean(axis=0), atol=1e-9)
    halves = [abs(np.sum(turned * motion.quat[k], axis=1)) for k in (20, 21)]
    np.testing.assert_allclose(*halves, atol=1e-12)


def test_names_of_a_strangers_log_fit_into_a_picture(playback):
    metadata = {**playback.record.metadata, "controller": 10**6 * "x", "scenario": "a\nb"}
    strange = replace(playback, record=replace(playback.record, metadata=metadata))
    assert len(strange.title) < 300
    assert len(strange.label) < 200
    assert "\n" not in strange.title


def projected(place, eye, target, size):
    """Return the pixel of a position (3,) in a pinhole camera: to the right and down."""
    width, height = size
    forward = (target - eye) / np.linalg.norm(target - eye)
    upright = [0.0, 1.0, 0.0] if abs(forward[2]) > 1.0 - 1e-9 else [0.0, 0.0, 1.0]
    right = np.cross(forward, upright)
    right = right / np.linalg.norm(right)
    offset = place - eye
    scale = 0.5 * height / (math.tan(0.5 * FIELD_OF_VIEW) * (offset @ forward))
    up = np.cross(right, forward)
    return 0.5 * width + scale * (offset @ right), 0.5 * height - scale * (offset @ up)


@needs_gl
def test_the_cameras_show_the_tractor_at_its_projected_position_and_no_site(playback):
    scene = MujocoScene(playback, SIDE, SMALL)
    for camera, geom in (("side", "bonnet"), ("top", "roof"), ("chase", "roof")):
        picture = scene.picture(camera, 6.0).astype(float)
        place = scene.data.geom(geom).xpos
        x, y = projected(place, *scene.camera.view(camera, 6.0), SMALL)
        red, green, blue = picture[round(y), round(x)]
        assert red > 90.0, (camera, x, y)
        assert red > 2.0 * max(green, blue), (camera, x, y)
    xyz, _ = playback.poses(6.0)
    positions = [scene.data.body(name).xpos for name in playback.motion.body_names]
    np.testing.assert_array_equal(positions, xyz)
    terrain, plane = playback.ground.terrain, scene.data.geom("meadow")
    x, y = np.broadcast_arrays(*terrain.points())
    above = np.dstack([x, y, terrain.heights]) - plane.xpos
    assert (above @ plane.xmat.reshape(3, 3)[:, 2]).min() > 0.0, "the meadow covers no field"
    before = scene.picture("side", 6.0).astype(int)
    scene.model.site_rgba[:] = (1.0, 0.0, 1.0, 1.0)  # sites do not move with the bodies
    scene.model.site_size[:] = 1.0
    assert np.abs(scene.picture("side", 6.0) - before).max() <= 2  # of 255


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


def test_the_plan_shows_the_tractor_where_it_was(log, playback):
    centroids = []
    for time_s in (1.0, 9.0):
        settings = FilmSettings(camera="plan", at_s=time_s, size=(1280, 720))
        (picture,) = Film.of(log, settings).pictures()
        red, green, blue = np.moveaxis(picture[60:550].astype(int), -1, 0)
        rows, columns = np.nonzero((red > 150) & (red > 2 * green) & (red > 2 * blue))
        centroids.append((columns.mean(), -rows.mean()))
    x, y = np.subtract(centroids[1], centroids[0])
    east, north = np.diff([playback.positions(STATE, t)[0] for t in (1.0, 9.0)], axis=0)[0]
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


def test_an_mp4_without_its_encoder_is_refused_and_a_webp_needs_none(
    log, tmp_path, monkeypatch, capsys
):
    line = ["render", str(log), "--camera", "plan", "-o", str(tmp_path / "f.mp4")]
    monkeypatch.setattr(av, "codecs_available", {"mpeg4"})
    assert main(line) == 2
    assert "no H.264 encoder" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "av", None)
    assert main(line) == 2
    assert "pip install -e '.[film]'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    settings = FilmSettings(camera="plan", begin_s=2.0, end_s=3.6, speed=4.0, size=SMALL)
    file = tmp_path / "plan.webp"
    Film.of(log, settings).write(file)
    with Image.open(file) as animation:
        assert (animation.n_frames, animation.size) == (5, SMALL)
        assert animation.info["loop"] == 0
        animation.seek(1)
        animation.load()
        assert animation.info["duration"] == 80
    with pytest.raises(OutputExists):
        Film.of(log, settings).write(file)
    many = FilmSettings(camera="plan", speed=0.05, size=SMALL)
    with pytest.raises(InvalidFilm, match="at most 500"):
        Film.of(log, many).write(tmp_path / "long.webp")
    assert list(tmp_path.iterdir()) == [file]


def test_bad_input_is_refused_in_one_line(log, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(log, "log.mcap")
    content = log.read_bytes()
    (tmp_path / "torn.mcap").write_bytes(content[: len(content) // 2])
    (tmp_path / "taken.mp4").write_text("mine")
    before = sorted(tmp_path.iterdir())
    for line, words in (
        ("none.mcap", "cannot be read"),
        ("torn.mcap", "is torn"),
        ("log.mcap --size 321x180", "even"),
        ("log.mcap --to 99", "the log reaches from 0 to 1"),
        ("log.mcap --from 5 --to 5", "must end after it begins"),
        ("log.mcap --speed 0", "--speed"),
        ("log.mcap --ghost none.mcap", "none.mcap: cannot be read"),
        ("log.mcap --camera plan -o taken.mp4", "exists already"),
        ("log.mcap --camera plan -o no/film.mp4", "there is no folder"),
        ("log.mcap --at 5 -o still.webp", ".png"),
    ):
        try:
            code = main(["render", *line.split()])
        except SystemExit as exit:
            code = exit.code
        printed = capsys.readouterr()
        assert code == 2, line
        assert words in printed.err
        assert printed.err.count("\n") == 1
        assert printed.out == ""
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "taken.mp4").read_text() == "mine"


def test_without_its_display_a_picture_fills_the_frame(log, playback):
    settings = FilmSettings(camera="plan", at_s=3.0, size=SMALL, display=False)
    (picture,) = Film.of(log, settings).pictures()
    view = PlanView(playback, settings, SMALL, ())
    np.testing.assert_array_equal(picture, view.picture("plan", 3.0))
