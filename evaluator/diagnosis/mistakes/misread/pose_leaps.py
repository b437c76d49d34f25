"""Poses that leap: an odometry that is reset, or a localisation that finds itself elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.candidates.coordinates import is_full_size
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.diagnosis.mistakes.outrun import carries_mm_s
from evaluator.diagnosis.mistakes.recognised import Found
from simulator.robot import Robot

# A step between two poses beyond what the wheels carry is a leap if it is half as far as the robot is wide, and so
# many times the usual step. In 26 logs of three banks the largest steps were 0.1 widths; 0.4 and 1.4 usual steps with
# wrong headings, 0.6 and 5 with poses that slip and arrive late; wrong units make all steps long, none more than twice
# the usual one. An odometry that was reset 0.6 m from its origin leapt by 1.7 widths and 155 usual steps.
OF_WIDTH, OF_USUAL = 0.5, 10.0
AROUND = 5  # poses on either side whose median is elsewhere after a leap, but not after wrong poses
FEWEST = 4 * AROUND


def leaping(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs whose given poses leap, once at most for each run; a pose that is held moves when the next one comes."""
    found = (_leap(run, robot) for run, robot in zip(data, robots, strict=True) if run.from_poses)
    return [item for item in found if item is not None]


def _leap(run: RunData, robot: Robot) -> Found | None:
    """The largest leap of a run."""
    driven = run.run_command.driven
    time_s, middle_mm, _ = midpoint_and_heading(run)
    fresh = np.insert(np.diff(middle_mm, axis=0).any(axis=1), 0, True)[: len(middle_mm)]
    time_s, middle_mm = time_s[fresh], middle_mm[fresh]
    if len(time_s) < FEWEST or not driven:
        return None
    steps_mm, spans_s = np.hypot(*np.diff(middle_mm, axis=0).T), np.diff(time_s)
    beyond_mm = steps_mm - carries_mm_s(driven, robot) * spans_s
    at = AROUND - 1 + int(np.argmax(beyond_mm[AROUND - 1 : 1 - AROUND]))
    least_mm = max(OF_WIDTH * robot.track_mm, OF_USUAL * float(np.median(steps_mm)))
    before, after = (
        np.median(part, axis=0) for part in (middle_mm[at + 1 - AROUND : at + 1], middle_mm[at + 1 : at + 1 + AROUND])
    )
    if beyond_mm[at] <= least_mm or np.hypot(*(after - before)) <= least_mm:
        return None
    mm, unit = (1000.0, "m") if is_full_size(robot) else (1.0, "mm")
    carried_mm = steps_mm[at] - beyond_mm[at]
    seen = (
        f"leaps by {steps_mm[at] / mm:.2g} {unit} from {time_s[at]:.2f} to {time_s[at + 1]:.2f} s, while its wheels "
        f"carry it by {carried_mm / mm:.2g} {unit} at most"
    )
    remedy = "was its odometry reset, or its localisation lost? Give what is before and after as runs of their own"
    return Found(run.id, "pushed", seen, remedy, ("camera-moved",))
