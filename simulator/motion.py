"""A whole run in one kernel: Rosenbrock steps through starts, stops and reversals, circles once the turn is steady.

After every break of the command the velocity relaxes onto a slow manifold within milliseconds; adaptive steps follow it
there. Where the command is constant and no force varies with place, heading or time, the manifold is one point: the
steady turn. The run then ends in a circular arc, exact for the full dynamics, and what is left of the relaxation is
integrated in closed form. Where forces vary, the steps grow to what the variation of the velocity asks for.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.compiled import compiled
from simulator.contact import fresh_contacts
from simulator.dynamics import accelerations
from simulator.rosenbrock import between, invert3, linearize, moved, place_after
from simulator.segments import BEGIN, END, STEADY, command_segments, drive_at
from simulator.stability import growth_rate, is_stable
from simulator.stepping import (
    LEVER_MM,
    SHORTEST_STEP_S,
    first_step,
    shrinking,
    smooth_step,
    sticking_step,
)

# The linear formula for the end of a relaxation errs by the square of this share of the velocity.
STEADY_SHARE = 1e-4
MOST_STEPS = 20000
CREEPING_STEP_S, MOST_CREEPING = 1e-5, 40  # so many such steps in a row mean that a wheel sticks or turns over
# Steps grow with the time since the last break of the command, but where a method chatters over a bend for ever.
CHATTERING_SHARE = 3e-3
# Nothing physical is faster than SHORTEST_STEP_S: many steps in a row a thousand times shorter mean that the forces
# jump at this state (a motor that droops more than its load lets it settle), and that no motion follows from them.
STALLED_STEP_S, MOST_STALLED = 2e-9, 60
DONE, FAILED = 0, 1


@compiled()
def workspace() -> Any:
    """Scratch for one run: states and stages, linearization, solver matrices, step ends."""
    return np.zeros((40, 6)), np.zeros((3, 3, 3)), np.zeros((4, 3)), fresh_contacts()


@compiled()
def settle(pose: Any, segment: Any, time: float, y: Any, model: Any, contacts: Any, work: Any, solver: Any) -> bool:
    """Where y (6) is close to a stable steady turn, move it there and return True.

    y enters linearized in work and with twist 0; it leaves with the velocity of the steady turn and the twist that the
    rest of the relaxation, velocity' = J·(velocity - steady velocity), will have made: -J⁻¹·(velocity - steady).
    """
    inverse = solver[0]
    if not is_stable(work) or not invert3(work[1:4, :3], inverse):
        return False
    size, distance = 0.0, 0.0
    for row in range(3):
        lever = LEVER_MM if row == 2 else 1.0
        size = max(size, lever * abs(y[3 + row]))
        to_go = inverse[row, 0] * work[0, 0] + inverse[row, 1] * work[0, 1] + inverse[row, 2] * work[0, 2]
        distance = max(distance, lever * abs(to_go))
    if distance > max(STEADY_SHARE * size, model.rest_speed):
        return False
    steady, residual, start = work[10], work[11], work[12]
    start[:] = y
    steady[:] = y
    residual[:] = work[0]
    change, moved_by = 1.0, 0.0
    drive, place = drive_at(segment, time, model.lag), place_after(pose, 0.0, 0.0, 0.0, time, model)
    for _ in range(8):  # the first Jacobian is good to the share above, so that each pass gains digits
        change = 0.0
        for row in range(3):
            step = inverse[row, 0] * residual[0] + inverse[row, 1] * residual[1] + inverse[row, 2] * residual[2]
            steady[3 + row] -= step
            change = max(change, (LEVER_MM if row == 2 else 1.0) * abs(step))
        moved_by += change
        if change <= 1e-13 * size + 1e-16 or moved_by > 2 * distance:
            break
        residual[0], residual[1], residual[2] = accelerations(
            steady[3], steady[4], steady[5], drive, place, model.rest_speed, model, contacts
        )
    if not (change <= 1e-10 * size + 1e-15 and moved_by <= 2 * distance):
        return False  # forces bend within the distance: not close after all
    for row in range(3):
        y[row] = 0.0
        for column in range(3):
            y[row] -= inverse[row, column] * (start[3 + column] - steady[3 + column])
    for row in range(3):
        y[3 + row] = steady[3 + row]
    return True


@compiled()
def at_rest(segment: Any, time: float, model: Any) -> bool:
    """Whether no motor turns: an unstable balance then is within the rounding of rest, and as good as rest."""
    drive = drive_at(segment, time, model.lag)
    return bool(drive[0] == 0.0 and drive[1] == 0.0)


@compiled()
def write_arc(
    out: Any, times: Any, row: int, until: float, last: bool, time: float, pose: Any, y: Any, step: float
) -> int:
    """Outputs on the arc that starts at time: a twist y[:3] at once, then constant velocity y[3:]."""
    x, at_y, heading = moved(pose, y[0], y[1], y[2])
    u, v, r = y[3], y[4], y[5]
    cos, sin = math.cos(heading), math.sin(heading)
    while row < len(times) and (times[row] < until or (last and times[row] <= until)):
        since = times[row] - time
        angle = r * since
        if abs(angle) < 1e-4:
            straight, aside = since * (1.0 - angle * angle / 6.0), since * angle / 2.0
        else:
            straight, aside = math.sin(angle) / r, (1.0 - math.cos(angle)) / r
        ahead, left = straight * u - aside * v, aside * u + straight * v
        out[row, 0], out[row, 1], out[row, 2] = (
            x + cos * ahead - sin * left,
            at_y + sin * ahead + cos * left,
            heading + angle,
        )
        out[row, 3], out[row, 4], out[row, 5] = u, v, r
        row += 1
    pose[0], pose[1], pose[2] = x, at_y, heading
    pose[0], pose[1], pose[2] = moved(pose, u * step, v * step, r * step)
    return row


@compiled()
def integrate_run(
    model: Any,
    knots: Any,
    state: Any,
    times: Any,
    out: Any,
    tolerance: float,
    plan: Any,
    replay: bool,
    most_steps: int = MOST_STEPS,
) -> tuple[int, int]:
    """Integrate from state (6: pose, velocity) at times[0] to times[-1]; outputs (n, 6) into out; state is moved on.

    plan: (m, 2) of segment and step. It is filled with the accepted steps; with replay it prescribes them, so that the
    result is a smooth function of model and state. Returns DONE or FAILED and the number of steps of the plan.
    """
    scratch, solver, bent, contacts = workspace()
    pose, y, end, stages, work = state[:3], scratch[0], scratch[1:3], scratch[3:9], scratch[9:]
    segments = command_segments(knots, times[0], times[-1], model)
    y[:3] = 0.0
    y[3:] = state[3:]
    out[0] = state
    row, used, creeping, stalled = 1, 0, 0, 0
    finer = shrinking(tolerance)
    for number in range(len(segments)):
        segment = segments[number]
        time, step, last = segment[BEGIN], 0.0, number == len(segments) - 1
        while time < segment[END]:
            remaining = segment[END] - time
            planned = replay and used < len(plan) and int(plan[used, 0]) == number
            expected = min(remaining, abs(plan[used, 1]) if planned else step)
            # In a step of h seconds forces that vary with place change by 0.01·h of themselves, and with them the
            # velocity, for a displacement of 0.01·h² mm or so: within h = sqrt(tolerance in mm) their derivatives
            # are not needed.
            linearize(pose, segment, time, expected > math.sqrt(tolerance), y, model, contacts, work)
            closed = segment[STEADY] == 1.0 and model.varies == 0 and not planned
            if closed and settle(pose, segment, time, y, model, contacts, work, solver):
                row = write_arc(out, times, row, segment[END], last, time, pose, y, remaining)
                y[:3] = 0.0
                break
            if step == 0.0:
                step = first_step(work, tolerance, remaining)
            sticking = planned and plan[used, 1] < 0.0
            if planned:
                step = abs(plan[used, 1])
            elif not at_rest(segment, time, model):
                step = min(step, 1.0 / (growth_rate(work) + 1e-30))
            tried, wanted = 0.0, 0.0
            if not sticking and (planned or creeping < MOST_CREEPING):
                tried, wanted = smooth_step(
                    pose,
                    segment,
                    time,
                    min(step, remaining),
                    y,
                    model,
                    tolerance,
                    planned,
                    contacts,
                    work,
                    solver,
                    stages,
                    end,
                )
            if tried == 0.0:
                sticking = True
                step = abs(plan[used, 1]) if planned else max(step, SHORTEST_STEP_S * finer)
                tried, wanted = sticking_step(
                    pose,
                    segment,
                    time,
                    min(step, remaining),
                    y,
                    model,
                    tolerance,
                    planned,
                    contacts,
                    work,
                    bent,
                    solver,
                    end,
                )
                stages[:] = 0.0  # outputs within the step are on the straight line
            if tried == 0.0 or used >= most_steps or stalled >= MOST_STALLED:
                return FAILED, used
            if not replay and used < len(plan):
                plan[used, 0], plan[used, 1] = number, -tried if sticking else tried
            used += 1
            small = finer * max(CREEPING_STEP_S, finer * CHATTERING_SHARE * (time - segment[BEGIN]))
            creeping = creeping + 1 if tried < small else 0
            stalled = stalled + 1 if tried < STALLED_STEP_S * min(finer, remaining) else 0
            following = segment[END] if tried >= remaining else time + tried
            row = _write_step(
                out, times, row, following, last and tried >= remaining, time, tried, pose, y, stages, end, work
            )
            pose[0], pose[1], pose[2] = moved(pose, end[0, 0], end[0, 1], end[0, 2])
            y[:3] = 0.0
            y[3:] = end[0, 3:]
            time, step = following, wanted
    state[3:] = y[3:]
    return DONE, used


@compiled()
def _write_step(
    out: Any,
    times: Any,
    row: int,
    until: float,
    last: bool,
    time: float,
    step: float,
    pose: Any,
    y: Any,
    stages: Any,
    end: Any,
    work: Any,
) -> int:
    """Outputs inside the step just taken."""
    at = work[10]
    while row < len(times) and (times[row] < until or (last and times[row] <= until)):
        between((times[row] - time) / step, y, stages, end, at)
        out[row, 0], out[row, 1], out[row, 2] = moved(pose, at[0], at[1], at[2])
        out[row, 3], out[row, 4], out[row, 5] = at[3], at[4], at[5]
        row += 1
    return row
