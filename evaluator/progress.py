"""Progress reports of long work, and their cancellation by the caller."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class Cancelled(BaseException):
    """Raised by a Progress that wants the work to end.

    Work that is cancelled leaves whole files only, and what was finished is reused when it is started again.
    It is no Exception, like KeyboardInterrupt: whoever answers for the errors of one run must not answer for this.
    """


class Progress(Protocol):
    """Called as work advances, in the thread that asked for the work, at least every second while it waits for others.

    stage: what is being done, in a word or two; done of total: how much of it, in any unit; total 0: not known yet.
    May raise Cancelled (or KeyboardInterrupt) to end the work.
    """

    def __call__(self, stage: str, done: float, total: float = 1.0, /) -> None:
        """Take note of how far the work is."""


def no_progress(stage: str, done: float, total: float = 1.0, /) -> None:
    """Ignore progress reports."""
    del stage, done, total


def counting(progress: Progress, stage: str) -> Callable[[int, int], None]:
    """A plain function of (done, total) that reports one stage, for packages that know no Progress."""

    def report(done: int, total: int) -> None:
        progress(stage, done, total)

    return report


def part_way(progress: Progress, stage: str, done: Callable[[], float], total: float) -> Progress:
    """Report the work on one item of many: its share is added to the items that are done."""

    def report(item: str, share: float, of: float = 1.0, /) -> None:
        del item
        progress(stage, done() + (min(share / of, 1.0) if of else 0.0), total)

    return report
