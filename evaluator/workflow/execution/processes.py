"""Parallel execution on the cores of this machine."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import TypeVar

from evaluator.workflow.execution.machine import interruptible, worker_pool
from evaluator.workflow.execution.sharing import Waiting, as_completed, on_one_core

Job = TypeVar("Job")
Answer = TypeVar("Answer")


def in_processes(
    work: Callable[[Job], Answer],
    jobs: Sequence[Job],
    *,
    workers: int,
    when_killed: Callable[[Job], Answer],
    waiting: Waiting,
) -> Generator[tuple[int, Answer]]:
    """Yield number and answer of every job, in the order of completion; a single worker works in this process.

    If a worker process dies (killed, out of memory), all jobs of its pool fail: these are repeated in a separate
    process each, so that only the job that is the cause is lost; its answer is when_killed(job).
    """
    if workers == 1 or len(jobs) <= 1:
        for number, job in enumerate(jobs):
            waiting()
            yield number, on_one_core(work, job)
        return
    doing = partial(interruptible, partial(on_one_core, work))
    orphans: list[int] = []
    with worker_pool(min(workers, len(jobs))) as pool:
        futures: dict[Future[Answer], int] = {}
        for number, job in enumerate(jobs):
            try:
                futures[pool.submit(doing, job)] = number
            except BrokenProcessPool:  # while later jobs were still being submitted
                orphans.append(number)
        for future in as_completed(list(futures), waiting):
            number = futures.pop(future)
            try:
                yield number, future.result()
            except BrokenProcessPool:
                orphans.append(number)
    for number in sorted(orphans):
        with worker_pool(1) as pool:
            try:
                (future,) = as_completed([pool.submit(doing, jobs[number])], waiting)
                yield number, future.result()
            except BrokenProcessPool:
                yield number, when_killed(jobs[number])
