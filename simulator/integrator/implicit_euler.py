"""Implicit Euler steps for instants at which a wheel sticks or its sliding reverses.

There friction changes within a few nm/s of sliding speed, and a method with a single linearization needs tiny steps.
Implicit Euler with converged Newton iteration is the classical time stepping of dry friction; two half steps are used
and compared with one whole step. Started from a sliding wheel, Newton's method can overshoot the transition of friction
at rest; started from a wheel at rest it does not. It therefore starts from the current motion, then from that motion
with one wheel stopped.
"""

from __future__ import annotations

import math
from typing import Any

from simulator.compilation import compiled, counter
from simulator.dynamics.equations import slopes
from simulator.dynamics.motors import drive_at
from simulator.integrator.rosenbrock import invert3, place_after
from simulator.integrator.workspace import copy

MOST_QUICK, MOST_PATIENT = 10, 60  # iterations
SMALLEST_QUICK, SMALLEST_PATIENT = 0.2, 1e-9  # share of a Newton step; friction saturates within 1e-6 of the velocity
LEVER_MM = 2.0  # half the track of the paper's robot: a yaw rate counts as the speed at its wheels


@compiled()
def excess(time: float, step: float, start: Any, guess: Any, model: Any, work: Any, out: Any) -> float:
    """Write the residual of an implicit Euler step from start to guess to out (3), as velocity; returns its norm.

    The derivative of the accelerations by velocity is stored in work.bent.
    """
    work.tried += 1.0
    for item in range(3):
        guess[item] = start[item] + 0.5 * step * (start[3 + item] + guess[3 + item])
    place = place_after(work.pose, guess[0], guess[1], guess[2], time + step, model)
    drive = drive_at(work.segment, time + step, model.lag)
    slopes(guess[3], guess[4], guess[5], drive, place, model.rest_speed, model, work.contacts, work.bent)
    for item in range(3):
        out[item] = guess[3 + item] - start[3 + item] - step * work.bent[0, item]
    return math.sqrt(out[0] ** 2 + out[1] ** 2 + (LEVER_MM * out[2]) ** 2)


@compiled()
def newton_change(step: float, residual: Any, work: Any, change: Any) -> bool:
    """Write Newton's change of the velocity to change (3); False if the matrix is singular."""
    for row in range(3):
        for column in range(3):
            work.block[row, column] = (1.0 if row == column else 0.0) - step * work.bent[1 + row, column]
    if not invert3(work.block[:3], work.inverse[:3]):
        return False
    inverse = work.inverse
    for row in range(3):
        change[row] = -(inverse[row, 0] * residual[0] + inverse[row, 1] * residual[1] + inverse[row, 2] * residual[2])
    return True


@compiled()
def descend(time: float, step: float, start: Any, patient: bool, model: Any, work: Any, out: Any) -> bool:
    """Newton's method with backtracking from the velocity in out; False where it fails."""
    residual, trial, further, change = work.spare[0], work.spare[1], work.spare[2], work.spare[3]
    goal = 1e-12 * (math.sqrt(start[3] ** 2 + start[4] ** 2 + (LEVER_MM * start[5]) ** 2) + 1e-3)
    least = SMALLEST_PATIENT if patient else SMALLEST_QUICK
    size = excess(time, step, start, out, model, work, residual)
    for _ in range(MOST_PATIENT if patient else MOST_QUICK):
        if not newton_change(step, residual, work, change):
            return False
        length = math.sqrt(change[0] ** 2 + change[1] ** 2 + (LEVER_MM * change[2]) ** 2)
        share, smaller = 1.0, math.inf
        while not smaller < size and share > least:
            for item in range(3):
                further[3 + item] = out[3 + item] + share * change[item]
            smaller = excess(time, step, start, further, model, work, trial)
            share *= 0.4
        if not smaller < size:  # rounding ends the descent
            return length <= 1e4 * goal
        copy(further, out)
        copy(trial, residual)
        size = smaller
        if share == 0.4 and length <= goal:
            return True
    return patient and size <= 1e5 * goal


@compiled()
def stop_wheel(wheel: int, start: Any, model: Any, out: Any) -> None:
    """Write to out the velocity of start after an impulse on one wheel that stops this wheel."""
    x, y = model.wheel_x[wheel], model.wheel_y[wheel]
    spin = model.mass * (y * start[3] - x * start[4]) + model.inertia * start[5]
    r = spin / (model.mass * (x * x + y * y) + model.inertia)
    out[3], out[4], out[5] = r * y, -r * x, r


@compiled()
def slowest_wheel(but: int, start: Any, model: Any) -> int:
    """The wheel whose centre moves slowest, except wheel `but`."""
    least, chosen = math.inf, counter(-1)
    for wheel in range(model.wheels):
        u, v = start[3] - start[5] * model.wheel_y[wheel], start[4] + start[5] * model.wheel_x[wheel]
        if wheel != but and model.grip_x[wheel] > 0.0 and u * u + v * v < least:
            least, chosen = u * u + v * v, wheel
    return chosen


@compiled()
def euler(time: float, step: float, start: Any, model: Any, work: Any, out: Any) -> bool:
    """One implicit Euler step from start (6: twist, velocity) to out (6), which holds the first guess.

    False if Newton's method fails from every initial value.
    """
    tried = counter(-1)
    for attempt in range(5):
        if 1 <= attempt <= 2:  # the slowest wheels are the ones that stop
            tried = slowest_wheel(tried, start, model)
            stop_wheel(tried, start, model, out)
        elif attempt == 3:
            out[3], out[4], out[5] = 0.0, 0.0, 0.0
        elif attempt == 4:
            copy(start, out)
        if descend(time, step, start, attempt == 4, model, work, out):
            return True
    return False


@compiled()
def euler_pair(time: float, step: float, model: Any, work: Any) -> bool:
    """Two half steps from work.y to work.end[0], and their difference from one step in work.end[1]; False if failed."""
    whole, half, start, end = work.spare[4], work.spare[5], work.spare[6], work.end
    copy(work.y, start)
    copy(start, whole)
    if not euler(time, step, start, model, work, whole):
        return False
    copy(whole, half)
    if not euler(time, 0.5 * step, start, model, work, half):
        return False
    copy(half, end[0])
    if not euler(time + 0.5 * step, 0.5 * step, half, model, work, end[0]):
        return False
    for item in range(6):
        end[1, item] = end[0, item] - whole[item] if item >= 3 else 0.0
    return True
