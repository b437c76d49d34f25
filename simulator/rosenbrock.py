"""One step of a stiffly accurate Rosenbrock method for the full dynamics, and what it needs.

Method: RODAS of Hairer and Wanner (Solving ODEs II, IV.7): 6 stages, order 4, error estimate of order 3, L-stable.
The pose within a step is the start pose times the exponential of a twist (a Lie group method on SE(2)): the twist obeys
twist' = dexpinv(velocity), so that a steady turn is a circle to rounding, however long the step.

State of a step: twist (x, y, angle), then velocity (u, v, r); six numbers, body frame at the start of the step.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.compiled import compiled
from simulator.dynamics import accelerated, accelerations, body_terms
from simulator.segments import STEADY, drive_at

STAGES = 6
GAMMA = 0.25
A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0],
        [1.544, 0.0, 0.0, 0.0],
        [0.9466785280815826, 0.2557011698983284, 0.0, 0.0],
        [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950],
    ]
)
C = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [-5.6688, 0.0, 0.0, 0.0, 0.0],
        [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0],
        [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0],
        [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160, 0.0],
        [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054],
    ]
)
NODES = np.array([0.0, 0.386, 0.21, 0.63, 1.0, 1.0])
D = np.array([0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0])
DENSE = np.array(
    [
        [10.12623508344586, -7.487995877610167, -34.80091861555747, -7.992771707568823, 1.025137723295662],
        [-0.6762803392801253, 6.087714651680015, 16.43084320892478, 24.76722511418386, -6.594389125716872],
    ]
)
# Differences for derivatives: rounding over step, and step over curvature, stay below 1e-5 of the derivative.
VELOCITY_STEP = 3e-10  # mm/s, rad/s; far below the rest speed, where forces bend most
PLACE_STEP = 1e-6  # mm, rad, s


@compiled()
def moved(pose: Any, x: float, y: float, angle: float) -> tuple[float, float, float]:
    """Pose (x, y, heading) after the exponential of a twist in the body frame."""
    if abs(angle) < 1e-4:
        straight, aside = 1.0 - angle * angle / 6.0, angle / 2.0
    else:
        straight, aside = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle
    ahead, left = straight * x - aside * y, aside * x + straight * y
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return pose[0] + cos * ahead - sin * left, pose[1] + sin * ahead + cos * left, pose[2] + angle


@compiled()
def rates(pose: Any, segment: Any, time: float, y: Any, model: Any, out: Any) -> None:
    """Derivative of the six states of a step into out."""
    left, right, left_angle, right_angle = drive_at(segment, time, model.lag)
    x, at_y, cos, sin = 0.0, 0.0, 1.0, 0.0
    if model.varies == 1:
        x, at_y, heading = moved(pose, y[0], y[1], y[2])
        cos, sin = math.cos(heading), math.sin(heading)
    u, v, r = y[3], y[4], y[5]
    out[3], out[4], out[5] = accelerations(
        u, v, r, left, right, left_angle, right_angle, x, at_y, cos, sin, time, model
    )
    # dexpinv: velocity + bracket/2 + series·J·bracket, bracket = [twist, velocity]
    angle = y[2]
    bracket_x, bracket_y = r * y[1] - angle * v, angle * u - r * y[0]
    square = angle * angle
    series = angle * (1.0 / 12.0 + square * (1.0 / 720.0 + square / 30240.0))
    out[0] = u + 0.5 * bracket_x - series * bracket_y
    out[1] = v + 0.5 * bracket_y + series * bracket_x
    out[2] = r


@compiled()
def linearize(pose: Any, segment: Any, time: float, varied: bool, y: Any, model: Any, work: Any) -> None:
    """Rates, their derivatives by velocity and, where forces vary, by time and if varied by twist, at a step's start.

    work: 0 rates (6); 1..3 derivative by velocity, rows of (3); 4..6 by twist; 7 by time; 8, 9 scratch.
    """
    rates(pose, segment, time, y, model, work[0])
    scratch, changed = work[8], work[9]
    changed[:] = y
    for column in range(3, 6):
        changed[column] = y[column] + VELOCITY_STEP
        rates(pose, segment, time, changed, model, scratch)
        change = changed[column] - y[column]
        for row in range(3):
            work[1 + row, column - 3] = (scratch[3 + row] - work[0, 3 + row]) / change
        changed[column] = y[column]
    for row in range(4, 8):
        work[row] = 0.0
    if model.varies == 1 and varied:
        if model.wheels_vary == 0:
            vary_body(pose, time, y, model, work)
        else:
            for column in range(3):
                changed[column] = PLACE_STEP
                rates(pose, segment, time, changed, model, scratch)
                for row in range(3):
                    work[4 + row, column] = (scratch[3 + row] - work[0, 3 + row]) / PLACE_STEP
                changed[column] = 0.0
    if model.wheels_vary == 1 or segment[STEADY] == 0.0:
        rates(pose, segment, time + PLACE_STEP, y, model, scratch)
        for row in range(3):
            work[7, 3 + row] = (scratch[3 + row] - work[0, 3 + row]) / PLACE_STEP


@compiled()
def vary_body(pose: Any, time: float, y: Any, model: Any, work: Any) -> None:
    """Derivatives by twist and time where only forces on the body vary: no friction need be worked out."""
    u, v, r = y[3], y[4], y[5]
    for column in range(-1, 4):
        x, at_y, heading = moved(
            pose, PLACE_STEP * (column == 0), PLACE_STEP * (column == 1), PLACE_STEP * (column == 2)
        )
        later = time + PLACE_STEP * (column == 3)
        force = body_terms(u, v, r, x, at_y, math.cos(heading), math.sin(heading), later, model)
        gained = accelerated(force[0], force[1], force[2], model)
        for row in range(3):
            if column < 0:
                work[8, row] = gained[row]
            elif column < 3:
                work[4 + row, column] = (gained[row] - work[8, row]) / PLACE_STEP
            else:
                work[7, 3 + row] = (gained[row] - work[8, row]) / PLACE_STEP


@compiled()
def invert3(a: Any, out: Any) -> bool:
    """Inverse of a 3 × 3 matrix into out; False where it is singular."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    c01 = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    c02 = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    determinant = a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02
    if determinant == 0.0 or not math.isfinite(determinant):
        return False
    scale = 1.0 / determinant
    out[0, 0], out[1, 0], out[2, 0] = c00 * scale, c01 * scale, c02 * scale
    out[0, 1] = (a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2]) * scale
    out[1, 1] = (a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]) * scale
    out[2, 1] = (a[0, 1] * a[2, 0] - a[0, 0] * a[2, 1]) * scale
    out[0, 2] = (a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]) * scale
    out[1, 2] = (a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2]) * scale
    out[2, 2] = (a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]) * scale
    return True


@compiled()
def factorize(y: Any, step: float, varies: bool, work: Any, solver: Any) -> bool:
    """Inverses for the stages of a step: solver[0] of the velocity block, solver[1] of the twist block.

    The system is [[B, -1], [-G, W]]·(twist, velocity); B = 1/(gamma·step) - d twist'/d twist, G = d velocity'/d twist.
    """
    diagonal = 1.0 / (GAMMA * step)
    u, v, r = y[3], y[4], y[5]
    block = solver[2]
    block[0, 0], block[0, 1], block[0, 2] = diagonal, -0.5 * r, 0.5 * v
    block[1, 0], block[1, 1], block[1, 2] = 0.5 * r, diagonal, -0.5 * u
    block[2, 0], block[2, 1], block[2, 2] = 0.0, 0.0, diagonal
    invert3(block, solver[1])
    for row in range(3):
        for column in range(3):
            block[row, column] = -work[1 + row, column]
            if varies:
                for inner in range(3):
                    block[row, column] -= work[4 + row, inner] * solver[1, inner, column]
        block[row, row] += diagonal
    return invert3(block, solver[0])


@compiled()
def attempt(
    pose: Any, segment: Any, time: float, step: float, y: Any, model: Any, work: Any, solver: Any, stages: Any, end: Any
) -> bool:
    """Take one step from y; end: (2, 6) the new state and the estimate of its error. False where the step fails."""
    varies = model.varies == 1
    if not factorize(y, step, varies, work, solver):
        return False
    state, right = work[8], work[9]
    for stage in range(STAGES):
        for item in range(6):
            if stage < 5:
                value = y[item]
                for before in range(min(stage, 4)):
                    value += A[stage, before] * stages[before, item]
            else:
                value = end[0, item] + stages[4, item]
            state[item] = value
            if stage >= 4:
                end[0, item] = value
        if stage == 0:
            right[:] = work[0]
        else:
            rates(pose, segment, time + NODES[stage] * step, state, model, right)
        for item in range(6):
            for before in range(stage):
                right[item] += C[stage, before] / step * stages[before, item]
        for row in range(3):
            right[3 + row] += step * D[stage] * work[7, 3 + row]
        _solve(right, varies, work, solver, stages[stage])
    finite = True
    for item in range(6):
        end[1, item] = stages[5, item]
        end[0, item] += stages[5, item]
        finite = finite and math.isfinite(end[0, item])
    return finite


@compiled()
def _solve(right: Any, varies: bool, work: Any, solver: Any, out: Any) -> None:
    """Solve one stage by block elimination."""
    velocity, twist = solver[0], solver[1]
    if varies:
        for inner in range(3):
            moved_by = twist[inner, 0] * right[0] + twist[inner, 1] * right[1] + twist[inner, 2] * right[2]
            for row in range(3):
                right[3 + row] += work[4 + row, inner] * moved_by
    for row in range(3):
        out[3 + row] = velocity[row, 0] * right[3] + velocity[row, 1] * right[4] + velocity[row, 2] * right[5]
    x, y, angle = right[0] + out[3], right[1] + out[4], right[2] + out[5]
    for row in range(3):
        out[row] = twist[row, 0] * x + twist[row, 1] * y + twist[row, 2] * angle


@compiled()
def between(share: float, y: Any, stages: Any, end: Any, out: Any) -> None:
    """State at a share 0 … 1 of the step just taken (order 3)."""
    rest = 1.0 - share
    for item in range(6):
        bend, twist = 0.0, 0.0
        for stage in range(5):
            bend += DENSE[0, stage] * stages[stage, item]
            twist += DENSE[1, stage] * stages[stage, item]
        out[item] = rest * y[item] + share * (end[0, item] + rest * (bend + share * twist))
