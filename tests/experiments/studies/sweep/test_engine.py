"""Workers of this machine and of a Dask cluster: killed ones, their threads, their number."""

import os
import signal
import socket
import time

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import SweepRefused, SweepStopped
from proving_ground.experiments.studies.sweep import engine as engine_module
from proving_ground.experiments.studies.sweep.engine import Engine, InProcess, engine, imap_bounded
from proving_ground.experiments.studies.sweep.folder import lock_folder
from proving_ground.experiments.studies.sweep.results import rows
from proving_ground.experiments.studies.sweep.row import no_figures
from proving_ground.experiments.studies.sweep.sweep import sweep

from tests.experiments.study_files import SHORT, plan_of

POISON, UNLUCKY = 3, 0


def wait_until(condition, seconds=30.0):
    """Wait for a condition, for a bounded time."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)


def deadly(job):
    """Kill the worker with one run always, with another once."""
    begun = job.folder / "unlucky run has begun"
    unlucky_once = job.run == UNLUCKY and not begun.exists()
    if unlucky_once:
        begun.touch()
    if job.run == POISON:
        # A worker may take the other run first and begin it late; it must die of its own doing.
        wait_until(begun.exists)
    if unlucky_once or job.run == POISON:
        os.kill(os.getpid(), signal.SIGKILL)
    return job.row("completed", None, no_figures(), float(os.getpid()))


def check_outlives_its_workers(workers, folder):
    """A run whose worker dies is driven once more; one that kills that, too, becomes a row."""
    plan = plan_of(folder, "seeds = 8", SHORT)
    with lock_folder(folder / "out", plan) as locked:
        sweep(plan, locked, workers, work=deadly)
    results = sorted(rows(folder / "out" / "results.jsonl"), key=lambda row: row["run"])
    assert [row["run"] for row in results] == list(range(8))
    assert [row["run"] for row in results if row["status"] == "crashed"] == [POISON]
    assert results[UNLUCKY]["attempts"] == 2
    assert [*results[POISON]] == [*results[UNLUCKY]]


def test_a_sweep_outlives_the_processes_of_this_machine_with_one_thread_each(tmp_path):
    with engine(workers=2) as workers:
        check_outlives_its_workers(workers, tmp_path)
        assert workers.executor.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
        assert workers.width() == 3  # one waits


def test_a_sweep_outlives_the_workers_of_a_cluster_with_the_same_code(tmp_path, monkeypatch):
    from distributed import LocalCluster

    options = {"host": "127.0.0.1", "dashboard_address": None, "silence_logs": 50}
    failures = {"allowed_failures": 0}
    with LocalCluster(
        n_workers=2, threads_per_worker=1, scheduler_kwargs=failures, **options
    ) as cluster:
        with engine(address=cluster.scheduler_address) as workers:
            check_outlives_its_workers(workers, tmp_path)
        same = engine_module.provenance()
        with monkeypatch.context() as patch:
            patch.setattr(engine_module, "provenance", _Other({**same, "code": "other"}))
            with (
                pytest.raises(SweepRefused, match="code"),
                engine(address=cluster.scheduler_address),
            ):
                pass
        with engine(address=cluster.scheduler_address) as workers:
            cluster.close()
            with pytest.raises(SweepStopped, match="gone"):
                workers.width()


class _Other:
    """Versions of this process that differ from those that a worker finds out itself."""

    def __init__(self, here):
        self.here = here

    def __call__(self):
        return self.here

    def __reduce__(self):
        return getattr, (engine_module, "provenance")


@pytest.mark.parametrize(
    ("address", "installed", "named"),
    [
        ("somewhere", True, "somewhere"),
        ("tcp://127.0.0.1:9", True, "tcp://127.0.0.1:9"),
        ("tcp://127.0.0.1:9", False, "[cluster]"),
    ],
)
def test_no_scheduler_is_one_line(address, installed, named, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(engine_module, "_CONNECT_S", 0.5)
    if not installed:
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    plan_of(tmp_path, SHORT)
    assert main(["sweep", "tiny.toml", "--dask", address]) == 2
    printed = capsys.readouterr().err
    assert named in printed
    assert len(printed.splitlines()) == 1
    assert [item.name for item in tmp_path.iterdir()] == ["tiny.toml"]


@pytest.mark.parametrize("scheme", ["tcp", "tls"])
def test_what_listens_and_is_no_scheduler_is_refused_within_a_time(scheme, monkeypatch):
    monkeypatch.setattr(engine_module, "_NO_DASK_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"{scheme}://127.0.0.1:{silent.getsockname()[1]}"
        begun = time.monotonic()
        with pytest.raises(SweepRefused, match=address) as refused, engine(address=address):
            pass
        assert time.monotonic() < begun + 10.0
        assert "\n" not in str(refused.value)


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
    ((_, future),) = imap_bounded(Engine(InProcess(), lambda: 1), int, ["no number"])
    assert isinstance(future.exception(), ValueError)
