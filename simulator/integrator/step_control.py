"""One step with control of its error: order 4 where friction is smooth, implicit Euler where a wheel sticks."""

from __future__ import annotations

import math
from typing import Any

from simulator.compilation import compiled
from simulator.integrator.implicit_euler import euler_pair
from simulator.integrator.rosenbrock import attempt, invert3

LEVER_MM = 10.0  # an error of heading counts as the displacement it makes at this distance
MOST_TRIES = 4  # rejections in a row mean that a wheel sticks or turns over
SHORTEST_STEP_S = 2e-6  # a fraction of the shortest relaxation of rolling wheels
USUAL_TOLERANCE_MM = 1e-6  # for these two; below it, steps of order 4 shrink with its fourth root
MOVING_RESTS = 100.0  # so many rest speeds are beyond the rounding of rest
# Within it, the smallest part of the velocity may decide which of two turns a robot leaves rest for: each part is
# followed to a share of itself, down to a share of the rest speed, by steps as short as that takes.
DECIDING_SHARE, DECIDING_RESTS, MOST_RESTING_TRIES = 1e-2, 1e-8, 60
FINEST = 1e-3  # of the errors of the velocity at the usual tolerance; below, rounding within rest is all that counts
# In the end a velocity error may move the robot by so many tolerances: rolling wheels forget within some steps anyway.
REMEMBERED, LONGEST_MEMORY_S = 30.0, 1.0
LONGEST_TURN_RAD = 1.0  # within one step, where the series for the twist is exact to 1e-9


@compiled()
def shrinking(tolerance: float) -> float:
    """Share of the usual shortest steps that a tolerance below the usual one asks for."""
    return float(min(1.0, (tolerance / USUAL_TOLERANCE_MM) ** 0.25))


@compiled()
def is_resting(state: Any, model: Any) -> bool:
    """Whether the velocity of a state (6: twist, velocity) is within the rounding of rest."""
    return bool(max(abs(state[3]), abs(state[4]), abs(state[5])) < MOVING_RESTS * model.rest_speed)


@compiled()
def error_norm(step: float, tolerance: float, model: Any, work: Any) -> float:
    """Error of a step over the tolerance, as displacement in mm: of the pose, and of the velocity over the step."""
    norm, size, y, end = 0.0, 0.0, work.y, work.end
    for item in range(3):
        size = max(size, abs(y[3 + item]), abs(end[0, 3 + item]))
    # A velocity error that moves nothing yet must still not spoil the relaxation, nor how a wheel breaks loose.
    spoiling = (0.02 * size + 0.1 * model.rest_speed) * min(1.0, max(tolerance / USUAL_TOLERANCE_MM, FINEST))
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
    """What an error of the velocity moves the robot by in the end, mm, until wheel forces have made up for it.

    Rolling wheels do so within milliseconds. Wheels that slide fast do not: their friction hardly depends on velocity.
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
def smooth_step(
    time: float, step: float, tolerance: float, planned: bool, model: Any, work: Any
) -> tuple[float, float]:
    """Take a Rosenbrock step: the size accepted, 0 where friction bends too sharply, and the size wanted next."""
    resting = is_resting(work.y, model)
    for _ in range(MOST_RESTING_TRIES if resting else MOST_TRIES):
        taken = attempt(time, step, model, work)
        if planned and taken:
            return step, step
        norm = error_norm(step, tolerance, model, work) if taken else 1e6
        factor = min(6.0, max(0.15, 0.9 * (norm + 1e-12) ** -0.25))
        if norm <= 1.0:
            return step, step * factor
        step *= min(factor, 0.7)
        if step < SHORTEST_STEP_S * shrinking(tolerance) and not resting:
            break
    return 0.0, 0.0


@compiled()
def sticking_step(
    time: float, step: float, tolerance: float, planned: bool, model: Any, work: Any
) -> tuple[float, float]:
    """Take a pair of implicit Euler steps: the size accepted, 0 where none was, and the size wanted next."""
    for _ in range(60):
        taken = euler_pair(time, step, model, work)
        if planned and taken:
            return step, step
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
    planned: bool,
    sticking: bool,
    model: Any,
    work: Any,
) -> tuple[float, float, bool]:
    """Take a step of either kind: the size accepted, 0 where none was; the size wanted next; whether a wheel sticks."""
    if not sticking:
        tried, wanted = smooth_step(time, min(step, remaining), tolerance, planned, model, work)
        if tried > 0.0:
            return tried, wanted, False
    if not planned:
        step = max(step, SHORTEST_STEP_S * shrinking(tolerance))
    tried, wanted = sticking_step(time, min(step, remaining), tolerance, planned, model, work)
    work.stages[:] = 0.0  # outputs within the step are on the straight line
    return tried, wanted, True
