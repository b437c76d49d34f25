"""Times of captured frames: time stamps of the camera if there are any, otherwise times of arrival."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from evaluator.robust import robust_sigma

MICRO = 1_000_000  # ticks of a second in files that are written: a thousandth of a frame at 1000 frames/s


@dataclass(frozen=True)
class ClockReport:
    """Quality of the time stamps of a recording.

    source: "camera" if the driver or the stream stamps every frame, otherwise "arrival". interval_s: median; NaN below
    two frames. jitter_s: robust standard deviation of arrivals relative to the camera's times, or, without these,
    relative to equal intervals, which is then the error of every time. dropped: frames missing in gaps.
    """

    frames: int
    source: str
    interval_s: float
    jitter_s: float
    dropped: int


@dataclass
class CaptureClock:
    """Collects the times of frames, and converts them to the time of the recording, s from the first frame."""

    stamped: bool | None = None  # whether frames have time stamps; known after the first
    times_s: list[float] = field(default_factory=list)
    arrivals_s: list[float] = field(default_factory=list)

    def add(self, stamp_s: float | None, arrived_s: float) -> int | None:
        """Add a frame; return its time in microseconds, or None if it is not after the one before.

        stamp_s: time stamp of the camera, on any clock, or None. arrived_s: time of the computer.
        """
        if self.stamped is None:
            self.stamped = stamp_s is not None
        time = stamp_s if self.stamped else arrived_s
        if time is None or (self.times_s and time <= self.times_s[-1]):
            return None
        self.times_s.append(time)
        self.arrivals_s.append(arrived_s)
        return round((time - self.times_s[0]) * MICRO)

    def report(self) -> ClockReport:
        """Quality of the times so far."""
        times, arrivals = np.array(self.times_s), np.array(self.arrivals_s)
        source = "camera" if self.stamped else "arrival"
        if len(times) < 2:
            return ClockReport(len(times), source, float("nan"), float("nan"), 0)
        steps = np.diff(times)
        interval = float(np.median(steps))
        missing = np.maximum(np.rint(steps / interval) - 1, 0)
        even = np.concatenate([[0.0], np.cumsum((missing + 1) * interval)])
        delays = arrivals - times if self.stamped else times - times[0] - even
        jitter = robust_sigma(np.diff(delays)) / np.sqrt(2)  # single frames may be late
        return ClockReport(len(times), source, interval, jitter, int(missing.sum()))

    def in_recording(self, moment_s: float) -> tuple[float, float]:
        """A moment of the computer's clock as a time of the recording, with its standard uncertainty, s.

        Frames arrive late, never early: the shortest delay gives the offset of the clocks, except for the delay common
        to all frames (exposure, read-out, transfer). It is unknown, typically about a frame, which is the uncertainty.
        """
        times, arrivals = np.array(self.times_s), np.array(self.arrivals_s)
        offset = float((arrivals - times).min()) if self.stamped else 0.0
        report = self.report()
        return moment_s - offset - self.times_s[0], float(np.hypot(report.interval_s, report.jitter_s))
