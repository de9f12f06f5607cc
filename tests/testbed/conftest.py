"""A synthetic log, written once for all tests."""

import pytest
from proving_ground.testbed.recording.record import Recorder, Tee

from tests.testbed.logs import METADATA, feed, writer


@pytest.fixture(scope="session")
def logged(tmp_path_factory):
    """Return a complete log and the record of the same run."""
    path = tmp_path_factory.mktemp("log") / "log.mcap"
    recorder = Recorder()
    with writer(path) as log:
        feed(Tee(recorder, log))
    return path, recorder.record(METADATA)
