"""Between the steps of its fits a diagnosis looks whether anyone wants it to end, and whether its time is over."""

from __future__ import annotations

import math
from time import thread_time

from evaluator.progress import Progress, no_progress

# Seconds of one core after which a search ends. Of the experiments of the second world the slowest took 114 s on a busy
# machine: one that goes on for half as long again is lost.
USUAL_SECONDS = 180.0


class SearchStoppedError(Exception):
    """A search has used up its time; the fits made so far are kept."""

    def __init__(self, seconds: float) -> None:
        """seconds: what it was given."""
        super().__init__(
            f"the search was stopped after {seconds:g} s of computing, before it could tell what explains the runs: "
            "diagnose again to go on from here, or give it more time (--seconds)"
        )


class Watch:
    """A Progress that passes on what it is told, and says it again, or raises SearchStoppedError, at every look.

    Time is that of the processor in this thread: a busy machine does not make a search end earlier.
    """

    def __init__(self, progress: Progress = no_progress, seconds: float = math.inf) -> None:
        """seconds: that the search may take from now on."""
        self._progress, self._seconds, self._began = progress, seconds, thread_time()
        self._last: tuple[str, float] | None = None

    def __call__(self, stage: str, done: float, total: float = 1.0, /) -> None:
        """Take note of how far the work is."""
        self._last = (stage, done / total)
        self._progress(*self._last)

    def look(self) -> None:
        """Whether to go on: raises SearchStoppedError where the time is over, and what the progress raises."""
        if thread_time() - self._began > self._seconds:
            raise SearchStoppedError(self._seconds)
        if self._last is not None:
            self._progress(*self._last)
