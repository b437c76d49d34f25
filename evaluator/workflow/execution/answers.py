"""Mapping a function over jobs, on all cores or on a cluster, with identical results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from typing import TypeVar

from evaluator.workflow.execution.cluster import on_cluster
from evaluator.workflow.execution.machine import available_cores
from evaluator.workflow.execution.processes import in_processes
from evaluator.workflow.execution.sharing import Waiting, nothing
from simulator.own_effects.known import KnownEffects, with_effects

Job = TypeVar("Job")
Answer = TypeVar("Answer")


@contextmanager
def answers_of(
    work: Callable[[Job], Answer],
    jobs: Sequence[Job],
    *,
    when_killed: Callable[[Job], Answer],
    workers: int | None = None,
    dask: str | None = None,
    waiting: Waiting = nothing,
) -> Iterator[Iterator[tuple[int, Answer]]]:
    """Context of an iterator over number and answer of every job, in the order of completion.

    work: a function of a module, so that it can be pickled; each job runs on one core, and its exceptions are raised
    here. when_killed: answer for a job whose process dies every time. workers: processes, by default one per core; a
    single one works in this process; dask: address of a Dask scheduler whose workers are used instead. waiting: called
    every quarter of a second while no answer is ready. Leaving the block early, by an error or by Cancelled,
    interrupts running jobs. Other processes load the user's effects that this one knows.
    """
    known = KnownEffects.here()
    if known != KnownEffects():
        work = partial(with_effects, known, work)
    if dask is not None:
        answers = on_cluster(work, jobs, address=dask, when_killed=when_killed, waiting=waiting)
    else:
        count = workers or available_cores()
        answers = in_processes(work, jobs, workers=count, when_killed=when_killed, waiting=waiting)
    with closing(answers):
        yield answers
