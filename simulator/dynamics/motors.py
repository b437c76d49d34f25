"""Rotation of the motors between two breaks of the command, with limits, dead band, dead time and lag.

A segment is a row of numbers. Within it the rotational frequency of each side is a + b·t + e·exp(-t/lag) in rpm, with
t from the start of the segment, and the angle that the motor has turned follows in closed form.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.compilation import compiled, counter

# Columns of a segment. Per side: constant, slope, exponential (rpm), angle at the start (rad).
BEGIN, END, STEADY, LEFT, RIGHT, COLUMNS = 0, 1, 2, 3, 7, 11
RAD_PER_REVOLUTION_MINUTE = 2 * math.pi / 60
# Time constants after which an exponential is neglected: exp(-36) is the rounding error of a double.
LASTING_LAGS = 36.0
ROUNDED = 1e-12  # relative difference below which a ramped command counts as equal to its target


@compiled()
def drive_at(segment: Any, time: float, lag: float) -> tuple[float, float, float, float]:
    """Left and right rpm and the angles the motors have turned, rad, at a time within the segment."""
    since = time - segment[BEGIN]
    left, right = segment[LEFT], segment[RIGHT]
    if segment[STEADY] == 1.0:
        turned = RAD_PER_REVOLUTION_MINUTE * since
        return left, right, segment[LEFT + 3] + turned * left, segment[RIGHT + 3] + turned * right
    left_angle = left * since + 0.5 * segment[LEFT + 1] * since * since
    right_angle = right * since + 0.5 * segment[RIGHT + 1] * since * since
    left += segment[LEFT + 1] * since
    right += segment[RIGHT + 1] * since
    if lag > 0.0:
        fading = math.exp(-since / lag)
        left += segment[LEFT + 2] * fading
        right += segment[RIGHT + 2] * fading
        left_angle += segment[LEFT + 2] * lag * (1 - fading)
        right_angle += segment[RIGHT + 2] * lag * (1 - fading)
    return (
        left,
        right,
        segment[LEFT + 3] + RAD_PER_REVOLUTION_MINUTE * left_angle,
        segment[RIGHT + 3] + RAD_PER_REVOLUTION_MINUTE * right_angle,
    )


@compiled()
def command_segments(knots: Any, begin: float, end: float, model: Any) -> Any:
    """Segments (n, COLUMNS) of a command from begin to end.

    knots: (k, 3) time, left and right rpm. The motors start settled at the first value.
    """
    knots = _ramped(_drive_commands(knots, model.mix, model.limits), model.ramps)
    count = len(knots)
    segments = np.zeros((12 * (count + 2), COLUMNS))
    used = counter(0)
    lagged = np.zeros(2)
    turned = np.zeros(2)
    cuts = np.empty(8)
    for side in range(2):
        lagged[side] = _banded(knots[0, 1 + side], model.dead_band)
    for piece in range(-1, count):
        low = -np.inf if piece < 0 else knots[piece, 0] + model.dead_time
        high = np.inf if piece == count - 1 else knots[piece + 1, 0] + model.dead_time
        if high <= low or low >= end:
            continue
        cutting = _cuts(knots, piece, low, high, model.dead_band, cuts)
        for part in range(cutting - 1):
            start, stop = cuts[part], min(cuts[part + 1], end)
            if stop <= start:
                continue
            used = _add_part(segments, used, knots, piece, low, start, stop, begin, lagged, turned, model)
    return segments[:used]


@compiled()
def _drive_commands(knots: Any, mix: Any, limits: Any) -> Any:
    """Knots after the drive has mixed both sides and limited them.

    mix (8,), limits (3,): see simulator.effects.draft.Draft.
    """
    wheel, ahead, turn = limits[0], limits[1], limits[2]
    commands = np.empty((len(knots), 3))
    for row in range(len(knots)):
        left, right = knots[row, 1], knots[row, 2]
        commands[row, 0] = knots[row, 0]
        for side in range(2):
            more = mix[4 * side] * left + mix[4 * side + 1] * right
            more += mix[4 * side + 2] * abs(left) + mix[4 * side + 3] * abs(right)
            commands[row, 1 + side] = knots[row, 1 + side] + more
        left, right = commands[row, 1], commands[row, 2]
        if max(abs(left), abs(right)) > min(wheel, ahead, turn):  # no part exceeds the larger side
            common, half = _within(0.5 * (left + right), ahead), _within(0.5 * (right - left), turn)
            commands[row, 1], commands[row, 2] = _within(common - half, wheel), _within(common + half, wheel)
    return commands


@compiled()
def _ramped(knots: Any, ramps: Any) -> Any:
    """Knots after the drive has limited how fast the sides change: their mean, half their difference, then each wheel.

    ramps (3,): s per rpm, of the mean, of half of the difference and of each wheel; 0 without a limit.
    """
    each = np.empty(2)
    if ramps[0] > 0.0 or ramps[1] > 0.0:
        parts = knots.copy()
        for row in range(len(knots)):
            left, right = knots[row, 1], knots[row, 2]
            parts[row, 1], parts[row, 2] = 0.5 * (left + right), 0.5 * (right - left)
        each[:] = ramps[:2]
        knots = _followed(parts, each)
        for row in range(len(knots)):
            common, half = knots[row, 1], knots[row, 2]
            knots[row, 1], knots[row, 2] = common - half, common + half
    if ramps[2] > 0.0:
        each[:] = ramps[2]
        knots = _followed(knots, each)
    return knots


@compiled()
def _followed(knots: Any, ramps: Any) -> Any:
    """Two parts that change by 1 rpm in at least ramps (2,), s, and their targets at knots: (k, 3) time and parts, rpm.

    Each part approaches its target at the limit and follows it from the time at which it reaches it. The result (n, 3)
    is piecewise linear: new knots arise where a part reaches its target.
    """
    count = len(knots)
    # For each piece its beginning, its end, and the times at which both parts reach their targets; before them the
    # first knot, which holds until then: a part without a limit jumps from it at once, and not before.
    bent = np.empty((4 * count + 1, 3))
    target, slope, part, speed = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    bent[0] = knots[0]
    used = counter(1)
    part[:] = knots[0, 1:]
    for piece in range(count):
        at, last = knots[piece, 0], piece == count - 1
        end = np.inf if last else knots[piece + 1, 0]
        if end <= at:
            continue
        target[:] = knots[piece, 1:]
        slope[:] = 0.0
        if not last:
            for k in range(2):
                slope[k] = (knots[piece + 1, 1 + k] - target[k]) / (end - at)
        while at < end:
            meeting = end - at
            for k in range(2):
                speed[k], soon = _nearing(target[k] - part[k], ROUNDED * (1.0 + abs(target[k])), slope[k], ramps[k])
                if soon > 0.0:
                    meeting = min(meeting, soon)
                else:
                    part[k] = target[k]
            bent[used, 0], bent[used, 1], bent[used, 2] = at, part[0], part[1]
            used += 1
            if meeting == np.inf:
                break
            for k in range(2):
                target[k] += slope[k] * meeting
                part[k] += speed[k] * meeting
            at = at + meeting if meeting < end - at else end
        if not last:
            bent[used, 0], bent[used, 1], bent[used, 2] = end, part[0], part[1]
            used += 1
    return bent[:used]


@compiled()
def _nearing(off: float, rounding: float, slope: float, ramp: float) -> tuple[float, float]:
    """Rate of a part that differs from its target by off, and the time until it reaches it; 0 if it follows it."""
    if ramp <= 0.0 or (abs(off) <= rounding and abs(slope) * ramp <= 1.0):
        return slope, 0.0
    if abs(off) <= rounding:
        return (1.0 if slope > 0.0 else -1.0) / ramp, np.inf
    speed = (1.0 if off > 0.0 else -1.0) / ramp
    nearing = (speed - slope) / off
    return speed, 1.0 / nearing if nearing > 0.0 else np.inf


@compiled()
def held_drive(left: float, right: float, model: Any) -> tuple[float, float]:
    """Rotational frequencies, rpm, at which the motors settle under a constant command."""
    commands = _drive_commands(np.array([[0.0, left, right]]), model.mix, model.limits)
    return _banded(commands[0, 1], model.dead_band), _banded(commands[0, 2], model.dead_band)


@compiled()
def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@compiled()
def _banded(rpm: float, dead_band: float) -> float:
    return 0.0 if abs(rpm) < dead_band else rpm


@compiled()
def _slope(knots: Any, piece: int, side: int) -> float:
    if piece < 0 or piece == len(knots) - 1:
        return 0.0
    return float((knots[piece + 1, 1 + side] - knots[piece, 1 + side]) / (knots[piece + 1, 0] - knots[piece, 0]))


@compiled()
def _cuts(knots: Any, piece: int, low: float, high: float, dead_band: float, cuts: Any) -> int:
    """Split a piece into parts in which no side crosses the edge of the dead band; returns the number of edges."""
    used = 1
    cuts[0] = low
    if dead_band > 0.0:
        for side in range(2):
            slope = _slope(knots, piece, side)
            for edge in (-dead_band, dead_band):
                if slope != 0.0:
                    crossing = low + (edge - knots[piece, 1 + side]) / slope
                    if low < crossing < high:
                        cuts[used] = crossing
                        used += 1
    cuts[used] = high
    for later in range(1, used + 1):  # insertion sort of at most six edges, mostly in order
        place = later
        while place > 0 and cuts[place] < cuts[place - 1]:
            cuts[place], cuts[place - 1] = cuts[place - 1], cuts[place]
            place -= 1
    return used + 1


@compiled()
def _add_part(
    segments: Any,
    used: int,
    knots: Any,
    piece: int,
    low: float,
    start: float,
    stop: float,
    begin: float,
    lagged: Any,
    turned: Any,
    model: Any,
) -> int:
    """Append one part, split where its exponential has decayed; lagged and turned are updated to its end."""
    row = segments[used]
    lag = model.lag
    length = stop - start
    row[STEADY] = 1.0
    for side in range(2):
        column = LEFT if side == 0 else RIGHT
        slope = _slope(knots, piece, side)
        value = knots[max(piece, 0), 1 + side]
        if math.isinf(start):  # before the first knot the motors are settled
            row[column] = lagged[side]
            continue
        value += slope * (start - low)
        if abs(value + 0.5 * slope * min(length, 1e6)) < model.dead_band:
            value, slope = 0.0, 0.0
        row[column], row[column + 1] = value - slope * lag, slope
        row[column + 2] = lagged[side] - row[column] if lag > 0.0 else 0.0
        fading = math.exp(-length / lag) if lag > 0.0 else 0.0
        lagged[side] = row[column] + slope * length + row[column + 2] * fading
        if slope != 0.0 or row[column + 2] != 0.0:
            row[STEADY] = 0.0
    if stop <= begin:
        for column in range(COLUMNS):
            row[column] = 0.0
        return used
    if start < begin:
        _advance(row, begin - start if not math.isinf(start) else 0.0, lag)
    row[BEGIN], row[END] = max(start, begin), stop
    row[LEFT + 3], row[RIGHT + 3] = turned[0], turned[1]
    faded = row[BEGIN] + LASTING_LAGS * lag
    if row[STEADY] == 0.0 and lag > 0.0 and faded < stop:
        following = segments[used + 1]
        for column in range(COLUMNS):
            following[column] = row[column]
        row[END] = faded
        drive = drive_at(row, faded, lag)
        _advance(following, faded - row[BEGIN], lag)
        following[BEGIN], following[LEFT + 2], following[RIGHT + 2] = faded, 0.0, 0.0
        following[LEFT + 3], following[RIGHT + 3] = drive[2], drive[3]
        following[STEADY] = 1.0 if following[LEFT + 1] == 0.0 and following[RIGHT + 1] == 0.0 else 0.0
        used += 1
        row = following
    drive = drive_at(row, stop, lag)
    turned[0], turned[1] = drive[2], drive[3]
    return used + 1


@compiled()
def _advance(row: Any, by: float, lag: float) -> None:
    """Shift the start of a segment's formulas to a later time."""
    for column in (LEFT, RIGHT):
        row[column] += row[column + 1] * by
        if lag > 0.0:
            row[column + 2] *= math.exp(-by / lag)
