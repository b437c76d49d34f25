"""Runs that start at another time than their file says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import Onset, onset
from evaluator.diagnosis.mistakes.recognised import Correction, Found
from evaluator.diagnosis.mistakes.start.handling import moved_before_start_mm
from evaluator.diagnosis.mistakes.start.rising_command import motors_on, onset_after_start, waited_for_a_threshold
from evaluator.interchange.commands import unsigned_rpm
from evaluator.robust import robust_sigma
from simulator.robot import Robot

LATE_S = 0.1  # more than the error of a start that is determined by counting frames
LATE_SPREADS = 6.0  # times the scatter of the starts in the session
# Time in which small motors follow a command. If the file leaves start_s out, a delay of all runs up to this time is
# left to the diagnosis; a longer one is a forgotten start.
MOTORS_S = 0.3
SLOWEST_S = 1.0  # if the file states start_s: a drive of a metre that follows half of its command after 0.65 s is slow
FEWEST_OF_GROUP = 3  # runs; one or two of the others do not move the median
LATE_SIGMAS = 5.0  # standard errors of the start: for the largest of two dozen runs, with slightly heavy tails


@dataclass(frozen=True)
class _Begun:
    """The onset of the motion of a run; by how much it is later than expected, and the start of its motors, s."""

    run: RunData
    onset: Onset
    later_s: float
    motors_later_s: float  # by more than the onset if the command rises

    @classmethod
    def of(cls, run: RunData, begins: Onset) -> _Begun:
        expected_s = run.start_s + onset_after_start(run, begins, run.start_s)
        return cls(run, begins, begins.time_s - expected_s, motors_on(run, begins) - run.start_s)

    def later_than(self, usual_s: float) -> float:
        """By how much the run starts later than a usual delay, s.

        Not late if it moves softly from its start on, and not early if it rests until its start.
        """
        later_s, softly_s, rests_s = self.later_s - usual_s, self.onset.softly_s, self.onset.rests_until_s
        if later_s > 0 and softly_s is not None:
            return min(later_s, max(softly_s - self.run.start_s, 0.0))
        if later_s < 0 and rests_s is not None:
            return max(later_s, min(rests_s - self.run.start_s, 0.0))
        return later_s

    @property
    def rpm(self) -> float:
        """Command of the faster wheel at the onset, from which its motor turns at the latest."""
        at_s = max(self.run.start_s, self.onset.time_s)
        return unsigned_rpm(*(float(rpm) for rpm in self.run.run_command.command.at(at_s)))[1]


def late_starts(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs that start at another time than stated, relative to the other runs, or outside of the recording.

    If start_s is not given, the start is compared with its default 0, unless motors that follow late may be the cause.
    A run that has waited for the command from which its motors turn is not late: that is an effect.
    """
    del robots
    found: list[Found] = []
    begun: list[_Begun] = []
    for run in data:
        first, last = float(run.time_s[0]), float(run.time_s[-1])
        if run.start_s >= last:
            seen = f"start_s = {run.start_s:g} s lies after the end of the recording ({first:.2f} to {last:.2f} s)"
            found.append(Found(run.id, "late-start", seen, "correct start_s in experiment.toml"))
            continue
        from_rest = run.run_command.starts_at_rest and bool(run.left_rpm or run.right_rpm)
        begins = onset(run) if from_rest else None
        if begins is not None:
            begun.append(_Begun.of(run, begins))
        elif from_rest and (moved_mm := moved_before_start_mm(run)):
            seen = f"moves by {moved_mm:.2g} mm before its motors are switched on at start_s = {run.start_s:g} s"
            remedy = "correct start_s, or cut the frames in which a hand moves the robot"
            found.append(Found(run.id, "late-start", seen, remedy, ("pushed",)))
    return found + _unlike_the_others(begun)


def _unlike_the_others(begun: Sequence[_Begun]) -> list[Found]:
    """Runs whose motion begins earlier or later than that of the others."""
    # a delay common to all runs, of the motors or of the clock, is left to the diagnosis if no motor is slower
    usual, spread = _usual([item.later_s for item in begun]) if len(begun) > 2 else (0.0, 0.0)
    off: list[tuple[_Begun, float, bool]] = []  # by how much, s, and whether start_s may have been forgotten
    in_time: list[_Begun] = []
    for item in begun:
        no_lag = usual > (SLOWEST_S if item.run.start_is_stated else MOTORS_S)
        later_s = item.later_than(0.0 if no_lag else usual)
        least_s = max(LATE_S, LATE_SIGMAS * item.onset.sigma_s, 0.0 if no_lag else LATE_SPREADS * spread)
        if abs(later_s) > least_s:
            off.append((item, later_s, no_lag and not item.run.start_is_stated))
        else:
            in_time.append(item)
    least_rpm = min((item.rpm for item in in_time), default=np.inf)
    return [
        _told(item.run, later_s + item.motors_later_s - item.later_s, forgotten=forgotten)
        for item, later_s, forgotten in off
        if later_s < 0 or not waited_for_a_threshold(item.run, item.onset.time_s, item.motors_later_s, least_rpm)
    ]


def _told(run: RunData, later_s: float, *, forgotten: bool) -> Found:
    """The finding that the motors of a run start later than stated; forgotten: start_s may be missing in the file."""
    at_s = run.start_s + later_s
    words = f"{abs(later_s):.2f} s {'later' if later_s > 0 else 'earlier'} than start_s says"
    remedy = f"set start_s = {at_s:.2f}"
    if forgotten:
        words = f"and start_s, which is not given, counts as {run.start_s:g}"
        remedy += f", or write start_s = {run.start_s:g} if the motors were switched on then"
    seen, correction = f"motion begins at about {at_s:.2f} s, {words}", Correction(later_s=later_s)
    return Found(run.id, "late-start", seen, remedy, correction=correction)


def _usual(values: Sequence[float]) -> tuple[float, float]:
    """Median of some values, and their spread about it (median absolute deviation, as a standard deviation).

    Of two groups, each of FEWEST_OF_GROUP or more, that lie farther apart than a late start from its others, only those
    nearer to zero: the file says when half of the runs start, and not when the other half does.
    """
    ordered = np.sort(values)
    gaps = np.diff(ordered)
    widest = int(np.argmax(gaps))
    groups = ordered[: widest + 1], ordered[widest + 1 :]
    within = max(robust_sigma(group) for group in groups)
    if min(map(len, groups)) >= FEWEST_OF_GROUP and gaps[widest] > max(LATE_S, LATE_SPREADS * within):
        ordered = min(groups, key=lambda group: abs(float(np.median(group))))
    return float(np.median(ordered)), robust_sigma(ordered)
