"""Where runs are carried out: any `concurrent.futures.Executor`; Dask's, or none but this process.

Dask does what is hard about it: it finds free workers, brings the runs of a killed worker back, and
spans from the cores of this machine to a cluster. Nothing here schedules; `flow` only keeps the
number of runs under way bounded, so that a plan of any size takes no memory.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from proving_ground.testbed.recording.provenance import code_digest, versions

from ..errors import SweepRefused

_CONNECT_S: Final = 5.0
_FIRST_WORKER_S: Final = 10.0
_KILLS: Final = 1  # workers that a run may take with it before it is put aside, beyond the first
# One thread each: runs are independent, and more threads than cores only wait for each other.
_ENVIRONMENT: Final = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Engine:
    """An executor, how many tasks it carries out at a time, and how it says that a worker died."""

    executor: Executor
    width: Callable[[], int]
    died: type[Exception] | tuple[()] = ()  # of a task whose workers died again and again


class InProcess(Executor):
    """Carries a task out as it is submitted, in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401
        """Return the future of a call, done."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextlib.contextmanager
def engine(workers: int | None = None, address: str | None = None) -> Iterator[Engine]:
    """Start workers, or reach those of a cluster; they are one's own until the block is left.

    Args:
        workers: processes on this machine, one a core by default; 0 for this process.
        address: of a Dask scheduler, in place of workers here.

    Raises:
        SweepRefused: there is no scheduler at the address, it has no workers, or they would drive
            with another version of the code.
    """
    if address is None and workers == 0:
        yield Engine(InProcess(), lambda: 1)
        return
    # Here, because Dask takes a second to load.
    from distributed import Client
    from distributed.scheduler import KilledWorker

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # we say ourselves what matters
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(_local(workers or cores())) if address is None else address
        client = stack.enter_context(_client(Client, where))
        _check(client)
        yield Engine(
            client.get_executor(pure=False),
            lambda: max(1, sum(client.nthreads().values())),
            KilledWorker,
        )


def flow(
    engine: Engine, function: Callable[[Task], Result], tasks: Iterable[Task]
) -> Iterator[tuple[Task, Future[Result]]]:
    """Yield every task with its future as it is done; no more are under way than can be worked on.

    Tasks are taken one at a time as there is room. Where the block is left early, those that are
    under way are cancelled.
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


def alone(engine: Engine) -> Engine:
    """Return the engine with one task at a time."""
    return Engine(engine.executor, lambda: 1, engine.died)


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def provenance() -> dict[str, str]:
    """Return what has to be the same in the driver and in every worker."""
    packages = {name: found for name, found in versions().items() if name != "commit"}
    return {**packages, "code": code_digest()}


@contextlib.contextmanager
def _local(workers: int) -> Iterator[str]:
    """Start a scheduler in this process and workers beside it; yield its address."""
    import dask.config
    from distributed import LocalCluster

    options: dict[str, Any] = {
        "n_workers": workers,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": "127.0.0.1:0",  # any free port: two sweeps may go on side by side
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
    """Refuse a cluster without workers, or with workers that have other code."""
    where = client.scheduler.address
    try:
        client.wait_for_workers(1, timeout=_FIRST_WORKER_S)
        answers = client.run(provenance)
    except TimeoutError:
        raise SweepRefused(f"scheduler {where}: has no workers") from None
    except Exception as error:  # what a worker without our code raises is up to it
        reason = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise SweepRefused(
            f"scheduler {where}: its workers do not have this version of the code: {reason}"
        ) from None
    here = provenance()
    for worker, there in answers.items():
        for name in sorted({*here, *there}):
            if here.get(name) != there.get(name):
                raise SweepRefused(
                    f"worker {worker}: has {name} {there.get(name)}, the driver has "
                    f"{here.get(name)}; both must have the same"
                )
