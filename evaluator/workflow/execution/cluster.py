"""Parallel execution on a Dask cluster.

The memory of a worker grows by 0.3 MB a recording, which Dask's profiler keeps; the help of --dask says how to start
workers without it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from evaluator.errors import InputError
from evaluator.workflow.execution.sharing import Waiting, as_completed, on_one_core

if TYPE_CHECKING:
    from distributed import Client

Job = TypeVar("Job")
Answer = TypeVar("Answer")
DASK_TIMEOUT_S = 20.0  # for the answer of a scheduler, also one that is starting
# Number of retries of a job after its worker died, before the job is considered the cause.
DASK_RETRIES = 5
# Time without any worker after which a batch ends: workers that are started again, or moved by a queue, take less.
WITHOUT_WORKERS_S = 120.0
LOOK_S = 5.0  # between two questions to the scheduler whether it has workers


def on_cluster(
    work: Callable[[Job], Answer],
    jobs: Sequence[Job],
    *,
    address: str,
    when_killed: Callable[[Job], Answer],
    waiting: Waiting,
) -> Generator[tuple[int, Answer]]:
    """Yield number and answer of every job, done by the workers of a Dask cluster, in the order of completion.

    The jobs of a worker that dies are done by the others; when_killed(job) is the answer for a job with which every
    worker dies. Raises InputError if no scheduler answers, or if it has no workers for WITHOUT_WORKERS_S.
    """
    if not jobs:
        return
    with _client(address) as client:
        from distributed import KilledWorker

        doing = partial(on_one_core, work)
        futures = [client.submit(doing, job, pure=False, retries=DASK_RETRIES) for job in jobs]
        numbers = {future.key: number for number, future in enumerate(futures)}
        try:
            for future in as_completed(futures, _noticing_lost_workers(client, address, waiting)):
                number = numbers.pop(future.key)
                try:
                    answer = future.result()
                except KilledWorker:
                    answer = when_killed(jobs[number])
                future.release()  # an answer that a worker kept would be computed again if that worker died
                yield number, answer
        finally:
            client.cancel([future for future in futures if future.key in numbers])


def _noticing_lost_workers(client: Client, address: str, waiting: Waiting) -> Waiting:
    """A wait that also ends if a cluster has had no worker for WITHOUT_WORKERS_S; Dask itself waits without a word."""
    looked, without_since = time.monotonic(), math.inf

    def wait() -> None:
        nonlocal looked, without_since
        waiting()
        now = time.monotonic()
        if now - looked < LOOK_S:
            return
        looked = now
        without_since = math.inf if client.scheduler_info()["workers"] else min(without_since, now)
        if now - without_since > WITHOUT_WORKERS_S:
            raise InputError(
                f"the Dask scheduler at {address} has lost all its workers: start some with dask worker {address}, and "
                "repeat the command; finished work is kept"
            )

    return wait


@contextmanager
def _client(address: str) -> Iterator[Client]:
    """Context of a connection to the scheduler at an address, once it has workers."""
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError('--dask needs the optional extra: pip install "turnscope[dask]"') from error
    try:
        client = Client(address, timeout=DASK_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"no Dask scheduler responds at {address} ({error})") from error
    try:
        deadline = time.monotonic() + DASK_TIMEOUT_S
        while not client.scheduler_info()["workers"]:
            if time.monotonic() > deadline:
                raise InputError(
                    f"the Dask scheduler at {address} has no workers; start some with: dask worker {address}"
                )
            time.sleep(0.1)
        yield client
    finally:
        client.close()
