"""Executors of runs: processes of this machine, this process, or a Dask cluster.

`imap_bounded` bounds the number of submitted runs, so that memory does not grow with the size of a
plan.
"""

import asyncio
import contextlib
import importlib.util
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import connection
from typing import Any, Final, TypeVar

from ....testbed.errors import install_hint
from ....testbed.recording.provenance import code_digest, versions
from ...errors import SweepRefused, SweepStopped
from ...numerics import ONE_THREAD

_CONNECT_S: Final = 5.0
_NO_DASK_S: Final = 8.0  # in which an address answers as a scheduler; what is none may stay silent
_FIRST_WORKER_S: Final = 10.0
# Of a worker. With the last entry glibc returns freed memory to the system.
_ENVIRONMENT: Final = {**ONE_THREAD, "MALLOC_TRIM_THRESHOLD_": "65536"}

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Engine:
    """An executor, the number of tasks that it has at a time, and its error for a dead worker."""

    executor: Executor
    width: Callable[[], int]
    worker_died: type[Exception] | tuple[()] = ()  # raised for a task whose workers died


class InProcess(Executor):
    """Executor that runs a task in this process as it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401
        """Call the function and return its finished future."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Processes(Executor):
    """Pool of processes that begins anew after the death of a worker.

    All tasks that were under way with it then raise `BrokenProcessPool`. Workers do not see Ctrl-C,
    which the driver handles, and end with the driver, even if that is killed.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._others = {*multiprocessing.active_children()}
        self._pool = self._begin()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401
        """Submit a call to the pool, which starts its processes with the first calls."""
        # A new process inherits environment and blocked signals.
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        with _environment(_ENVIRONMENT):
            try:
                return self._pool.submit(fn, *args, **kwargs)
            except BrokenProcessPool:
                self._pool.shutdown()
                self._pool = self._begin()
                return self._pool.submit(fn, *args, **kwargs)
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, blocked)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes; calls under way are lost."""
        for process in {*multiprocessing.active_children()} - self._others:
            process.terminate()
        self._pool.shutdown(wait, cancel_futures=cancel_futures)

    def _begin(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._workers, context, _end_with_driver)


def _end_with_driver() -> None:
    """End this worker when its driver has died; the pool itself would wait forever."""
    driver = multiprocessing.parent_process()
    assert driver is not None

    def watch() -> None:
        connection.wait([driver.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def engine(workers: int | None = None, address: str | None = None) -> Iterator[Engine]:
    """Start workers on this machine, or connect to a cluster's, until the block ends.

    Args:
        workers: processes on this machine, one per core by default; 0: this process.
        address: of a Dask scheduler, instead of workers on this machine.

    Raises:
        SweepRefused: Dask is not installed, there is no scheduler at the address, it has no
            workers, or their code has another version.
    """
    if address is not None:
        with _cluster(address) as cluster:
            yield cluster
    elif workers == 0:
        yield Engine(InProcess(), lambda: 1)
    else:
        count = workers or cores()
        with Processes(count) as executor:
            # one task more than workers: none of them waits for the driver
            yield Engine(executor, lambda: count + 1, BrokenProcessPool)


def imap_bounded(
    engine: Engine, function: Callable[[Task], Result], tasks: Iterable[Task]
) -> Iterator[tuple[Task, Future[Result]]]:
    """Yield every task with its future as it completes; at most `engine.width()` are submitted.

    Tasks are taken from the iterable one at a time. If the consumer stops early, submitted tasks
    are cancelled.
    """
    waiting = iter(tasks)
    under_way: dict[Future[Result], Task] = {}
    width = engine.width()
    more = True
    try:
        while True:
            while more and len(under_way) < width:
                for task in waiting:
                    under_way[engine.executor.submit(function, task)] = task
                    break
                else:
                    more = False
            if not under_way:
                return
            done, _ = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                yield under_way.pop(future), future
            width = engine.width()
    finally:
        for future in under_way:
            future.cancel()


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def provenance() -> dict[str, str]:
    """Return the versions that must be the same in the driver and in every worker."""
    packages = {name: version for name, version in versions().items() if name != "commit"}
    return {**packages, "code": code_digest()}


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set environment variables of this process until the block ends."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


@contextlib.contextmanager
def _cluster(address: str) -> Iterator[Engine]:
    if importlib.util.find_spec("distributed") is None:
        raise SweepRefused(f"scheduler {address}: needs Dask; {install_hint('cluster')}")
    from distributed import Client
    from distributed.comm.addressing import get_address_host_port
    from distributed.scheduler import KilledWorker

    for name in [*logging.root.manager.loggerDict]:  # each has a level of its own
        if name.startswith("distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # the driver reports what matters
    try:
        get_address_host_port(address, strict=True)
    except ValueError as error:
        raise SweepRefused(f"scheduler {address!r}: is no address: {error}") from None
    _find_scheduler(address)
    try:
        client: Any = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except OSError as error:  # it has just gone
        raise SweepRefused(f"scheduler {address}: cannot be reached: {error}") from None
    with client:
        _check(client)

        def width() -> int:
            try:
                return max(1, sum(client.nthreads().values()))
            except OSError:
                raise SweepStopped("the scheduler is gone") from None

        yield Engine(client.get_executor(pure=False), width, KilledWorker)


def _find_scheduler(address: str) -> None:
    """Ask for the identity of what answers at an address, within a time.

    A `Client` of an address that is no scheduler waits for ever, and so does its end.

    Raises:
        SweepRefused: nothing answers, or something that is no scheduler.
    """
    from distributed.comm.core import connect

    async def ask() -> None:
        comm = await connect(address, timeout=_CONNECT_S)
        try:
            await comm.write({"op": "identity", "reply": True})
            await comm.read()
        finally:
            comm.abort()

    try:
        asyncio.run(asyncio.wait_for(ask(), _NO_DASK_S))
        return
    except TimeoutError as error:
        reason = str(error) or f"no scheduler answers within {_NO_DASK_S:g} s"
    except Exception as error:  # of the address's transport: anything
        reason = f"{error}" or type(error).__name__
    reason = reason.partition("\n")[0]
    raise SweepRefused(f"scheduler {address}: cannot be reached: {reason}")


def _check(client: Any) -> None:  # noqa: ANN401 - Dask has no types
    """Refuse a cluster without workers, or with workers whose code differs."""
    where = client.scheduler.address
    try:
        client.wait_for_workers(1, timeout=_FIRST_WORKER_S)
        provenances = client.run(provenance)
    except TimeoutError:
        raise SweepRefused(f"scheduler {where}: has no workers") from None
    except Exception as error:  # a worker without this code can raise anything
        reason = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise SweepRefused(
            f"scheduler {where}: its workers do not have this version of the code: {reason}"
        ) from None
    here = provenance()
    for worker, remote in provenances.items():
        for name in sorted({*here, *remote}):
            if here.get(name) != remote.get(name):
                raise SweepRefused(
                    f"worker {worker}: has {name} {remote.get(name)}, the driver has "
                    f"{here.get(name)}; both must have the same"
                )
