"""Batches of a study: order of the results and errors of tasks."""

import contextlib
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
from proving_ground.experiments.studies import batch
from proving_ground.experiments.sweep.engine import Engine


@pytest.fixture(autouse=True)
def threads(monkeypatch):
    @contextlib.contextmanager
    def engine(workers=None):
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


def test_finished_tasks_are_kept_and_a_torn_one_is_computed_again(tmp_path):
    settings = batch.BatchSettings(results=tmp_path / "tasks.pickle")
    calls = tmp_path / "calls"

    def drive(tasks):
        calls.write_text("")
        with batch.batch_settings(settings):
            results = list(batch.run_tasks(partial(counted, calls), tasks))
        return results, len(calls.read_text())

    assert drive([1, 2, 3]) == ([10, 20, 30], 3)
    assert drive([3, 4, 1]) == ([30, 40, 10], 1)
    content = settings.results.read_bytes()
    settings.results.write_bytes(content[:-3])
    assert drive([3, 4, 1]) == ([30, 40, 10], 1)
    assert drive([3, 4, 1]) == ([30, 40, 10], 0)


def counted(calls, task):
    with calls.open("a") as stream:
        stream.write("x")
    return 10 * task
