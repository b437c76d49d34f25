"""Start of the motors of a run whose command rises, as a slow ramp does: before its motion can be seen."""

from __future__ import annotations

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import Onset, robust_line

STEP_S = 0.005  # of the integral of the command: 3 % of a stair of 0.2 s
MOMENTS = 40  # in the span of an onset, at most 0.4 s: twice the frames of a camera of 60 a second
ROUNDS = 12  # each halves the error of the start if the command rises evenly: from 4 s to 1 ms


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
    rpm = np.maximum(*np.abs(run.run_command.command.at(run.start_s + since)))
    way = np.concatenate([[0.0], np.cumsum((rpm[1:] + rpm[:-1]) / 2 * STEP_S)])
    slope, level = robust_line(np.interp(moments, since, way), moments)
    return max(-level / slope, 0.0) if slope > 0 else 0.0


def motors_on(run: RunData, begins: Onset) -> float:
    """Time at which the motors of a run started, s, according to the onset of its motion."""
    start = begins.time_s
    for _ in range(ROUNDS):
        start = begins.time_s - onset_after_start(run, begins, start)
    return start
