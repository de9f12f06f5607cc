"""The vehicle as it is seen: rendered off-screen, in software."""

import ctypes.util
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

needs_gl = pytest.mark.skipif(
    not (ctypes.util.find_library("EGL") and ctypes.util.find_library("GL")),
    reason="off-screen rendering needs libEGL and libGL (Debian: libegl1 libgl1)",
)


@needs_gl
@pytest.mark.parametrize("camera", ["chase", "side"])
def test_the_picture_shows_a_red_tractor_a_green_trailer_and_the_sky(camera, tmp_path):
    file = tmp_path / "portrait.png"
    subprocess.run(
        [sys.executable, "-m", "experiments.studies.portrait", str(file), "grass", camera],
        env={**os.environ, "MUJOCO_GL": "egl"},
        check=True,
        timeout=300,
    )
    red, green, blue = np.moveaxis(np.asarray(Image.open(file).convert("RGB"), float), -1, 0)
    assert np.mean((red > 120) & (red > 2 * green)) > 0.005  # paint of the tractor
    assert np.mean((green > 1.4 * red) & (green > 1.2 * blue)) > 0.005  # boards of the trailer
    assert np.mean((blue > 180) & (blue > red)) > 0.03  # sky
    assert np.mean((green > red) & (red > 1.2 * blue)) > 0.3  # grass
