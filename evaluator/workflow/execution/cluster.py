"""Parallel execution on a Dask cluster."""

from __future__ import annotations

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
DASK_TIMEOUT_S = 20.0
# Number of retries of a job after its worker died, before the job is considered the cause.
DASK_RETRIES = 5


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
    worker dies. Raises InputError if no scheduler answers.
    """
    if not jobs:
        return
    with _client(address) as client:
        from distributed import KilledWorker

        doing = partial(on_one_core, work)
        futures = [client.submit(doing, job, pure=False, retries=DASK_RETRIES) for job in jobs]
        numbers = {future.key: number for number, future in enumerate(futures)}
        try:
            for future in as_completed(futures, waiting):
                number = numbers.pop(future.key)
                try:
                    answer = future.result()
                except KilledWorker:
                    answer = when_killed(jobs[number])
                future.release()  # an answer that a worker kept would be computed again if that worker died
                yield number, answer
        finally:
            client.cancel([future for future in futures if future.key in numbers])


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
