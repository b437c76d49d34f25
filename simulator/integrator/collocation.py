"""Long steps along the slow manifold, where forces vary with position, heading, time or wheel angle, or the command.

Once slip has relaxed, the velocity is a smooth function of time: at every instant the wheel forces balance all other
forces, including the inertia of the slowly changing velocity. Over a long interval the velocity is approximated by the
polynomial that satisfies the full dynamics at Chebyshev points (collocation for a stiff system: Hairer and Wanner,
Solving ODEs II, VI.3); the displacement during the initial relaxation is added in closed form. Each sweep integrates
the path from the velocity, then takes one Newton step for the velocity at every point. The velocity depends only weakly
on forces that vary, so that few sweeps suffice. Outputs are the values of the polynomials in the plate frame.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.compilation import compiled, counter
from simulator.dynamics.equations import accelerations, slopes
from simulator.dynamics.motors import drive_at
from simulator.integrator.rosenbrock import invert3, moved
from simulator.integrator.slow_manifold import close, is_off
from simulator.integrator.stability import is_stable
from simulator.integrator.step_control import LEVER_MM
from simulator.integrator.workspace import POINTS

# Rows of the table of a step, a column per point: velocity; pose; rate of x and y in the plate frame; rate of the
# velocity; and, for outputs, coefficients of velocity or pose rate by powers of the time within the step, -1 … 1.
U, X, Y, HEADING, X_RATE, Y_RATE, CHANGE, POWERS = 0, 3, 4, 5, 6, 7, 8, 11
LONGEST_TURN_RAD = 3.0  # within a step; over more, cosine and sine of the heading need more points
MOST_SWEEPS = 12
# Over shorter steps the rate of the velocity, a difference between points, is too large for sweeps to converge.
SHORTEST_COLLOCATION_S = 5e-3
COST = 6.0  # of a step in short steps, by its evaluations of the forces; one that is not longer than these does not pay
LEAST_GAIN = 0.5  # least reduction of the residual by a sweep; slower convergence does not pay
# Change by the first sweep, as a share of the velocity, from which on the velocity is found point by point, and the
# Newton steps of a point: with new derivatives, and with the last ones.
FAR_SHARE, NEWTON_STEPS, MORE_STEPS = 0.05, 2, 1
# As displacements over the tolerance: the residual at which sweeps stop, and the last coefficients of a step that is
# accepted.
SWEPT_SHARE, CUT_SHARE = 0.02, 0.5


def _matrices() -> tuple[Any, Any, Any]:
    """Values at the points times these: powers, integrals from the start, derivatives; time of the step -1 … 1."""
    points = -np.cos(np.pi * np.arange(POINTS) / (POINTS - 1))
    power = np.arange(POINTS)
    of_values = np.linalg.inv(points[:, None] ** power)
    integrals = (points[:, None] ** (power + 1) - (-1.0) ** (power + 1)) / (power + 1)
    derivatives = power * points[:, None] ** np.maximum(power - 1, 0)
    return of_values.T.copy(), (integrals @ of_values).T.copy(), (derivatives @ of_values).T.copy()


TO_POWERS, INTEGRAL, DERIVATIVE = _matrices()
SHARES = (1.0 - np.cos(np.pi * np.arange(POINTS) / (POINTS - 1))) / 2.0


@compiled(fastmath={"contract"})
def _apply(matrix: Any, table: Any, source: int, scale: float, start: float, target: int) -> None:
    """Row target becomes start + scale · (row source) · matrix. Rows come from `counter`: one version is compiled."""
    for point in range(POINTS):
        table[target, point] = start
    for other in range(POINTS):
        factor = scale * table[source, other]
        for point in range(POINTS):
            table[target, point] += factor * matrix[other, point]


@compiled()
def _guess(time: float, length: float, model: Any, work: Any) -> None:
    """Initial values of the first sweep: velocities, and inverses of the derivatives by them, scaled with the command.

    Friction depends on ratios of speeds only, so that the balance of friction alone scales like this.
    """
    now = 0.0
    for point in range(POINTS):
        left, right, _, _ = drive_at(work.segment, time + SHARES[point] * length, model.lag)
        pace = math.sqrt(left * left + right * right)
        if point == 0:
            now = pace
        share = pace / now if now > 0.0 else 1.0
        for row in range(3):
            work.table[U + row, point] = share * work.y[3 + row]
            for column in range(3):
                work.inverses[point, row, column] = share * work.inverse[row, column]


@compiled()
def _march(time: float, length: float, model: Any, work: Any) -> None:
    """Velocities at the points, each by Newton steps from the previous point, without the inertia of their change.

    For forces that change much within a step: with the run-out of a wheel the first guess is off by its amplitude, and
    sweeps from there do not converge over more than a twentieth of a revolution.
    """
    table, bent = work.table, work.bent
    for point in range(1, POINTS):
        at, heading, inverse = time + SHARES[point] * length, table[HEADING, point], work.inverses[point]
        place = (table[X, point], table[Y, point], math.cos(heading), math.sin(heading), at)
        drive = drive_at(work.segment, at, model.lag)
        for row in range(3):
            table[U + row, point] = table[U + row, point - 1]
        for number in range(NEWTON_STEPS + MORE_STEPS):
            u, v, r = table[U, point], table[U + 1, point], table[U + 2, point]
            if number < NEWTON_STEPS:
                slopes(u, v, r, drive, place, model.rest_speed, model, work.contacts, bent)
                gained = bent[0, 0], bent[0, 1], bent[0, 2]
                if not invert3(bent[1:4], inverse):
                    return
            else:
                gained = accelerations(u, v, r, drive, place, model.rest_speed, model, work.contacts)
            for row in range(3):
                for column in range(3):
                    table[U + row, point] -= inverse[row, column] * gained[column]


@compiled()
def follow(length: float, work: Any) -> None:
    """Integrate the path from the velocity at the points, starting after the rest of the relaxation."""
    table, y, inverse = work.table, work.y, work.inverse
    u, v, r = table[U, 0] - y[3], table[U + 1, 0] - y[4], table[U + 2, 0] - y[5]
    x, at_y, heading = moved(
        work.pose,
        inverse[0, 0] * u + inverse[0, 1] * v + inverse[0, 2] * r,
        inverse[1, 0] * u + inverse[1, 1] * v + inverse[1, 2] * r,
        inverse[2, 0] * u + inverse[2, 1] * v + inverse[2, 2] * r,
    )
    _apply(INTEGRAL, table, counter(U + 2), 0.5 * length, heading, counter(HEADING))
    for point in range(POINTS):
        cos, sin = math.cos(table[HEADING, point]), math.sin(table[HEADING, point])
        table[X_RATE, point] = cos * table[U, point] - sin * table[U + 1, point]
        table[Y_RATE, point] = sin * table[U, point] + cos * table[U + 1, point]
    _apply(INTEGRAL, table, counter(X_RATE), 0.5 * length, x, counter(X))
    _apply(INTEGRAL, table, counter(Y_RATE), 0.5 * length, at_y, counter(Y))


@compiled()
def sweep(time: float, length: float, renew: bool, model: Any, work: Any) -> float:
    """Correct the velocity at every point; returns the largest change, mm/s; infinity if it is undefined.

    renew: recompute the derivatives by velocity at every point.
    """
    table, bent = work.table, work.bent
    largest = 0.0
    for item in range(3):
        _apply(DERIVATIVE, table, U + item, 2.0 / length, 0.0, CHANGE + item)
    for point in range(POINTS):
        at, heading, inverse = time + SHARES[point] * length, table[HEADING, point], work.inverses[point]
        place = (table[X, point], table[Y, point], math.cos(heading), math.sin(heading), at)
        drive = drive_at(work.segment, at, model.lag)
        u, v, r = table[U, point], table[U + 1, point], table[U + 2, point]
        if renew:
            slopes(u, v, r, drive, place, model.rest_speed, model, work.contacts, bent)
            gained = bent[0, 0], bent[0, 1], bent[0, 2]
            if not invert3(bent[1:4], inverse):
                return math.inf
        else:
            gained = accelerations(u, v, r, drive, place, model.rest_speed, model, work.contacts)
        a_u, a_v = gained[0] - table[CHANGE, point], gained[1] - table[CHANGE + 1, point]
        a_r = gained[2] - table[CHANGE + 2, point]
        for row in range(3):
            change = inverse[row, 0] * a_u + inverse[row, 1] * a_v + inverse[row, 2] * a_r
            table[U + row, point] -= change
            largest = max(largest, (LEVER_MM if row == 2 else 1.0) * abs(change))
    return largest


@compiled()
def cut_off(length: float, table: Any) -> float:
    """Truncation error of the polynomials, as displacement in mm, from their last Chebyshev coefficients."""
    largest = 0.0
    for row in (U + 2, X_RATE, Y_RATE):
        last, before = 0.0, 0.0
        for point in range(POINTS):
            last += table[row, point] * TO_POWERS[point, POINTS - 1]
            before += table[row, point] * TO_POWERS[point, POINTS - 2]
        size = max(abs(last) / 2.0 ** (POINTS - 2), 0.1 * abs(before) / 2.0 ** (POINTS - 3))
        largest = max(largest, (LEVER_MM if row == U + 2 else 1.0) * size)
    return largest * length


@compiled()
def _stays(end: float, tolerance: float, model: Any, work: Any) -> bool:
    """Whether the manifold found is the one that the velocity was near, and is still attracting at the end."""
    table, last, away = work.table, POINTS - 1, work.spare[0]
    for row in range(3):
        away[row] = table[U + row, 0] - work.y[3 + row]
    if not close(away, 2.0 * tolerance, is_off(end, model, work), model, work):
        return False
    heading, drive = table[HEADING, last], drive_at(work.segment, end, model.lag)
    place = (table[X, last], table[Y, last], math.cos(heading), math.sin(heading), end)
    u, v, r = table[U, last], table[U + 1, last], table[U + 2, last]
    slopes(u, v, r, drive, place, model.rest_speed, model, work.contacts, work.bent)
    return is_stable(work.bent)


@compiled()
def _speed(work: Any) -> float:
    """Size of the velocity at the start of a step, mm/s."""
    return float(abs(work.y[3]) + abs(work.y[4]) + LEVER_MM * abs(work.y[5]))


@compiled()
def collocate(time: float, length: float, tolerance: float, model: Any, work: Any) -> tuple[bool, float]:
    """Fill the table for a step from work.y at twist 0; returns whether it is accurate, and the next length to try.

    work.inverse holds the inverse of the derivative of the accelerations by velocity.
    """
    _guess(time, length, model, work)
    before, enough, used, renew = math.inf, SWEPT_SHARE * tolerance / length, 0, False
    while used < MOST_SWEEPS:
        follow(length, work)
        change = sweep(time, length, renew, model, work)
        used += 1
        renew = used == 1 and model.wheels_vary_with_velocity == 0  # after it, the derivatives are close enough
        if renew and change > FAR_SHARE * _speed(work):
            _march(time, length, model, work)
            renew = False
            continue
        if not change <= LEAST_GAIN * before or cut_off(length, work.table) > 100.0 * CUT_SHARE * tolerance:
            return False, 0.3 * length
        if before < math.inf and change * change <= enough * before:
            break
        before = change
    follow(length, work)
    if used == MOST_SWEEPS or not _stays(time + length, tolerance, model, work):
        return False, 0.3 * length
    factor = 0.9 * (CUT_SHARE * tolerance / (cut_off(length, work.table) + 1e-300)) ** (1.0 / POINTS)
    return factor > 0.9, length * min(2.0, max(0.3, factor))


@compiled()
def long_step(
    time: float, remaining: float, longest: float, short: float, tolerance: float, model: Any, work: Any
) -> tuple[bool, float, float]:
    """Take the longest possible step; returns whether one was possible, its length (or the last tried), the next one.

    longest: length to begin with. short: length of the next short step, 0 if unknown. The remaining time is divided
    into equal steps.
    """
    least = max(SHORTEST_COLLOCATION_S, COST * short)
    longest = min(max(longest, least), remaining, LONGEST_TURN_RAD / (abs(work.y[5]) + 1e-3))
    length = longest
    while longest >= least:
        length = remaining / math.ceil(remaining / longest - 1e-9)
        accurate, longest = collocate(time, length, tolerance, model, work)
        if accurate:
            return True, length, longest
    return False, length, length


@compiled()
def go_to_end(work: Any) -> None:
    """Move the run to the end of the step in the table."""
    last = POINTS - 1
    for item in range(3):
        work.pose[item] = work.table[X + item, last]
        work.y[item], work.y[3 + item] = 0.0, work.table[U + item, last]


@compiled(fastmath={"contract"})
def _write(
    out: Any, column: int, times: Any, rows: tuple[int, int], time: float, length: float, table: Any, powers: int
) -> None:
    """Write a column of outputs: the polynomial with the coefficients of a row."""
    for row in range(rows[0], rows[1]):
        at = 2.0 * (times[row] - time) / length - 1.0
        value = table[powers, POINTS - 1]
        for power in range(POINTS - 2, -1, -1):
            value = value * at + table[powers, power]
        out[row, column] = value


@compiled(fastmath={"contract"})
def _write_integral(
    out: Any, column: int, times: Any, rows: tuple[int, int], time: float, length: float, table: Any, powers: int
) -> None:
    """Write a column of outputs: its initial value plus the integral of the polynomial, whose coefficients are lost."""
    start = 0.0
    for power in range(POINTS):
        table[powers, power] *= 0.5 * length / (power + 1)
        start += table[powers, power] * (1.0 if power % 2 == 0 else -1.0)
    start += table[X + column, 0]
    for row in range(rows[0], rows[1]):
        at = 2.0 * (times[row] - time) / length - 1.0
        value = table[powers, POINTS - 1]
        for power in range(POINTS - 2, -1, -1):
            value = value * at + table[powers, power]
        out[row, column] = start + at * value


@compiled()
def write_polynomials(out: Any, times: Any, rows: tuple[int, int], time: float, length: float, table: Any) -> None:
    """Write the outputs within a step; rows: first and last (excluded)."""
    if rows[0] == rows[1]:
        return
    for item in range(3):
        _apply(TO_POWERS, table, U + item, 1.0, 0.0, POWERS + item)
        _write(out, 3 + item, times, rows, time, length, table, POWERS + item)
    _apply(TO_POWERS, table, counter(X_RATE), 1.0, 0.0, counter(POWERS))
    _apply(TO_POWERS, table, counter(Y_RATE), 1.0, 0.0, counter(POWERS + 1))
    for item in range(3):
        _write_integral(out, item, times, rows, time, length, table, POWERS + item)
