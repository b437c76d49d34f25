"""Dependences on the operating system: number of cores, and start and end of worker processes."""

from __future__ import annotations

import gc
import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import TypeVar

from evaluator.progress import Cancelled

Job = TypeVar("Job")
Answer = TypeVar("Answer")


def available_cores() -> int:
    """Cores this process may use (a container or a scheduler may grant fewer than the machine has)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _WithoutScript:
    """A process that does not run the script of its parent, and collects garbage as seldom as its parent.

    All functions for processes are in turnscope's packages. Python normally runs the script as well, which repeats its
    imports in each process, and all of its work if it has no `if __name__ == "__main__"`.
    """

    def start(self) -> None:
        """Start the process while the script is hidden."""
        self._collecting = gc.get_threshold()
        with _hiding:
            script = sys.modules["__main__"]
            sys.modules["__main__"] = ModuleType("__main__")
            try:
                super().start()  # type: ignore[misc]
            finally:
                sys.modules["__main__"] = script

    def run(self) -> None:
        """Do the work. Imports are not searched for garbage, as compiling a run would do for a tenth of its time."""
        gc.set_threshold(*self._collecting)
        gc.freeze()
        super().run()  # type: ignore[misc]


_hiding = threading.Lock()


class _Spawned(_WithoutScript, SpawnProcess):
    pass


class Spawning(SpawnContext):
    """Start method of processes on systems without a fork server."""

    Process = _Spawned


if sys.platform == "linux":

    class _Forked(_WithoutScript, multiprocessing.context.ForkServerProcess):
        pass

    class _Forking(multiprocessing.context.ForkServerContext):
        Process = _Forked

    # A fork server imports the libraries once for all processes, because this takes longer than most jobs. It has no
    # threads, which make plain forks unsafe.
    PROCESSES = _Forking()
    PROCESSES.set_forkserver_preload(["evaluator.workflow.execution.fork_server", "evaluator.workflow.runs.stages"])
else:
    PROCESSES = Spawning()


def prepare_processes() -> None:
    """Start the fork server where there is one, so that it imports the libraries while this process does."""
    if sys.platform == "linux":
        from multiprocessing.forkserver import ensure_running

        ensure_running()


@contextmanager
def worker_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Context of a pool of worker processes; jobs that still run at its end are interrupted.

    Submit work through `interruptible`. Workers end with this process, even if it is killed.
    """
    ended, end = PROCESSES.Pipe(duplex=False)
    pool = ProcessPoolExecutor(workers, mp_context=PROCESSES, initializer=_begin, initargs=(ended,))
    try:
        yield pool
    finally:
        end.close()  # every worker detects the end of its pipe
        pool.shutdown(wait=True, cancel_futures=True)
        ended.close()


class _Worker:
    """Whether this worker process has a job, and whether its pool has ended."""

    busy = False
    ending = False


def interruptible(work: Callable[[Job], Answer], job: Job) -> Answer:
    """Do a job in a worker process; raises Cancelled when the pool ends, so that no incomplete files are left."""
    _Worker.busy = True
    try:
        if _Worker.ending:
            raise Cancelled
        return work(job)
    finally:
        _Worker.busy = False


def _begin(ended: Connection) -> None:
    """Prepare a worker process: an interrupt from the terminal is handled by the parent, which ends the pool."""
    signal.signal(signal.SIGINT, _interrupted)
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_watch, args=(ended, parent.sentinel), daemon=True).start()


def _watch(ended: Connection, parent: int) -> None:
    """Wait in a thread: interrupt the job when the pool ends, and exit when the parent has ended."""
    if parent not in multiprocessing.connection.wait([parent, ended]):
        _Worker.ending = True
        _interrupt_main()
        multiprocessing.connection.wait([parent])
    os._exit(1)


def _interrupt_main() -> None:
    """Call `_interrupted` in the main thread, even during a system call (except on Windows)."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        interrupt_main()


def _interrupted(number: int, frame: object) -> None:
    del number, frame
    if _Worker.busy and _Worker.ending:
        raise Cancelled
