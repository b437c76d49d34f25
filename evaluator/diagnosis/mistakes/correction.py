"""Correction of a mistake in the files of a run: command, start, marks or times."""

from __future__ import annotations

from dataclasses import dataclass

from evaluator.interchange.commands import RunCommand


@dataclass(frozen=True)
class Correction:
    """Changes to the files of a run; fields that are not given change nothing.

    command: left and right rpm instead of its command; log: instead of its log, in the time of the recording. later_s:
    added to start_s. seconds_times: factor of its times. marks_exchanged: the first mark is the second. marks_times:
    factors of the x and y of its marks.
    """

    command: tuple[float, float] | None = None
    log: RunCommand | None = None
    later_s: float = 0.0
    seconds_times: float = 1.0
    marks_exchanged: bool = False
    marks_times: tuple[float, float] = (1.0, 1.0)
