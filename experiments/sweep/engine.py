"""Executors of a sweep: Dask, or this process.

Dask schedules: it assigns runs to free workers, repeats the runs of a killed worker, and scales
from the cores of this machine to a cluster. `imap_bounded` bounds the number of submitted runs, so
that memory does not grow with the size of a plan.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from ...testbed.recording.provenance import code_digest, versions
from ..errors import SweepRefused
from ..threads import ONE_THREAD

_CONNECT_S: Final = 5.0
_FIRST_WORKER_S: Final = 10.0
_KILLS: Final = 1  # workers, beyond the first, that may die on a run before it is set aside
# Of a worker. glibc returns freed memory to the system, as in Dask's own environment, which this
# one replaces.
_ENVIRONMENT: Final = {**ONE_THREAD, "MALLOC_TRIM_THRESHOLD_": "65536"}

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Engine:
    """An executor, its number of parallel tasks, and its error for a dead worker."""

    executor: Executor
    width: Callable[[], int]
    worker_died: type[Exception] | tuple[()] = ()  # raised for a task whose workers kept dying


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


@contextlib.contextmanager
def engine(workers: int | None = None, address: str | None = None) -> Iterator[Engine]:
    """Start workers on this machine, or connect to those of a cluster, until the block ends.

    Args:
        workers: processes on this machine, one per core by default; 0: this process.
        address: of a Dask scheduler, instead of workers on this machine.

    Raises:
        SweepRefused: there is no scheduler at the address, it has no workers, or their code has
            another version.
    """
    if address is None and workers == 0:
        yield Engine(InProcess(), lambda: 1)
        return
    # Imported here because Dask takes a second to load.
    from distributed import Client
    from distributed.scheduler import KilledWorker

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # the driver reports what matters
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(_local(workers or cores())) if address is None else address
        client = stack.enter_context(_client(Client, where))
        _check(client)
        yield Engine(
            client.get_executor(pure=False),
            lambda: max(1, sum(client.nthreads().values())),
            KilledWorker,
        )


def imap_bounded(
    engine: Engine, function: Callable[[Task], Result], tasks: Iterable[Task]
) -> Iterator[tuple[Task, Future[Result]]]:
    """Yield every task with its future as it completes; at most `engine.width()` are submitted.

    Tasks are taken from the iterable one at a time. If the consumer stops early, submitted tasks
    are cancelled.
    """
    waiting = iter(tasks)
    under_way: dict[Future[Result], Task] = {}
    width, more = engine.width(), True
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


def one_at_a_time(engine: Engine) -> Engine:
    """Return the engine limited to one task at a time."""
    return Engine(engine.executor, lambda: 1, engine.worker_died)


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
def _local(workers: int) -> Iterator[str]:
    """Start a scheduler in this process with worker processes; yield its address."""
    import dask.config
    from distributed import LocalCluster

    options: dict[str, Any] = {
        "n_workers": workers,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": "127.0.0.1:0",  # any free port: two sweeps can run at a time
        "memory_limit": 0,
        "silence_logs": logging.CRITICAL,
        "preload": [f"{__package__}.worker"],
        "scheduler_kwargs": {"allowed_failures": _KILLS, "dashboard": False},
    }
    with dask.config.set({"distributed.nanny.pre-spawn-environ": _ENVIRONMENT}):
        cluster: Any = LocalCluster(**options)
        with cluster:
            yield str(cluster.scheduler_address)


def _client(make: Callable[..., Any], address: str) -> Any:  # noqa: ANN401 - Dask has no types
    from distributed.comm.addressing import get_address_host_port

    try:
        get_address_host_port(address, strict=True)
    except ValueError as error:
        raise SweepRefused(f"scheduler {address!r}: is no address: {error}") from None
    try:
        return make(address, timeout=_CONNECT_S, set_as_default=False)
    except OSError as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise SweepRefused(f"scheduler {address}: cannot be reached: {reason}") from None


def _check(client: Any) -> None:  # noqa: ANN401
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
