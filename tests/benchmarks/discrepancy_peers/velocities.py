"""Velocities in the frame of the marks, measured less nominal: what SINDy and Gaussian processes are fitted to.

Weak form: a velocity is the integral of a test function over a window times the motion between frames, turned into the
frame of the marks. Nothing is differentiated; gaps do no harm. Source: Messenger & Bortz (2021), J. Comput. Phys. 443,
110525. Rows hold along mm/s, sideways mm/s, and yaw rate times half the distance of the marks, mm/s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tests.benchmarks.discrepancy_peers.inputs import Floats, Inputs, turned

WINDOW_S = 0.5
STRIDE_S = 0.25
FEWEST = 8  # motions between frames in a window
PICARD = 3  # passes over a path whose correction depends on where it leads
RUN_OUT_S = 0.3  # motors that lag still turn after their stop


@dataclass(frozen=True)
class Moment:
    """Where and how a run is between its frames, arrays (n,): what a discrepancy may depend on.

    along, sideways, yaw: nominal velocities, mm/s, mm/s, rad/s; turns: radians that the wheels have turned.
    """

    x_mm: Floats
    y_mm: Floats
    heading_rad: Floats
    along: Floats
    sideways: Floats
    yaw: Floats
    left_rpm: Floats
    right_rpm: Floats
    since_s: Floats
    turns: Floats
    order: Floats


Features = Callable[[Moment], Floats]  # (n, p)
Correction = Callable[[Moment], Floats]  # (n, 3), added to the nominal velocities, in the units of the rows above


@dataclass(frozen=True)
class Pieces:
    """Windows of runs: features (n, p), discrepancy (n, 3), number of the run (n,)."""

    features: Floats
    discrepancy: Floats
    run: Floats


def pieces(inputs: Inputs, runs: Sequence[int], features: Features) -> Pieces:
    """Windows of the measured runs, less the nominal model at the same frames."""
    parts = [windows(inputs, run, inputs.measured(run), features) for run in runs]
    return Pieces(
        np.concatenate([a for a, _ in parts]),
        np.concatenate([b for _, b in parts]),
        np.concatenate([np.full(len(a), run) for run, (a, _) in zip(runs, parts, strict=True)]),
    )


def windows(inputs: Inputs, run: int, path: Floats, features: Features) -> tuple[Floats, Floats]:
    """Features (n, p) and discrepancy (n, 3) of the windows of one path against the nominal one."""
    data, nominal = inputs.session.data[run], inputs.simulated(run)
    known = np.isfinite(path).all(axis=1) & np.isfinite(nominal).all(axis=1)
    time, path, nominal = data.time_s[known], path[known], nominal[known]
    step = _motion(path, inputs.half_mm) - _motion(nominal, inputs.half_mm)
    at = moment(inputs, run, time, _middle(path), nominal)
    values, middle, lasts = features(at), (time[1:] + time[:-1]) / 2, np.diff(time)
    begin, end = _moving(inputs, run, time)
    found = []
    for first in np.arange(begin - STRIDE_S, end - WINDOW_S, STRIDE_S):
        share = (middle - first) / WINDOW_S * 2 - 1
        weight = np.where(np.abs(share) < 1, (1 - share**2) ** 2, 0.0)
        if np.count_nonzero(weight) >= FEWEST:
            area = weight @ lasts
            found.append(np.concatenate([(weight * lasts) @ values, weight @ step]) / area)
    rows = np.array(found).reshape(-1, values.shape[1] + 3)
    return rows[:, :-3], rows[:, -3:]


def corrected_path(inputs: Inputs, run: int, start: Floats, correction: Correction) -> Floats:
    """Path (n, 3) from a start pose (3,): nominal velocities and what is added to them."""
    data, nominal = inputs.session.data[run], inputs.simulated(run)
    lasts = np.diff(data.time_s)[:, None]
    base, path = _motion(nominal, inputs.half_mm), nominal
    begin, end = _moving(inputs, run, data.time_s)
    middle = (data.time_s[1:] + data.time_s[:-1]) / 2
    moves = ((middle >= begin) & (middle <= end))[:, None]
    path = _integrated(base, start, inputs.half_mm)
    for _ in range(PICARD):
        added = correction(moment(inputs, run, data.time_s, _middle(path), nominal))
        path = _integrated(base + np.where(moves, added * lasts, 0.0), start, inputs.half_mm)
    return path


def moment(inputs: Inputs, run: int, time: Floats, place: Floats, nominal: Floats) -> Moment:
    """The moments between frames of a path whose middles (n, 3) are given; nominal: path (n + 1, 3)."""
    data = inputs.session.data[run]
    speeds = _motion(nominal, 1.0) / np.diff(time)[:, None]
    middle = (time[1:] + time[:-1]) / 2
    since = np.maximum(middle - data.start_s, 0.0)
    on = (middle >= data.start_s) & (middle <= (data.stop_s or np.inf))
    mean_rpm = (abs(data.left_rpm) + abs(data.right_rpm)) / 2
    return Moment(
        place[:, 0],
        place[:, 1],
        place[:, 2] - data.line_rad,
        speeds[:, 0],
        speeds[:, 1],
        speeds[:, 2],
        np.where(on, data.left_rpm, 0.0),
        np.where(on, data.right_rpm, 0.0),
        since,
        mean_rpm * np.pi / 30 * since,
        np.full(len(middle), float(data.order)),
    )


def signatures(
    inputs: Inputs, runs: Sequence[int], features: Features, offers: Mapping[str, Sequence[tuple[float, ...]]]
) -> dict[str, Floats]:
    """What small effects do to the discrepancies of these runs, (n, 3, k) by the label of an offer."""
    found = {}
    for label, places in offers.items():
        effect = label.split(" ")[0]
        columns = []
        for values in places:
            paths = [inputs.simulated(run, {effect: values}) for run in runs]
            columns.append(
                np.concatenate([windows(inputs, run, p, features)[1] for run, p in zip(runs, paths, strict=True)])
            )
        found[label] = np.stack(columns, axis=-1)
    return found


def _motion(path: Floats, half_mm: float) -> Floats:
    """Motion (n - 1, 3) between frames in the frame of the marks, lengths all."""
    step, turn = np.diff(path[:, :2], axis=0), np.diff(path[:, 2])
    heading = (path[1:, 2] + path[:-1, 2]) / 2 - np.pi / 2
    return np.column_stack([turned(-heading, step), turn * half_mm])


def _integrated(motion: Floats, start: Floats, half_mm: float) -> Floats:
    angle = start[2] + np.concatenate([[0.0], np.cumsum(motion[:, 2])]) / half_mm
    heading = (angle[1:] + angle[:-1]) / 2 - np.pi / 2
    place = start[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(turned(heading, motion[:, :2]), axis=0)])
    return np.column_stack([place, angle])


def _middle(path: Floats) -> Floats:
    return (path[1:] + path[:-1]) / 2


def _moving(inputs: Inputs, run: int, time: Floats) -> tuple[float, float]:
    """From when to when a run may move, s."""
    data = inputs.session.data[run]
    stop = time[-1] if data.stop_s is None else min(data.stop_s + RUN_OUT_S, time[-1])
    return max(float(data.start_s), float(time[0])), float(stop)
