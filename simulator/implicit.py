"""Implicit Euler steps for moments in which a wheel sticks or its sliding turns over.

There friction bends within a few nanometres a second, and a method that trusts one linearization must creep. Implicit
Euler with Newton's method to the end is the classical time stepping of dry friction: two half steps are kept, and
compared with one whole step.
"""

from __future__ import annotations

import math
from typing import Any

from simulator.compiled import compiled
from simulator.rosenbrock import VELOCITY_STEP, invert3, rates

MOST_ITERATIONS = 60
SMALLEST_SHARE = 1e-9  # of a Newton step; friction bends on 1e-6 of the velocity


@compiled()
def excess(
    pose: Any, segment: Any, time: float, step: float, start: Any, guess: Any, model: Any, out: Any, scratch: Any
) -> float:
    """What the velocity of guess lacks to be an implicit Euler step from start, into out (3); returns its size."""
    for item in range(3):
        guess[item] = start[item] + 0.5 * step * (start[3 + item] + guess[3 + item])
    rates(pose, segment, time + step, guess, model, scratch)
    square = 0.0
    for item in range(3):
        out[item] = guess[3 + item] - start[3 + item] - step * scratch[3 + item]
        lever = 2.0 if item == 2 else 1.0
        square += (lever * out[item]) ** 2
    return math.sqrt(square)


@compiled()
def euler(
    pose: Any, segment: Any, time: float, step: float, start: Any, model: Any, work: Any, solver: Any, out: Any
) -> bool:
    """One implicit Euler step from start (6: twist, velocity) into out (6); False where Newton's method fails."""
    residual, trial, scratch, shifted, further = work[10], work[11], work[12], work[13], work[14]
    out[:] = start
    size = excess(pose, segment, time, step, start, out, model, residual, scratch)
    scale = 1e-12 * (math.sqrt(start[3] ** 2 + start[4] ** 2 + 4 * start[5] ** 2) + 1e-3)
    for _ in range(MOST_ITERATIONS):
        if size <= scale:
            return True
        for column in range(3):
            shifted[:] = out
            shifted[3 + column] += VELOCITY_STEP
            excess(pose, segment, time, step, start, shifted, model, trial, scratch)
            for row in range(3):
                solver[2, row, column] = (trial[row] - residual[row]) / (shifted[3 + column] - out[3 + column])
        if not invert3(solver[2], solver[0]):
            return False
        share, found = 1.0, False
        while not found and share > SMALLEST_SHARE:
            further[:] = out
            for row in range(3):
                for column in range(3):
                    further[3 + row] -= share * solver[0, row, column] * residual[column]
            smaller = excess(pose, segment, time, step, start, further, model, trial, scratch)
            found = smaller < size
            if not found:
                share *= 0.4
        if not found:
            return size <= 1e5 * scale
        out[:] = further
        residual[:] = trial
        size = smaller
    return size <= 1e5 * scale


@compiled()
def euler_pair(
    pose: Any, segment: Any, time: float, step: float, y: Any, model: Any, work: Any, solver: Any, end: Any
) -> bool:
    """Two half steps from y; end: (2, 6) the new state and how far one whole step differs. False where one fails."""
    whole, half = work[15], work[16]
    if not euler(pose, segment, time, step, y, model, work, solver, whole):
        return False
    if not euler(pose, segment, time, 0.5 * step, y, model, work, solver, half):
        return False
    if not euler(pose, segment, time + 0.5 * step, 0.5 * step, half, model, work, solver, end[0]):
        return False
    for item in range(6):
        end[1, item] = end[0, item] - whole[item] if item >= 3 else 0.0
    return True
