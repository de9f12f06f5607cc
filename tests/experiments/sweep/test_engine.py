"""Sweeps on a real Dask scheduler with its own workers, as on a cluster."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.sweep.engine import Engine, InProcess, engine, imap_bounded
from proving_ground.experiments.sweep.folder import lock_folder
from proving_ground.experiments.sweep.results import rows
from proving_ground.experiments.sweep.row import no_figures
from proving_ground.experiments.sweep.sweep import sweep

from tests.experiments.study_files import SHORT, plan_of

ROOT = Path(__file__).parents[3]
PACKAGES = ("packaging/proving_ground", "ttempc", "tests")
POISON, UNLUCKY = 3, 5


def deadly(job):
    """Kill the worker with one run always, with another once."""
    mark = job.folder / "was here"
    if job.run == POISON or (job.run == UNLUCKY and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return job.row("completed", None, no_figures(), float(os.getpid()))


@pytest.fixture
def dask(tmp_path):
    """A function that starts a part of a cluster; all of them end with the test."""
    parts = []

    def start(*arguments, code=ROOT):
        once = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
        environment = {**os.environ, **once, "PYTHONPATH": str(code)}
        command = [sys.executable, "-m", "dask", *arguments]
        parts.append(
            subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.DEVNULL)
        )
        return parts[-1]

    yield start
    for part in reversed(parts):  # workers first: they take leave of their scheduler
        part.terminate()
        try:
            part.wait(timeout=10)
        except subprocess.TimeoutExpired:
            part.kill()
            part.wait()


@pytest.fixture
def scheduler(dask, tmp_path):
    file = tmp_path / "scheduler.json"
    options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    dask("scheduler", *options, "--scheduler-file", str(file))
    while not file.exists() or not file.stat().st_size:
        time.sleep(0.05)
    return json.loads(file.read_text())["address"]


def test_a_sweep_on_a_cluster_outlives_its_workers(dask, scheduler, tmp_path, capsys):
    plan = plan_of(tmp_path, "seeds = 8", SHORT)

    other = tmp_path / "other"
    for package in PACKAGES[:-1]:
        shutil.copytree(ROOT / package, other / Path(package).name)
    with open(other / "ttempc" / "reference" / "path.py", "a") as file:
        file.write("# changed\n")
    options = ("--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1")
    stranger = dask("worker", scheduler, *options, "--no-nanny", code=other)
    assert main(["sweep", str(tmp_path / "tiny.toml"), "--dask", scheduler]) == 2
    printed = capsys.readouterr().err
    assert "has code" in printed
    assert len(printed.splitlines()) == 1
    stranger.terminate()
    stranger.wait()

    dask("worker", scheduler, *options, "--nworkers", "2")
    with (
        engine(address=scheduler) as cluster,
        lock_folder(tmp_path / "out", plan) as folder,
    ):
        sweep(plan, folder, cluster, work=deadly)
    results = sorted(rows(tmp_path / "out" / "results.jsonl"), key=lambda row: row["run"])
    assert [row["run"] for row in results] == list(range(8))
    assert [row["run"] for row in results if row["status"] == "crashed"] == [POISON]
    assert results[UNLUCKY]["status"] == "completed"
    assert [*results[POISON]] == [*results[UNLUCKY]]


@pytest.mark.parametrize("address", ["somewhere", "tcp://127.0.0.1:9"])
def test_an_unreachable_scheduler_is_refused_in_one_line(address, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("proving_ground.experiments.sweep.engine._CONNECT_S", 0.5)
    plan_of(tmp_path, SHORT)
    assert main(["sweep", "tiny.toml", "--dask", address]) == 2
    printed = capsys.readouterr().err
    assert "scheduler" in printed
    assert len(printed.splitlines()) == 1
    assert [item.name for item in tmp_path.iterdir()] == ["tiny.toml"]


def test_no_more_tasks_are_submitted_than_the_width_allows():
    taken = []

    def tasks():
        for task in range(20):
            taken.append(task)
            yield task

    for task, future in imap_bounded(
        Engine(InProcess(), lambda: 3), lambda task: 2 * task, tasks()
    ):
        assert future.result() == 2 * task
        assert len(taken) <= task + 6
    assert taken == list(range(20))


def test_an_error_of_a_task_is_in_its_future():
    ((_, future),) = imap_bounded(Engine(InProcess(), lambda: 1), int, ["no number"])
    assert isinstance(future.exception(), ValueError)


def test_workers_have_one_thread_each_and_two_sweeps_can_run_at_a_time():
    with engine(workers=1), engine(workers=1) as here:
        futures = [here.executor.submit(os.environ.get, name) for name in ("OMP_NUM_THREADS",)]
        assert [future.result() for future in futures] == ["1"]
        assert here.width() == 1
