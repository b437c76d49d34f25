"""The same function over many jobs, in processes on all cores or on a cluster; the answers depend on neither."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import TypeVar

from evaluator.workflow.execution.scale_out import results_on_dask

Job = TypeVar("Job")
Answer = TypeVar("Answer")


def available_cores() -> int:
    """Cores this process may use (a container or a scheduler may grant fewer than the machine has)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_processes(
    work: Callable[[Job], Answer],
    jobs: Sequence[Job],
    *,
    workers: int,
    when_killed: Callable[[Job], Answer],
) -> Iterator[Answer]:
    """Yield work(job) for every job, in the order of completion.

    work must not raise for a job's own sake. A worker process that dies (killed, out of memory) takes the jobs of its
    pool with it: these are tried once more, each in a process of its own, so that only the guilty one is lost, for
    which when_killed(job) is the answer.
    """
    if workers == 1 or len(jobs) <= 1:
        yield from (on_one_core(work, job) for job in jobs)
        return
    orphans: list[Job] = []
    with _pool(min(workers, len(jobs))) as pool:
        futures: dict[Future[Answer], Job] = {}
        try:
            for job in jobs:
                try:
                    futures[pool.submit(on_one_core, work, job)] = job
                except BrokenProcessPool:  # already, while the later jobs were still being handed out
                    orphans.append(job)
            for future in as_completed(futures):
                try:
                    yield future.result()
                except BrokenProcessPool:
                    orphans.append(futures[future])
        finally:
            for future in futures:
                future.cancel()
    for job in orphans:
        with _pool(1) as pool:
            try:
                yield pool.submit(on_one_core, work, job).result()
            except BrokenProcessPool:
                yield when_killed(job)


def _pool(workers: int) -> ProcessPoolExecutor:
    # A fork server imports the libraries once and is free of the threads that make plain forks unsafe.
    method = "forkserver" if sys.platform == "linux" else "spawn"
    context = multiprocessing.get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload(["evaluator.workflow.stages"])
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_end_with_parent)


def _end_with_parent() -> None:
    """Let a worker end when its parent does: killed outright, a parent can tell nobody."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def on_cluster(
    work: Callable[[Job], Answer], jobs: Sequence[Job], *, address: str, when_killed: Callable[[Job], Answer]
) -> Iterator[Answer]:
    """Yield work(job) for every job, done by the workers of a Dask cluster, in the order of completion.

    A worker that dies loses nothing: its jobs go to the others. Raises InputError where no scheduler answers.
    """
    if not jobs:
        return
    with results_on_dask(partial(on_one_core, work), [(job,) for job in jobs], address, when_killed) as results:
        for _, answer in results:
            yield answer


def on_one_core(work: Callable[[Job], Answer], job: Job) -> Answer:
    """Do a job without threads of the libraries: processes share the cores, and sums keep one order of addition."""
    import cv2
    from threadpoolctl import threadpool_limits

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(1):
            return work(job)
    finally:
        cv2.setNumThreads(threads)
