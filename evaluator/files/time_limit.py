"""A limit for readers of native libraries that can loop without end in a damaged file.

Neither an exception nor a thread ends such a loop, because the library does not return to Python. A timer of the
operating system ends the process, whose parent reports it in one sentence. Therefore the limit holds only in processes
that may die: the child of a command, and workers. Windows has no such timer.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# Processor time: a slow disk or a busy machine is no fault of the file. The largest table that is read
# (pose_estimators.MOST_NUMBERS, compressed) takes 5.2 s of it, and took 95 s by the clock beside 15 other programs.
LONGEST_S = 20.0


class _ThisProcess:
    """Whether another process reports the end of this one."""

    is_watched = False


def mark_as_watched() -> None:
    """State that this process was started to read files, and that its parent reports its end."""
    _ThisProcess.is_watched = True


@contextmanager
def limited(seconds: float | None = None) -> Iterator[None]:
    """Context in which a process that may die is ended after this processor time (LONGEST_S); elsewhere no limit."""
    from multiprocessing import parent_process

    may_die = _ThisProcess.is_watched or parent_process() is not None
    if not (may_die and hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()):
        yield
        return
    before = signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S if seconds is None else seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
