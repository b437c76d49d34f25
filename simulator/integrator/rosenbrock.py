"""One step of a stiffly accurate Rosenbrock method for the full dynamics.

Method: RODAS of Hairer and Wanner (Solving ODEs II, IV.7): 6 stages, order 4, error estimate of order 3, L-stable.
The pose within a step is the start pose times the exponential of a twist (a Lie group method on SE(2)): the twist obeys
twist' = dexpinv(velocity), so that a steady turn is a circle to rounding, however long the step.

State of a step: twist (x, y, angle), then velocity (u, v, r); six numbers, body frame at the start of the step.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.compilation import compiled
from simulator.dynamics.body import Triple, body_forces
from simulator.dynamics.equations import accelerated, accelerations, slopes
from simulator.dynamics.motors import STEADY, drive_at
from simulator.integrator.workspace import STAGES

GAMMA = 0.25
A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1.544, 0.0, 0.0, 0.0, 0.0],
        [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0],
        [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0],
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
PLACE_STEP = 1e-6  # mm, rad: differences whose error stays below 1e-5 of the derivative
TIME_STEP_S = 1e-9  # likewise; motors that start pass within microseconds through the smoothing at rest


@compiled()
def moved(pose: Any, x: float, y: float, angle: float) -> tuple[float, float, float]:
    """Pose (x, y, heading) after the exponential of a twist in the body frame."""
    if abs(angle) < 1e-4:
        straight, sideways = 1.0 - angle * angle / 6.0, angle / 2.0
    else:
        straight, sideways = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle
    ahead, left = straight * x - sideways * y, sideways * x + straight * y
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return pose[0] + cos * ahead - sin * left, pose[1] + sin * ahead + cos * left, pose[2] + angle


@compiled()
def place_after(pose: Any, x: float, y: float, angle: float, time: float, model: Any) -> Any:
    """The place (x, y, cosine, sine, time) after a twist; the origin if no force depends on it."""
    if model.varies == 0:
        return 0.0, 0.0, 1.0, 0.0, time
    at_x, at_y, heading = moved(pose, x, y, angle)
    return at_x, at_y, math.cos(heading), math.sin(heading), time


@compiled()
def _gained(u: float, v: float, r: float, drive: Any, here: Triple, there: Any, model: Any, work: Any) -> Triple:
    """Change of the accelerations at another place; only that of the forces on the body if friction does not vary."""
    if model.wheels_vary == 1:
        at = accelerations(u, v, r, drive, there, model.rest_speed, model, work.contacts)
        return at[0] - work.linear[0, 0], at[1] - work.linear[0, 1], at[2] - work.linear[0, 2]
    at = body_forces(u, v, r, there, model.rest_speed, model)
    return accelerated(at[0] - here[0], at[1] - here[1], at[2] - here[2], model)


@compiled()
def linearize(time: float, varied: bool, model: Any, work: Any) -> None:
    """Fill work.linear at work.y, whose twist is 0; varied: with the derivatives by twist and time."""
    u, v, r, rest, linear, pose = work.y[3], work.y[4], work.y[5], model.rest_speed, work.linear, work.pose
    place, drive = place_after(pose, 0.0, 0.0, 0.0, time, model), drive_at(work.segment, time, model.lag)
    slopes(u, v, r, drive, place, rest, model, work.contacts, linear)
    for row in range(4, 8):
        linear[row, 0], linear[row, 1], linear[row, 2] = 0.0, 0.0, 0.0
    here = 0.0, 0.0, 0.0
    if model.varies == 1 and varied:
        if model.wheels_vary == 0:
            here = body_forces(u, v, r, place, rest, model)
        for column in range(3):
            shifts = PLACE_STEP * (column == 0), PLACE_STEP * (column == 1), PLACE_STEP * (column == 2)
            there = place_after(pose, shifts[0], shifts[1], shifts[2], time, model)
            gained = _gained(u, v, r, drive, here, there, model, work)
            for row in range(3):
                linear[4 + row, column] = gained[row] / PLACE_STEP
    later = time + TIME_STEP_S
    there = (place[0], place[1], place[2], place[3], later)
    if model.wheels_vary == 1 or work.segment[STEADY] == 0.0:
        turned = drive_at(work.segment, later, model.lag)
        at = accelerations(u, v, r, turned, there, rest, model, work.contacts)
        for row in range(3):
            linear[7, row] = (at[row] - linear[0, row]) / (later - time)
    elif model.varies == 1 and varied:
        gained = _gained(u, v, r, drive, here, there, model, work)
        for row in range(3):
            linear[7, row] = gained[row] / (later - time)


@compiled()
def invert3(a: Any, out: Any) -> bool:
    """Write the inverse of a 3 × 3 matrix to out; False if it is singular."""
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
def factorize(step: float, varies: bool, work: Any) -> bool:
    """Write the inverse of the velocity block for the stages of a step to work.inverse; False if it is singular.

    The system is [[B, -1], [-G, W]]·(twist, velocity); B = 1/(gamma·step) - d twist'/d twist, G = d velocity'/d twist,
    the velocity block W - G·B⁻¹.
    """
    diagonal = 1.0 / (GAMMA * step)
    block, linear = work.block, work.linear
    for row in range(3):
        for column in range(3):
            block[row, column] = -linear[1 + row, column]
        block[row, row] += diagonal
    if varies:
        for column in range(3):
            x, at_y, angle = untwist(diagonal, work.y, column == 0, column == 1, column == 2)
            for row in range(3):
                block[row, column] -= linear[4 + row, 0] * x + linear[4 + row, 1] * at_y + linear[4 + row, 2] * angle
    return invert3(block[:3], work.inverse[:3])  # slices, as of its other callers: one compiled version


@compiled()
def untwist(diagonal: float, y: Any, x: float, at_y: float, angle: float) -> tuple[float, float, float]:
    """B⁻¹ applied to a vector; B is [[d, -r/2, v/2], [r/2, d, -u/2], [0, 0, d]]."""
    turn, half = angle / diagonal, 0.5 * y[5]
    x, at_y = x - 0.5 * y[4] * turn, at_y + 0.5 * y[3] * turn
    scale = 1.0 / (diagonal * diagonal + half * half)
    return scale * (diagonal * x + half * at_y), scale * (diagonal * at_y - half * x), turn


@compiled()
def attempt(time: float, step: float, model: Any, work: Any) -> bool:
    """Take one step from work.y to work.end; False if it fails."""
    varies = model.varies == 1
    if not factorize(step, varies, work):
        return False
    y, end, stages, linear, inverse = work.y, work.end, work.stages, work.linear, work.inverse
    diagonal, per_step = 1.0 / (GAMMA * step), 1.0 / step
    for stage in range(STAGES):
        for item in range(6):
            reached, memory = y[item], 0.0
            for before in range(stage):
                reached += A[stage, before] * stages[before, item]
                memory += C[stage, before] * stages[before, item]
            end[0, item], end[1, item] = reached, memory * per_step
        x, at_y, angle, u, v, r = end[0, 0], end[0, 1], end[0, 2], end[0, 3], end[0, 4], end[0, 5]
        at = time + NODES[stage] * step
        gained = linear[0, 0], linear[0, 1], linear[0, 2]
        if stage > 0:
            place, drive = place_after(work.pose, x, at_y, angle, at, model), drive_at(work.segment, at, model.lag)
            gained = accelerations(u, v, r, drive, place, model.rest_speed, model, work.contacts)
        ahead, sideways = twisting(x, at_y, angle, u, v, r)
        ahead, sideways, turning = ahead + end[1, 0], sideways + end[1, 1], r + end[1, 2]
        fading = step * D[stage]
        g_u = gained[0] + end[1, 3] + fading * linear[7, 0]
        g_v = gained[1] + end[1, 4] + fading * linear[7, 1]
        g_r = gained[2] + end[1, 5] + fading * linear[7, 2]
        if varies:
            x, at_y, angle = untwist(diagonal, y, ahead, sideways, turning)
            g_u += linear[4, 0] * x + linear[4, 1] * at_y + linear[4, 2] * angle
            g_v += linear[5, 0] * x + linear[5, 1] * at_y + linear[5, 2] * angle
            g_r += linear[6, 0] * x + linear[6, 1] * at_y + linear[6, 2] * angle
        for row in range(3):
            stages[stage, 3 + row] = inverse[row, 0] * g_u + inverse[row, 1] * g_v + inverse[row, 2] * g_r
        ahead, sideways, turning = ahead + stages[stage, 3], sideways + stages[stage, 4], turning + stages[stage, 5]
        stages[stage, 0], stages[stage, 1], stages[stage, 2] = untwist(diagonal, y, ahead, sideways, turning)
    finite = True
    for item in range(6):
        end[1, item] = stages[5, item]
        end[0, item] += stages[5, item]
        finite = finite and math.isfinite(end[0, item])
    return finite


@compiled()
def twisting(x: float, y: float, angle: float, u: float, v: float, r: float) -> tuple[float, float]:
    """dexpinv: rate of the twist's x and y; velocity + bracket/2 + series·J·bracket, bracket = [twist, velocity]."""
    bracket_x, bracket_y = r * y - angle * v, angle * u - r * x
    square = angle * angle
    series = angle * (1.0 / 12.0 + square * (1.0 / 720.0 + square / 30240.0))
    return u + 0.5 * bracket_x - series * bracket_y, v + 0.5 * bracket_y + series * bracket_x


@compiled()
def between(share: float, work: Any, out: Any) -> None:
    """State at a share 0 … 1 of the step just taken (order 3)."""
    rest = 1.0 - share
    for item in range(6):
        quadratic, cubic = 0.0, 0.0
        for stage in range(5):
            quadratic += DENSE[0, stage] * work.stages[stage, item]
            cubic += DENSE[1, stage] * work.stages[stage, item]
        out[item] = rest * work.y[item] + share * (work.end[0, item] + rest * (quadratic + share * cubic))
