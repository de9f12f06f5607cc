"""Log and playback of the tests of films."""

import pytest
from proving_ground.experiments.pictures.film.playback import read_playback


@pytest.fixture(scope="module")
def log(short_runs):
    return short_runs / "nominal" / "log.mcap"


@pytest.fixture(scope="module")
def playback(log):
    return read_playback(log)
