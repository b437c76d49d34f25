"""Control of a diagnosis between the steps of its fits: cancellation, time limit, and cores."""

from __future__ import annotations

import math
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from time import process_time
from typing import Any, Protocol, Self

from numba import set_num_threads

from evaluator.progress import Progress, no_progress

# Seconds of processor time after which a search ends. Of the experiments of the second world the slowest took 114 s on
# a busy machine: one that goes on for half as long again is lost.
USUAL_SECONDS = 180.0


class Each(Protocol):
    """Does a work for each of some items: map, or that of a pool of threads."""

    def __call__(self, work: Any, items: Iterable[Any], /) -> Iterable[Any]:
        """Results in the order of the items."""
        ...


class Cores:
    """Does independent pieces of work on so many cores; one after the other outside its block, and with one core.

    Results do not depend on how many there are.
    """

    def __init__(self, count: int) -> None:
        """count: how many."""
        self._count, self._pool = count, ExitStack()
        self._map: Each = map

    def __enter__(self) -> Self:
        """Start the threads; the kernels of a piece keep to its thread."""
        if self._count > 1:
            threads = ThreadPoolExecutor(self._count, initializer=set_num_threads, initargs=(1,))
            self._map = self._pool.enter_context(threads).map
        return self

    def __exit__(self, *_: object) -> None:
        """End the threads."""
        self._map = map
        self._pool.close()

    def __call__(self, work: Any, items: Iterable[Any], /) -> Iterable[Any]:
        """Results in the order of the items."""
        return self._map(work, items)


class SearchStoppedError(Exception):
    """A search has used up its time; the fits made so far are kept."""

    def __init__(self, seconds: float, so_far: str = "") -> None:
        """seconds: what it was given. so_far: what it had found."""
        self.so_far = so_far
        tail = f"; so far, {so_far}" if so_far else ""
        super().__init__(
            f"the search was stopped after {seconds:g} s of processor time without a decision: "
            f"diagnose again to continue it, or give it more time (--seconds){tail}"
        )


class Watch:
    """A Progress that passes on what it is told, and says it again, or raises SearchStoppedError, at every look.

    Time is that of the processor, of all threads: a busy machine does not make a search end earlier.
    """

    def __init__(self, progress: Progress = no_progress, seconds: float = math.inf, each: Each = map) -> None:
        """seconds: that the search may take from now on. each: how independent pieces of work are done."""
        self._progress, self._seconds, self._began = progress, seconds, process_time()
        self._last: tuple[str, float] | None = None
        self.each = each
        self.so_far = ""  # what a search has found, should it be stopped

    def __call__(self, stage: str, done: float, total: float = 1.0, /) -> None:
        """Take note of how far the work is."""
        self._last = (stage, done / total)
        self._progress(*self._last)

    def look(self) -> None:
        """Whether to go on: raises SearchStoppedError where the time is over, and what the progress raises."""
        if process_time() - self._began > self._seconds:
            raise SearchStoppedError(self._seconds, self.so_far)
        if self._last is not None:
            self._progress(*self._last)
