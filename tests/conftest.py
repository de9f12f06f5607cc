"""Settings of every process of the tests."""

import faulthandler
import sys

import pytest
from proving_ground.experiments.numerics import settle_numerics

SLOW_S = 3600.0  # of a study; any other test has `faulthandler_timeout` of pyproject.toml

settle_numerics()  # pytest has a process for each core


@pytest.fixture(autouse=True)
def _time_of_a_study(request):
    """Give a test that is marked slow an hour instead of the time of the others."""
    if request.node.get_closest_marker("slow"):
        faulthandler.dump_traceback_later(SLOW_S, exit=True, file=sys.__stderr__)
