"""One step with error control: order 4 where friction is smooth, implicit Euler where a wheel sticks."""

from __future__ import annotations

import math
from typing import Any

from simulator.compilation import compiled
from simulator.integrator.implicit_euler import euler_pair
from simulator.integrator.rosenbrock import attempt, invert3

LEVER_MM = 10.0  # a heading error counts as the displacement that it causes at this distance
MOST_TRIES = 4  # more rejections in a row mean that a wheel sticks or reverses its sliding
SHORTEST_STEP_S = 2e-6  # a fraction of the shortest relaxation of rolling wheels
USUAL_TOLERANCE_MM = 1e-6  # for which both were chosen; below it, steps of order 4 shrink with its fourth root
MOVING_RESTS = 100.0  # rest speeds from which on the smoothing at rest no longer matters
# Below, the smallest component of the velocity may decide which of two turns a robot takes from rest. Each component is
# computed to DECIDING_SHARE of itself or DECIDING_RESTS of the rest speed, with steps as short as that needs.
DECIDING_SHARE, DECIDING_RESTS, MOST_RESTING_TRIES = 1e-2, 1e-8, 60
FINEST = 1e-3  # least velocity error over that at the usual tolerance; below it rounding near rest dominates
# Greatest error of the velocity as a share of it. When motors start slowly, one wheel sticks at first, and the motion
# becomes unstable before it lets go; until then small errors grow. With 2 % the place after the start of a turn on the
# spot was off by up to 64 µm, another amount for every change of the friction by 1e-4; now by up to 12 µm.
SPOILING_SHARE = 1e-3
# A velocity error may finally displace the robot by REMEMBERED tolerances; rolling wheels correct it within some steps.
REMEMBERED, LONGEST_MEMORY_S = 30.0, 1.0
LONGEST_TURN_RAD = 1.0  # within one step, where the series for the twist is exact to 1e-9


@compiled()
def shrinking(tolerance: float) -> float:
    """Factor on the usual shortest steps for a tolerance below the usual one."""
    return float(min(1.0, (tolerance / USUAL_TOLERANCE_MM) ** 0.25))


@compiled()
def is_resting(state: Any, model: Any) -> bool:
    """Whether the velocity of a state (6: twist, velocity) is within the smoothing at rest."""
    return bool(max(abs(state[3]), abs(state[4]), abs(state[5])) < MOVING_RESTS * model.rest_speed)


@compiled()
def error_norm(step: float, tolerance: float, model: Any, work: Any) -> float:
    """Error of a step over the tolerance: of the pose, and of the velocity times the step, as displacements in mm."""
    norm, size, y, end = 0.0, 0.0, work.y, work.end
    for item in range(3):
        size = max(size, abs(y[3 + item]), abs(end[0, 3 + item]))
    # A velocity error that has not moved the robot yet must not disturb the relaxation, or how a wheel begins to slide.
    spoiling = (SPOILING_SHARE * size + 0.1 * model.rest_speed) * min(1.0, max(tolerance / USUAL_TOLERANCE_MM, FINEST))
    resting = is_resting(y, model) and is_resting(end[0], model)
    for item in range(3):
        lever = LEVER_MM if item == 2 else 1.0
        displaced = lever * max(abs(end[1, item]), step * abs(end[1, 3 + item])) / tolerance
        allowed = spoiling
        if resting:
            own = max(abs(y[3 + item]), abs(end[0, 3 + item]))
            allowed = min(allowed, DECIDING_SHARE * own + DECIDING_RESTS * model.rest_speed)
        norm = max(norm, displaced, abs(end[1, 3 + item]) / allowed)
    norm = max(norm, _remembered(end[1], work) / (REMEMBERED * tolerance))
    return float(max(norm, abs(end[0, 2]) / LONGEST_TURN_RAD))


@compiled()
def _remembered(error: Any, work: Any) -> float:
    """Displacement, mm, that an error of the velocity finally causes, until wheel forces have corrected it.

    Rolling wheels correct it within milliseconds; wheels that slide fast do not, since their friction hardly depends on
    velocity.
    """
    linear, inverse, largest = work.linear, work.inverses[0], 0.0
    regular = invert3(linear[1:4], inverse)
    for row in range(3):
        moved = math.inf
        if regular:
            moved = abs(inverse[row, 0] * error[3] + inverse[row, 1] * error[4] + inverse[row, 2] * error[5])
        moved = min(moved, LONGEST_MEMORY_S * max(abs(error[3]), abs(error[4]), LEVER_MM * abs(error[5])))
        largest = max(largest, (LEVER_MM if row == 2 else 1.0) * moved)
    return largest


@compiled()
def first_step(linear: Any, tolerance: float) -> float:
    """A step over which the acceleration, or its growth, moves the robot by a hundred tolerances."""
    rate = math.sqrt(linear[0, 0] ** 2 + linear[0, 1] ** 2 + (LEVER_MM * linear[0, 2]) ** 2)
    growth = math.sqrt(linear[7, 0] ** 2 + linear[7, 1] ** 2 + (LEVER_MM * linear[7, 2]) ** 2)
    moving = math.sqrt(200.0 * tolerance / (rate + 1e-30))
    starting = (600.0 * tolerance / (growth + 1e-30)) ** (1 / 3)
    return float(min(moving, starting))


@compiled()
def smooth_step(time: float, step: float, tolerance: float, model: Any, work: Any) -> tuple[float, float]:
    """Take a Rosenbrock step; returns its length, 0 where friction changes too abruptly, and the next length to try."""
    resting = is_resting(work.y, model)
    for _ in range(MOST_RESTING_TRIES if resting else MOST_TRIES):
        taken = attempt(time, step, model, work)
        norm = error_norm(step, tolerance, model, work) if taken else 1e6
        factor = min(6.0, max(0.15, 0.9 * (norm + 1e-12) ** -0.25))
        if norm <= 1.0:
            return step, step * factor
        step *= min(factor, 0.7)
        if step < SHORTEST_STEP_S * shrinking(tolerance) and not resting:
            break
    return 0.0, 0.0


@compiled()
def sticking_step(time: float, step: float, tolerance: float, model: Any, work: Any) -> tuple[float, float]:
    """Take a pair of implicit Euler steps; returns the length, 0 if none was accepted, and the next length to try."""
    for _ in range(60):
        taken = euler_pair(time, step, model, work)
        norm = error_norm(step, tolerance, model, work) if taken else 1e6
        factor = min(4.0, max(0.2, 0.9 * (norm + 1e-12) ** -0.5))
        if norm <= 1.0:
            return step, step * factor
        step *= min(factor, 0.7)
    return 0.0, 0.0


@compiled()
def short_step(
    time: float,
    step: float,
    remaining: float,
    tolerance: float,
    sticking: bool,
    model: Any,
    work: Any,
) -> tuple[float, float]:
    """Take a step of either kind; returns its length (0: none accepted) and the next length to try."""
    if not sticking:
        tried, wanted = smooth_step(time, min(step, remaining), tolerance, model, work)
        if tried > 0.0:
            return tried, wanted
    step = max(step, SHORTEST_STEP_S * shrinking(tolerance))
    tried, wanted = sticking_step(time, min(step, remaining), tolerance, model, work)
    work.stages[:] = 0.0  # outputs within the step are on the straight line
    return tried, wanted
