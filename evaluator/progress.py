"""Progress reports of long work, and their cancellation by the caller."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class Cancelled(BaseException):
    """Raised by a Progress that wants the work to end.

    Cancelled work leaves complete files only, and its finished parts are reused when it is started again.
    It is not an Exception, like KeyboardInterrupt: code that handles errors of single runs must not catch it.
    """


class Progress(Protocol):
    """Called as work advances, in the thread that requested it, at least every second while it waits.

    stage: current work, in a word or two; done of total: finished part, in any unit; total 0: unknown.
    May raise Cancelled (or KeyboardInterrupt) to end the work.
    """

    def __call__(self, stage: str, done: float, total: float = 1.0, /) -> None:
        """Report the progress of a stage."""


def no_progress(stage: str, done: float, total: float = 1.0, /) -> None:
    """Ignore progress reports."""
    del stage, done, total


def counting(progress: Progress, stage: str) -> Callable[[int, int], None]:
    """A function of (done, total) that reports one stage, for packages without Progress."""

    def report(done: int, total: int) -> None:
        progress(stage, done, total)

    return report


def part_way(progress: Progress, stage: str, done: Callable[[], float], total: float) -> Progress:
    """Report the progress of one of many items: its share is added to the finished items."""

    def report(item: str, share: float, of: float = 1.0, /) -> None:
        del item
        progress(stage, done() + (min(share / of, 1.0) if of else 0.0), total)

    return report
