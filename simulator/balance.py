"""Kernels that find velocities at which all forces balance, and follow them as the command changes.

A balance is a root of the accelerations at constant rpm. Forces that vary with place, heading or time are taken at the
origin of the plate, heading 0, time 0. linear: (4, 3), rows 1 to 3 are the derivative by velocity.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange

from simulator.compiled import compiled
from simulator.dynamics import accelerations
from simulator.motion import DONE, integrate_run
from simulator.rosenbrock import VELOCITY_STEP, invert3
from simulator.stability import is_stable

SETTLING_S = (0.0, 2.0)  # relaxations last milliseconds, slow ones from a near standstill tenths of a second
TOLERANCE_MM = 1e-7


@compiled()
def unbalance(model: Any, left: float, right: float, velocity: Any, out: Any) -> float:
    """Accelerations at a velocity (3) into out (3); returns their size."""
    u, v, r = velocity[0], velocity[1], velocity[2]
    out[0], out[1], out[2] = accelerations(u, v, r, left, right, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, model)
    return float(np.sqrt(out[0] ** 2 + out[1] ** 2 + 4 * out[2] ** 2))


@compiled()
def differentiate(model: Any, left: float, right: float, velocity: Any, residual: Any, linear: Any) -> None:
    """Derivative of the accelerations by velocity into rows 1 to 3 of linear."""
    shifted, changed = velocity.copy(), np.empty(3)
    for column in range(3):
        shifted[column] = velocity[column] + VELOCITY_STEP
        unbalance(model, left, right, shifted, changed)
        step = shifted[column] - velocity[column]
        for row in range(3):
            linear[1 + row, column] = (changed[row] - residual[row]) / step
        shifted[column] = velocity[column]


@compiled()
def newton(model: Any, left: float, right: float, velocity: Any, linear: Any) -> bool:
    """Newton's method with backtracking from the velocity (3) handed in, which becomes the root if True is returned."""
    largest = model.speed[0] * max(abs(left), abs(right), 1e-6)
    inverse, residual, trial, shifted = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    size = unbalance(model, left, right, velocity, residual)
    for _ in range(80):
        differentiate(model, left, right, velocity, residual, linear)
        if not invert3(linear[1:4], inverse):
            return False
        step = -inverse @ residual
        length = np.abs(step).max()
        if length < 1e-12 * largest:
            return True
        share, smaller = 2.0, np.inf
        while not smaller < size and share > 1e-6:
            share *= 0.5
            shifted[:] = velocity + share * step
            smaller = unbalance(model, left, right, shifted, trial)
        if not smaller < size:  # rounding ends the descent
            return bool(length < 1e-9 * largest)
        velocity[:] = shifted
        residual[:] = trial
        size = smaller
    return False


@compiled()
def settled(model: Any, left: float, right: float, velocity: Any, linear: Any) -> bool:
    """Let the robot start from rest, and polish the velocity (3) it settles on; False where it does not settle.

    model: a record whose varies is 0.
    """
    knots, state, out = np.zeros((1, 3)), np.zeros(6), np.empty((2, 6))
    knots[0, 1], knots[0, 2] = left, right
    done, _ = integrate_run(model, knots, state, np.array(SETTLING_S), out, TOLERANCE_MM, np.zeros((0, 2)), False)
    velocity[:] = state[3:]
    return bool(done == DONE and newton(model, left, right, velocity, linear) and is_stable(linear))


@compiled(parallel=True)
def solve_map(models: Any, left: Any, ratios: Any, out: Any, stable: Any) -> None:
    """Balances for left rpm (n,) and ratio right/left (m,) into out (n, m, 3) and stable (n, m); NaN where none is.

    Each is followed from its neighbour in ratio; where that fails or turns unstable, the robot starts from rest.
    """
    for row in prange(len(left)):
        linear, velocity = np.zeros((4, 3)), np.zeros(3)
        known = False
        for column in range(len(ratios)):
            right = ratios[column] * left[row]
            known = known and newton(models[0], left[row], right, velocity, linear) and is_stable(linear)
            if not known:
                known = settled(models[0], left[row], right, velocity, linear)
            out[row, column] = velocity if known else np.full(3, np.nan)
            stable[row, column] = known


@compiled()
def follow(model: Any, left: float, ratio: float, low: float, high: float, velocity: Any, step: float, out: Any) -> int:
    """Follow a balance through its folds as the ratio right/left changes: continuation by arc length.

    velocity: a balance at ratio; step: arc length over the largest surface speed, negative toward smaller ratios;
    out: (n, 5) ratio, velocity, stability. Ends where the ratio leaves low … high or out is full; returns the number of
    points.
    """
    scale = model.speed[0] * abs(left)
    linear, residual, changed = np.zeros((4, 3)), np.empty(3), np.empty(3)
    point = np.array([ratio, velocity[0] / scale, velocity[1] / scale, velocity[2] / scale])
    tangent, matrix, right_side = np.zeros(4), np.zeros((4, 4)), np.zeros(4)
    tangent[0] = np.sign(step)
    count, length = 0, abs(step)
    while count < len(out) and low <= point[0] <= high and length > 1e-7:
        guess, converged = point.copy(), False
        if count > 0:
            guess += length * tangent
        for iteration in range(12):
            now = guess[1:] * scale
            unbalance(model, left, guess[0] * left, now, residual)
            differentiate(model, left, guess[0] * left, now, residual, linear)
            unbalance(model, left, (guess[0] + 1e-7) * left, now, changed)
            matrix[:3, 0] = (changed - residual) / 1e-7
            matrix[:3, 1:] = linear[1:4] * scale
            matrix[3] = tangent
            right_side[:3] = -residual
            right_side[3] = 0.0 if iteration or count == 0 else length - np.dot(tangent, guess - point)
            if not np.isfinite(matrix).all() or np.linalg.cond(matrix) > 1e14:
                break
            change = np.linalg.solve(matrix, right_side)
            guess += change
            if np.abs(change).max() < 1e-10:
                converged = True
                break
        if not converged or np.abs(guess - point).max() > 3 * length:
            length /= 2
            if count == 0:
                return 0
            continue
        right_side[:3], right_side[3] = 0.0, 1.0
        tangent[:] = np.linalg.solve(matrix, right_side)
        tangent /= np.sqrt((tangent**2).sum())
        out[count, 0], out[count, 1:4] = guess[0], guess[1:] * scale
        out[count, 4] = is_stable(linear)
        point, count, length = guess, count + 1, min(1.5 * length, abs(step))
    return count
