"""Kernels that find velocities at which all forces balance.

A balance is a root of the accelerations at constant rpm. Forces that vary with place, heading or time are taken at the
origin of the plate, heading 0, time 0. linear: (4, 3), rows 1 to 3 are the derivative by velocity.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simulator.compilation import compiled
from simulator.dynamics.equations import accelerations, slopes
from simulator.dynamics.wheel import reset_contacts
from simulator.integrator.rosenbrock import invert3
from simulator.integrator.workspace import copy, new_work


@compiled()
def unbalance(model: Any, left: float, right: float, velocity: Any, out: Any) -> float:
    """Write the accelerations at a velocity (3) to out (3); returns their norm."""
    u, v, r = velocity[0], velocity[1], velocity[2]
    drive, place = (1.0 * left, 1.0 * right, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0, 0.0)
    holder = new_work(model)
    work = holder[0]
    reset_contacts(work.contacts)
    out[0], out[1], out[2] = accelerations(u, v, r, drive, place, model.rest_speed, model, work.contacts)
    return float(np.sqrt(out[0] ** 2 + out[1] ** 2 + 4 * out[2] ** 2))


@compiled()
def differentiate(model: Any, left: float, right: float, velocity: Any, residual: Any, linear: Any) -> None:
    """Write the accelerations to residual (3), their derivative by velocity to rows 1 to 3 of linear (4, 3)."""
    drive, place = (1.0 * left, 1.0 * right, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0, 0.0)
    holder = new_work(model)
    work = holder[0]
    reset_contacts(work.contacts)
    slopes(velocity[0], velocity[1], velocity[2], drive, place, model.rest_speed, model, work.contacts, work.linear)
    for column in range(3):
        residual[column] = work.linear[0, column]
        for row in range(4):
            linear[row, column] = work.linear[row, column]


@compiled()
def newton(model: Any, left: float, right: float, velocity: Any, linear: Any) -> bool:
    """Newton's method with backtracking from the given velocity (3); if it returns True, velocity is the root."""
    largest = model.speed[0] * max(abs(left), abs(right), 1e-6)
    inverse, residual, trial, shifted, step = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    size = unbalance(model, left, right, velocity, residual)
    for _ in range(80):
        differentiate(model, left, right, velocity, residual, linear)
        if not invert3(linear[1:4], inverse):
            return False
        length = 0.0
        for row in range(3):
            step[row] = 0.0
            for column in range(3):
                step[row] -= inverse[row, column] * residual[column]
            length = max(length, abs(step[row]))
        if length < 1e-12 * largest:
            return True
        share, smaller = 2.0, np.inf
        while not smaller < size and share > 1e-6:
            share *= 0.5
            for row in range(3):
                shifted[row] = velocity[row] + share * step[row]
            smaller = unbalance(model, left, right, shifted, trial)
        if not smaller < size:  # rounding ends the descent
            return bool(length < 1e-9 * largest)
        copy(shifted, velocity)
        copy(trial, residual)
        size = smaller
    return False
