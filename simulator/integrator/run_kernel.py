"""Integration of a whole run in one kernel: starts, stops and reversals, then along the slow manifold.

After every break of the command the velocity relaxes onto a slow manifold within milliseconds; adaptive steps follow
this relaxation. After it, a run with constant command and forces is a circular arc, computed in closed form; if forces
vary with position, heading or time, or the command varies, long collocation steps are used. Where friction changes
abruptly on the way, because a wheel stops or reverses its sliding, adaptive steps take over.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.compilation import compiled, counter
from simulator.dynamics.motors import BEGIN, END, STEADY, command_segments
from simulator.dynamics.wheel import reset_contacts
from simulator.integrator.collocation import go_to_end, long_step, write_polynomials
from simulator.integrator.rosenbrock import TIME_STEP_S, between, linearize, moved
from simulator.integrator.slow_manifold import is_off, near_manifold, settle, write_arc
from simulator.integrator.stability import growth_rate
from simulator.integrator.step_control import first_step, is_resting, short_step, shrinking
from simulator.integrator.workspace import copy, new_work

MOST_STEPS = 20000
CREEPING_STEP_S, MOST_CREEPING = 1e-5, 40  # so many short steps in a row mean that a wheel sticks or slides backward
# Steps grow with the time since the last break of the command, unless the method chatters across a kink of friction:
# a step below this share of that time counts as creeping, too.
CHATTERING_SHARE = 3e-3
# Nothing physical is faster than SHORTEST_STEP_S. Many consecutive steps a thousand times shorter mean that the forces
# are discontinuous at this state (extreme motor droop), and that the equations have no solution beyond it.
STALLED_STEP_S, MOST_STALLED = 2e-9, 60
# Evaluations of the forces by implicit Euler, for each step that a run may take. Of 285,000 runs that diagnoses of five
# sessions asked for, those that came to their end had 21 at most, but for seven; where axles are compliant and wheels
# stick, steps may fail over thousands, so that one run takes seconds instead of milliseconds.
EVALUATIONS_OF_A_STEP = 25.0
DONE, FAILED = 0, 1


@compiled()
def integrate_run(
    model: Any,
    knots: Any,
    state: Any,
    times: Any,
    out: Any,
    tolerance: float,
    most_steps: int,
) -> tuple[int, int, float]:
    """Integrate from state (6: pose, velocity) at times[0] to times[-1]; fills out (n, 6) and updates state.

    Arguments are in mm and s and converted to the units of the model (simulator.dynamics.scale); tolerance is in its
    unit of length. Returns DONE or FAILED, the number of steps taken, and the logarithm of the largest factor by which
    a small disturbance of the velocity grows after a break of the command.
    """
    holder = new_work(model)
    unit = model.time_unit
    if unit == 1.0:
        segments = command_segments(knots, times[0], times[-1], model)
        return _through(model, segments, state, times, out, tolerance, most_steps, holder)
    inside = np.empty(len(times))  # in a loop: array expressions would add error texts to the compiled code
    for row in range(len(times)):
        inside[row] = times[row] / unit
    segments = command_segments(_scaled_knots(knots, unit), inside[0], inside[-1], model)
    _scale_row(state, 1.0 / unit)
    done, used, grown = _through(model, segments, state, inside, out, tolerance, most_steps, holder)
    _scale_row(state, unit)
    for row in range(len(out)):
        _scale_row(out[row], unit)
    return done, used, grown


@compiled()
def _scaled_knots(knots: Any, unit: float) -> Any:
    """Knots of a command in the units of the kernels: time over the unit, rpm times it."""
    scaled = np.empty((len(knots), 3))
    for row in range(len(knots)):
        scaled[row, 0] = knots[row, 0] / unit
        scaled[row, 1], scaled[row, 2] = knots[row, 1] * unit, knots[row, 2] * unit
    return scaled


@compiled()
def _scale_row(state: Any, unit: float) -> None:
    """Multiply a state (6) by the units of a robot; unit: of time, its square is that of length."""
    state[0] *= unit * unit
    state[1] *= unit * unit
    state[3] *= unit
    state[4] *= unit
    state[5] /= unit


@compiled()
def _through(
    model: Any,
    segments: Any,
    state: Any,
    times: Any,
    out: Any,
    tolerance: float,
    most_steps: int,
    holder: Any,
) -> tuple[int, int, float]:
    """Integrate a run segment by segment; holder (1,): array that holds the record of the run (see workspace)."""
    work = holder[0]
    for item in range(3):
        work.pose[item], work.y[3 + item] = state[item], state[3 + item]
    work.tried = 0.0
    reset_contacts(work.contacts)
    copy(state, out[0])
    row, used, grown = counter(1), counter(0), 0.0
    for number in range(len(segments)):
        copy(segments[number], work.segment)
        work.grown = 0.0
        rows = row, output_rows(times, row, segments[number, END], number == len(segments) - 1)
        used = _through_segment(model, times, rows, out, tolerance, used, most_steps, work)
        row = rows[1]
        if used < 0:
            return FAILED, -used, grown
        grown = max(grown, work.grown)
    for item in range(3):
        state[item], state[3 + item] = work.pose[item], work.y[3 + item]
    return DONE, used, grown


@compiled()
def output_rows(times: Any, row: int, until: float, last: bool) -> int:
    """Index of the first time, from row on, that is not before until; with last, that is after until."""
    while row < len(times) and (times[row] < until or (last and times[row] <= until)):
        row += 1
    return row


@compiled()
def _through_segment(
    model: Any,
    times: Any,
    rows: tuple[int, int],
    out: Any,
    tolerance: float,
    used: int,
    most_steps: int,
    work: Any,
) -> int:
    """Integrate the segment in work and write its rows of out; returns the steps used so far, negative on failure."""
    begin, end, row = work.segment[BEGIN], work.segment[END], rows[0]
    closed = work.segment[STEADY] == 1.0 and model.varies == 0
    time, step, longest, resume, creeping, stalled = begin, 0.0, math.inf, begin, 0, 0
    while time < end:
        remaining = end - time
        linearize(time, min(remaining, step) > _unvaried_step(tolerance), model, work)
        length, wanted, collocated = 0.0, step, False
        if near_manifold(tolerance, closed or is_off(time, model, work), model, work):
            if closed and settle(time, model, work):
                write_arc(out, times, (row, rows[1]), time, remaining, work)
                return used
            if not closed and time >= resume:
                collocated, length, longest = long_step(time, remaining, longest, step, tolerance, model, work)
                resume = time if collocated else time + length
        if not collocated:
            asked = _asked_step(time, step, tolerance, model, work)
            length, wanted = short_step(time, asked, remaining, tolerance, creeping >= MOST_CREEPING, model, work)
            work.grown += work.growth * length
            moving = not is_resting(work.y, model)
            creeping = creeping + 1 if moving and length < _creeping_step(time - begin, tolerance) else 0
            stalled = stalled + 1 if moving and length < STALLED_STEP_S * min(shrinking(tolerance), remaining) else 0
        exhausted = used >= most_steps or work.tried >= EVALUATIONS_OF_A_STEP * most_steps
        if length == 0.0 or stalled >= MOST_STALLED or exhausted:
            return -used - 1
        used += 1
        following = end if length >= remaining * (1.0 - 1e-12) else time + length
        until = rows[1] if following == end else output_rows(times, row, following, following == end)
        _write_step(out, times, (row, until), time, length, collocated, work)
        row, time, step = until, following, wanted
    return used


@compiled()
def _unvaried_step(tolerance: float) -> float:
    """The longest step for which derivatives of forces by place are not needed.

    In h seconds, forces that vary with position change by about 0.01·h of themselves, and so does the velocity: a
    displacement of about 0.01·h² mm. Hence h is the square root of the tolerance in mm.
    """
    return math.sqrt(tolerance)


@compiled()
def _creeping_step(since: float, tolerance: float) -> float:
    """The longest step that counts as creeping; since: time after the last break of the command."""
    finer = shrinking(tolerance)
    return float(finer * max(CREEPING_STEP_S, finer * CHATTERING_SHARE * since))


@compiled()
def _asked_step(time: float, step: float, tolerance: float, model: Any, work: Any) -> float:
    """The step to try: the proposed one, or a first one, short enough not to stay on an unstable equilibrium."""
    if step == 0.0:
        step = min(first_step(work.linear, tolerance), _unvaried_step(tolerance))
    work.growth = 0.0
    if is_off(time, model, work):
        if not is_off(time + TIME_STEP_S, model, work):
            return TIME_STEP_S  # motors start now: a longer step would pass over the instability of the start
        return step  # the unstable equilibrium lies within the smoothing at rest, and counts as rest
    work.growth = growth_rate(work.linear)
    return float(min(step, 1.0 / (work.growth + 1e-30)))


@compiled()
def _write_step(
    out: Any, times: Any, rows: tuple[int, int], time: float, step: float, collocated: bool, work: Any
) -> None:
    """Write the outputs within the step just taken, and move the run to its end."""
    if collocated:
        write_polynomials(out, times, rows, time, step, work.table)
        go_to_end(work)
        return
    at, pose, end = work.spare[0], work.pose, work.end
    for row in range(rows[0], rows[1]):
        between((times[row] - time) / step, work, at)
        out[row, 0], out[row, 1], out[row, 2] = moved(pose, at[0], at[1], at[2])
        out[row, 3], out[row, 4], out[row, 5] = at[3], at[4], at[5]
    pose[0], pose[1], pose[2] = moved(pose, end[0, 0], end[0, 1], end[0, 2])
    for item in range(3):
        work.y[item], work.y[3 + item] = 0.0, end[0, 3 + item]
