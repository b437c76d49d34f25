"""Common part of local and cluster execution: one core per job, results in order of completion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

Job = TypeVar("Job")
Answer = TypeVar("Answer")
Waiting = Callable[[], None]

PULSE_S = 0.25  # longer delays of a cancel button are noticeable


def nothing() -> None:
    """Do nothing while waiting."""


@contextmanager
def one_core() -> Iterator[None]:
    """Limit libraries to one thread, because processes share the cores, and to fix the order of summation."""
    import cv2
    import numba
    from threadpoolctl import threadpool_limits

    of_opencv, of_numba = cv2.getNumThreads(), numba.get_num_threads()
    cv2.setNumThreads(1)
    numba.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        numba.set_num_threads(of_numba)
        cv2.setNumThreads(of_opencv)


def on_one_core(work: Callable[[Job], Answer], job: Job) -> Answer:
    """Do a job on one core."""
    with one_core():
        return work(job)


def as_completed(futures: Sequence[Any], waiting: Waiting) -> Iterator[Any]:
    """Futures (of concurrent.futures or Dask) in the order of completion.

    waiting: called every quarter of a second in between; it may raise to stop.
    """
    done: SimpleQueue[Any] = SimpleQueue()
    for future in futures:
        future.add_done_callback(done.put)
    for _ in futures:
        while True:
            try:
                future = done.get(timeout=PULSE_S)
                break
            except Empty:
                waiting()
        yield future
