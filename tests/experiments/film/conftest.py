"""Log, replay and ground of the tests of films."""

import numpy as np
import pytest

from proving_ground.experiments.film.replay import read_replay
from proving_ground.testbed.ground.terrain import Terrain


@pytest.fixture(scope="module")
def log(short_runs):
    return short_runs / "nominal" / "log.mcap"


@pytest.fixture(scope="module")
def replay(log):
    return read_replay(log)


@pytest.fixture
def bumps():
    return Terrain(np.random.default_rng(4).normal(size=(101, 161)), 0.1, (-8.0, -5.0))
