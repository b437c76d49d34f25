"""Parts of a long job on all cores of this machine or on a Dask cluster, in the order in which they are done."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TypeVar

from evaluator.errors import InputError

Value = TypeVar("Value")
Job = tuple[object, ...]
DASK_TIMEOUT_S = 20.0
# A worker that dies takes its parts down; each is tried again so often before the part itself is held to be at fault.
DASK_RETRIES = 5


@contextmanager
def results_of(
    work: Callable[..., Value], jobs: Iterable[Job], dask: str | None = None, workers: int | None = None
) -> Iterator[Iterator[tuple[int, Value]]]:
    """Give pairs of job number and result in the order in which they are done.

    work: a function of a module, called with the items of each job. dask: address of a running scheduler; all cores of
    this machine otherwise. Raises InputError where the scheduler cannot be reached.
    """
    if dask is not None:
        with results_on_dask(work, list(jobs), dask) as results:
            yield results
        return
    threads = os.environ.get("NUMBA_NUM_THREADS")
    os.environ["NUMBA_NUM_THREADS"] = "1"  # one process a core: threads within each would only compete
    try:
        with ProcessPoolExecutor(workers or os.cpu_count(), mp_context=get_context("spawn")) as pool:
            futures = {pool.submit(work, *job): number for number, job in enumerate(jobs)}
            try:
                yield ((futures[future], future.result()) for future in as_completed(futures))
            finally:
                pool.shutdown(wait=True, cancel_futures=True)
    finally:
        if threads is None:
            del os.environ["NUMBA_NUM_THREADS"]
        else:
            os.environ["NUMBA_NUM_THREADS"] = threads


@contextmanager
def results_on_dask(
    work: Callable[..., Value], jobs: list[Job], address: str, when_killed: Callable[..., Value] | None = None
) -> Iterator[Iterator[tuple[int, Value]]]:
    """The same on the cluster whose scheduler listens at an address.

    when_killed: the answer, from the items of a job, for one that takes every worker down that it is given to; without
    it such a job is an error.
    """
    try:
        from distributed import Client, KilledWorker
        from distributed import as_completed as completed
    except ImportError as error:
        raise InputError('--dask needs the optional extra: pip install "turnscope[dask]"') from error
    try:
        client = Client(address, timeout=DASK_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"no Dask scheduler answers at {address} ({error})") from error
    try:
        deadline = time.monotonic() + DASK_TIMEOUT_S
        while not client.scheduler_info()["workers"]:
            if time.monotonic() > deadline:
                raise InputError(
                    f"the Dask scheduler at {address} has no workers; start some with: dask worker {address}"
                )
            time.sleep(0.1)
        futures = [client.submit(work, *job, pure=False, retries=DASK_RETRIES) for job in jobs]
        numbers = {future.key: number for number, future in enumerate(futures)}

        def answers() -> Iterator[tuple[int, Value]]:
            for future in completed(futures, loop=client.loop):
                number = numbers[future.key]
                try:
                    yield number, future.result()
                except KilledWorker:
                    if when_killed is None:
                        raise
                    yield number, when_killed(*jobs[number])

        yield answers()
        client.cancel(futures)
    finally:
        client.close()
