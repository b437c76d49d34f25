"""The end of a relaxation: whether slip has relaxed, and the steady turn that it reaches.

Where the command is constant and no force varies with place, heading or time, the slow manifold is one point, the
steady turn: a circular arc, exact for the full dynamics.
"""

from __future__ import annotations

import math
from typing import Any

from simulator.compilation import compiled
from simulator.dynamics.equations import accelerations
from simulator.dynamics.motors import drive_at
from simulator.integrator.rosenbrock import invert3, moved, place_after
from simulator.integrator.stability import is_stable
from simulator.integrator.step_control import LEVER_MM, MOVING_RESTS
from simulator.integrator.workspace import copy

# Share of the velocity within which forces are linear to a few per cent: friction saturates at slips twenty times that.
NEAR_SHARE = 1e-3


@compiled()
def near_manifold(tolerance: float, at_rest: bool, model: Any, work: Any) -> bool:
    """Whether slip has almost relaxed: the rest of it is linear and moves the robot by less than the tolerance.

    work.linear holds the linearization at work.y; the inverse of the derivative by velocity is stored in work.inverse.
    at_rest: whether the manifold may lie within the smoothing at rest, which alone holds a robot there for a moment
    after its wheels have begun to turn against each other.
    """
    linear, inverse, lacking, to_go = work.linear, work.inverse, work.spare[0], work.spare[1]
    if not is_stable(linear) or not invert3(linear[1:4], inverse[:3]):
        return False
    # On the manifold the acceleration is that of the moving equilibrium, -J⁻¹·(derivative by time).
    _times(inverse, linear[7], lacking)
    for row in range(3):
        lacking[row] += linear[0, row]
    _times(inverse, lacking, to_go)
    return close(to_go, tolerance, at_rest, model, work)


@compiled()
def is_off(time: float, model: Any, work: Any) -> bool:
    """Whether no motor turns at a time within the segment."""
    drive = drive_at(work.segment, time, model.lag)
    return bool(drive[0] == 0.0 and drive[1] == 0.0)


@compiled()
def close(to_go: Any, tolerance: float, at_rest: bool, model: Any, work: Any) -> bool:
    """Whether the velocity is close to one that differs from it by to_go (3), by the criterion of near_manifold."""
    size, distance, displacement, moved_by = 0.0, 0.0, 0.0, work.spare[2]
    _times(work.inverse, to_go, moved_by)
    for row in range(3):
        lever = LEVER_MM if row == 2 else 1.0
        size = max(size, lever * abs(work.y[3 + row]))
        distance = max(distance, lever * abs(to_go[row]))
        displacement = max(displacement, lever * abs(moved_by[row]))
    if size < MOVING_RESTS * model.rest_speed and not at_rest:
        return False
    return bool(distance <= max(NEAR_SHARE * size, model.rest_speed if at_rest else 0.0) and displacement <= tolerance)


@compiled()
def _times(matrix: Any, vector: Any, out: Any) -> None:
    for row in range(3):
        out[row] = matrix[row, 0] * vector[0] + matrix[row, 1] * vector[1] + matrix[row, 2] * vector[2]


@compiled()
def settle(time: float, model: Any, work: Any) -> bool:
    """Move work.y from near the manifold to the steady turn; False if it turns out not to be close.

    Before: work.y at twist 0, with its linearization and the inverse of near_manifold. After: the velocity of the
    steady turn, and the twist by which the rest of the relaxation, velocity' = J·(velocity - steady velocity), moves
    the robot: -J⁻¹·(velocity - steady velocity).
    """
    y, inverse = work.y, work.inverse
    steady, residual, step = work.spare[0], work.spare[1], work.spare[2]
    copy(y, steady)
    size, distance, change, moved_by = 0.0, 0.0, 1.0, 0.0
    for row in range(3):
        residual[row] = work.linear[0, row]
        size = max(size, (LEVER_MM if row == 2 else 1.0) * abs(y[3 + row]))
    drive, place = drive_at(work.segment, time, model.lag), place_after(work.pose, 0.0, 0.0, 0.0, time, model)
    for number in range(12):  # the first Jacobian is accurate to a few per cent: each pass gains more than a digit
        _times(inverse, residual, step)
        change = 0.0
        for row in range(3):
            steady[3 + row] -= step[row]
            change = max(change, (LEVER_MM if row == 2 else 1.0) * abs(step[row]))
        if number == 0:
            distance = change
        moved_by += change
        if change <= 1e-13 * size + 1e-16 or moved_by > 2 * distance:
            break
        residual[0], residual[1], residual[2] = accelerations(
            steady[3], steady[4], steady[5], drive, place, model.rest_speed, model, work.contacts
        )
    if not (change <= 1e-10 * size + 1e-15 and moved_by <= 2 * distance):
        return False  # forces are not linear over the distance
    for row in range(3):
        residual[row] = steady[3 + row] - y[3 + row]
    _times(inverse, residual, y)
    for row in range(3):
        y[3 + row] = steady[3 + row]
    return True


@compiled()
def write_arc(out: Any, times: Any, rows: tuple[int, int], time: float, step: float, work: Any) -> None:
    """Write the outputs on the arc that starts at time, and its end: the twist work.y[:3], then constant velocity."""
    pose, y = work.pose, work.y
    x, at_y, heading = moved(pose, y[0], y[1], y[2])
    u, v, r = y[3], y[4], y[5]
    cos, sin = math.cos(heading), math.sin(heading)
    for row in range(rows[0], rows[1]):
        since = times[row] - time
        angle = r * since
        if abs(angle) < 1e-4:
            straight, sideways = since * (1.0 - angle * angle / 6.0), since * angle / 2.0
        else:
            straight, sideways = math.sin(angle) / r, (1.0 - math.cos(angle)) / r
        ahead, left = straight * u - sideways * v, sideways * u + straight * v
        out[row, 0], out[row, 1] = x + cos * ahead - sin * left, at_y + sin * ahead + cos * left
        out[row, 2] = heading + angle
        out[row, 3], out[row, 4], out[row, 5] = u, v, r
    pose[0], pose[1], pose[2] = x, at_y, heading
    pose[0], pose[1], pose[2] = moved(pose, u * step, v * step, r * step)
    y[0], y[1], y[2] = 0.0, 0.0, 0.0
