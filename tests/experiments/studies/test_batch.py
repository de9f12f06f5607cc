"""Batches of a study: order of the results and errors of tasks."""

import contextlib
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from proving_ground.experiments.studies import batch
from proving_ground.experiments.sweep.engine import Engine


@pytest.fixture(autouse=True)
def threads(monkeypatch):
    @contextlib.contextmanager
    def engine():
        with ThreadPoolExecutor(4) as executor:
            yield Engine(executor, lambda: 4)

    monkeypatch.setattr(batch, "engine", engine)


def slow_first(task):
    time.sleep(0.05 if task % 4 == 0 else 0.0)
    return 10 * task


def test_results_have_the_order_of_the_tasks():
    assert list(batch.run_tasks(slow_first, range(9))) == [10 * task for task in range(9)]


def test_an_error_of_a_task_is_raised():
    with pytest.raises(ValueError, match="invalid literal"):
        list(batch.run_tasks(int, ["1", "one"]))
