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
# a busy machine; the limit is half as long again.
USUAL_SECONDS = 180.0
# A search one of whose models explains the runs has so many times as long: what is left to do is limited. Two sessions
# that 180 s had not decided, of command logs and of a pivot with two motions, were decided rightly within this time.
EXPLAINED_TIMES = 2.0


class Each(Protocol):
    """A map function: the built-in one, or that of a pool of threads."""

    def __call__(self, work: Any, items: Iterable[Any], /) -> Iterable[Any]:
        """Results in the order of the items."""
        ...


class Cores:
    """Maps independent pieces of work to a number of cores; sequentially outside its context, or with one core.

    Results do not depend on the number of cores.
    """

    def __init__(self, count: int) -> None:
        """count: number of cores."""
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
    """A search has reached its time limit; the fits made so far are stored."""

    def __init__(self, seconds: float, so_far: str = "") -> None:
        """seconds: the limit. so_far: the result until then, in words."""
        self.so_far = so_far
        tail = f"; so far, {so_far}" if so_far else ""
        super().__init__(
            f"the search was stopped after {seconds:g} s of processor time without a decision: "
            f"diagnose again to continue it, or give it more time (--seconds){tail}"
        )


class Watch:
    """A Progress that forwards its calls, and at every look repeats the last one or raises SearchStoppedError.

    The limit is in processor time of all threads, so that a busy machine does not end a search earlier.
    """

    def __init__(self, progress: Progress = no_progress, seconds: float = math.inf, each: Each = map) -> None:
        """seconds: limit for the search from now on. each: map function for independent pieces of work."""
        self._progress, self._seconds, self._began = progress, seconds, process_time()
        self._last: tuple[str, float] | None = None
        self.each = each
        self.so_far = ""  # sentence on the results up to now, if a search is stopped
        self.explained = False  # whether one of these results explains the runs

    def __call__(self, stage: str, done: float, total: float = 1.0, /) -> None:
        """Record the progress of the work."""
        self._last = (stage, done / total)
        self._progress(*self._last)

    def look(self) -> None:
        """Raise SearchStoppedError if the time limit is reached, or what the progress raises."""
        limit_s = self._seconds * (EXPLAINED_TIMES if self.explained else 1.0)
        if process_time() - self._began >= limit_s:  # a clock may stand still between two looks
            raise SearchStoppedError(limit_s, self.so_far)
        if self._last is not None:
            self._progress(*self._last)
