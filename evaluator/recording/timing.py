"""Frame rate, dropped frames and repeated frames from the presentation times of a recording."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from heapq import heappop, heappush
from itertools import chain, pairwise, repeat
from typing import Any

from evaluator.wording import counted, verb


@dataclass(frozen=True)
class TimingReport:
    """Summary of the times of a recording.

    frames: frames decoded. first, last: presentation times, s. interval: the commonest time between frames, s
    (None below two frames). dropped: (index of the frame after the gap, number missing). duplicates: indices of
    frames equal to the one before. variable: the intervals differ by more than the clock's rounding even outside
    gaps. notes: sentences on what is unusual of the times, for people; which repetitions matter shows in the marks.
    """

    frames: int
    first: Fraction | None
    last: Fraction | None
    interval: Fraction | None
    dropped: tuple[tuple[int, int], ...]
    duplicates: tuple[int, ...]
    variable: bool
    notes: tuple[str, ...]

    @property
    def rate_hz(self) -> float:
        """Frames a second, from the commonest interval; NaN below two frames."""
        return float("nan") if not self.interval else float(1 / self.interval)


def clock_runs(packets: Sequence[Any]) -> bool:
    """Whether the times of the first packets of a recording, if any, are not all equal."""
    times = [packet.pts for packet in packets if packet.pts is not None]
    return len(times) < 2 or len(set(times)) > 1


def in_order(timed: Iterable[tuple[Any, int | None]], most: int = 1) -> Iterator[tuple[Any, int | None]]:
    """Frames with their times, which are exchanged among neighbours so that they rise.

    Decoders return frames in the order of presentation. If a container has no presentation times (AVI) and the codec
    has B-frames, the substituted times are those of decoding. most: number of frames by which a time may be too early.
    """
    held, times = deque[tuple[Any, bool]](), list[int]()
    for image, ticks in chain(timed, repeat((None, None), most)):
        held.append((image, ticks is not None))
        if ticks is not None:
            heappush(times, ticks)
        if len(held) > most:
            earliest, has_time = held.popleft()
            yield earliest, heappop(times) if has_time else None


def summarise(ticks: Sequence[int], tick: Fraction, duplicates: Sequence[int], notes: Sequence[str]) -> TimingReport:
    """Find rate, gaps and repetitions.

    ticks: presentation times of the frames in order, in ticks of the clock. tick: s; intervals that differ
    by no more than two ticks count as equal, because each of the two times is rounded to a tick.
    """
    steps = [after - before for before, after in pairwise(ticks)]
    interval, variable, dropped = None, False, []
    if steps:
        common = Counter(steps).most_common(1)[0][0]
        regular = [step for step in steps if abs(step - common) <= (2 if common > 8 else 0)]
        interval = Fraction(sum(regular), len(regular))
        for index, step in enumerate(steps, start=1):
            if step >= Fraction(3, 2) * interval:
                dropped.append((index, max(1, round(step / interval) - 1)))
        # A gap is a whole number of intervals; other intervals mean that the frame rate varies.
        odd = [step for step in steps if abs(step - max(1, round(step / interval)) * interval) > 2]
        variable = len(odd) > len(steps) // 20
    said = list(notes)
    if variable:
        said.append("the frame rate varies; the time stamp of each frame is used")
    elif dropped:
        missing = sum(count for _, count in dropped)
        said.append(
            f"{counted(missing, 'frame')} {verb(missing, 'is', 'are')} missing in {counted(len(dropped), 'gap')},"
            f" the first before frame {dropped[0][0]}"
        )
    return TimingReport(
        frames=len(ticks),
        first=ticks[0] * tick if ticks else None,
        last=ticks[-1] * tick if ticks else None,
        interval=interval * tick if interval else None,
        dropped=() if variable else tuple(dropped),
        duplicates=tuple(duplicates),
        variable=variable,
        notes=tuple(said),
    )
