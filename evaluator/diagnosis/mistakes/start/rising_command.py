"""Start of the motors of a run whose command rises, as a slow ramp does: before its motion can be seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import Onset, arm_mm, motion_of, robust_line

STEP_S = 0.005  # of the integral of the command: 3 % of a stair of 0.2 s
MOMENTS = 40  # in the span of an onset, at most 0.4 s: twice the frames of a camera of 60 a second
ROUNDS = 12  # each halves the error of the start if the command rises evenly: from 4 s to 1 ms
# Before and after an onset: more than its error, by noise, by motors that lag, or because one wheel turns before the
# other. In two ramps through a dead band of 14 rpm, 13.0 and 13.9 rpm were commanded so long before.
AROUND_S = 0.1
BEYOND_THRESHOLD = 1.1


def onset_after_start(run: RunData, begins: Onset, start_s: float) -> float:
    """How long after the start of its motors, at start_s, the motion of a run is expected to seem to begin, s.

    An onset is extrapolated from the speed at which motion was seen. While the command rises, the wheels were slower
    before: the line through the way that they are commanded to roll, in the span of the onset, begins late by this
    time. It is 0 for a constant command, and if the span lies before the start.
    """
    if run.log is None:
        return 0.0
    moments = np.linspace(*begins.span_s, MOMENTS) - start_s
    since = np.arange(0.0, max(moments[-1], 0.0) + STEP_S, STEP_S)
    rpm = _faster_rpm(run, run.start_s + since)
    way = np.concatenate([[0.0], np.cumsum((rpm[1:] + rpm[:-1]) / 2 * STEP_S)])
    slope, level = robust_line(np.interp(moments, since, way), moments)
    return max(-level / slope, 0.0) if slope > 0 else 0.0


def motors_on(run: RunData, begins: Onset) -> float:
    """Time at which the motors of a run started, s, according to the onset of its motion."""
    start = begins.time_s
    for _ in range(ROUNDS):
        start = begins.time_s - onset_after_start(run, begins, start)
    return start


def waited_for_a_threshold(run: RunData, begins_s: float, later_s: float, least_rpm: float) -> bool:
    """Whether a run whose motion begins late has waited for a command from which its motors turn.

    A dead band or a static friction is an effect, no wrong start: the robot then follows the log as it is, whereas with
    a wrong start it follows a delayed one. begins_s: onset of the motion. later_s: delay of the motors, if the start is
    wrong. least_rpm: the least command of the faster wheel at which a run begins to move in time. The command must be
    below it until the onset, and be higher afterwards than at first.
    """
    moments = np.array([run.start_s, max(begins_s - AROUND_S, run.start_s), begins_s + AROUND_S])
    at_start, before, after = _faster_rpm(run, moments)
    if at_start >= min(after, least_rpm) or before > BEYOND_THRESHOLD * least_rpm:
        return False
    motion = motion_of(run, (begins_s, float(run.time_s[-1])))
    if motion is None:
        return False
    speed = np.hypot(motion.along, motion.across) + arm_mm(run) * np.abs(motion.yaw)

    def missed(delay_s: float) -> float:
        """Square of the speed that is not proportional to the command with this delay."""
        rpm = _faster_rpm(run, motion.time_s - delay_s)
        return float(np.sum((speed - rpm * float(speed @ rpm) / max(float(rpm @ rpm), 1e-300)) ** 2))

    return missed(0.0) < missed(later_s)


def _faster_rpm(run: RunData, moments_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Command of the faster wheel (n,), rpm without sign, at moments (n,) of the recording."""
    return np.asarray(np.maximum(*np.abs(run.run_command.command.at(moments_s))))
