"""Threads of the numerical libraries in a process of the command line."""

import os
import subprocess
import sys

import pytest
from proving_ground.experiments.threads import ONE_THREAD

_LINE = """
import os, sys
from proving_ground.experiments.commands.cli import main
assert "numpy" not in sys.modules
main(["completion", "bash"])
import numpy as np
square = np.ones((500, 500))
square @ square
print()
print(os.environ["OMP_NUM_THREADS"], len(os.listdir("/proc/self/task")))
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="threads are counted by Linux")
@pytest.mark.parametrize("chosen", [None, "3"])
def test_products_of_matrices_take_one_thread_or_as_many_as_the_user_says(chosen):
    environment = {key: value for key, value in os.environ.items() if key not in ONE_THREAD}
    if chosen:
        environment |= dict.fromkeys(ONE_THREAD, chosen)
    line = [sys.executable, "-c", _LINE]
    output = subprocess.run(
        line, env=environment, check=True, capture_output=True, text=True
    ).stdout
    expected = chosen or "1"
    assert output.splitlines()[-1] == f"{expected} {expected}"
