"""From runs to a fit problem: noise of every run, and compression to a few features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.candidates.coordinates import size_of
from evaluator.diagnosis.candidates.free_form import wheel_friction
from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.watch import Watch
from evaluator.diagnosis.likelihood.features import (
    MODEL_FLOOR_MM,
    Compression,
    channel_noise,
    channel_residual,
    channels_of,
    compression,
    residual_spectra,
)
from evaluator.diagnosis.likelihood.linear.mixed_model import USUAL_SCATTER
from evaluator.diagnosis.likelihood.noise.discrepancy import left_over, with_discrepancy
from evaluator.diagnosis.likelihood.noise.drift import with_drift
from evaluator.diagnosis.likelihood.noise.friction_wander import MODES, wander_shifts, whitening
from evaluator.diagnosis.likelihood.noise.late_changes import jumps_of, late_changes
from evaluator.diagnosis.likelihood.noise.outliers import CHANNELS, without_outliers
from evaluator.diagnosis.likelihood.noise.smoothing import (
    AROUND_WINDOW,
    PREDICTED_FRAMES,
    UNSETTLED_FRAMES,
    averaged_frames,
    smoothed_over,
)
from evaluator.diagnosis.likelihood.noise.tracking import Drift, Noise
from evaluator.diagnosis.likelihood.noise.wheel_bands import wheel_bands
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.problem import FRICTION, Problem
from evaluator.diagnosis.likelihood.run_data import (
    PER_RUN,
    START_POSE,
    Forward,
    NotSimulatedError,
    RunData,
    aligned_starts,
)
from evaluator.robot_geometry import wheel_paths

Floats = NDArray[np.float64]

NO_DISTANCE_MM = 1e9  # noise of a distance that was not measured
SETTLING_S = 0.4  # a larger lag of the motors would be found as an effect first


def build_problem(
    data: Sequence[RunData],
    forward: Forward,
    fits: FitCache | None = None,
    watch: Watch | None = None,
    change_sigma_s: float = 0.0,
) -> tuple[Problem, Point]:
    """Estimate the tracking noise and compress every run; also returns the nominal point with aligned starts.

    fits: cache of an interrupted diagnosis of the same data. watch: cancellation and time limit. change_sigma_s:
    standard deviation of the time of each change of a command after the start.
    """
    channels = tuple(channels_of(run.marks_mm) for run in data)
    half = float(np.nanmedian(np.concatenate([item[:, 3] for item in channels]))) / 2
    length = max(size_of(robot).length for robot in forward.robots)
    bare = Problem(
        *(tuple(data), forward, channels, (), (), half, length),
        change_sigma_s=change_sigma_s,
        fits=fits or FitCache(),
        watch=watch or Watch(),
    )
    point = Point(aligned_starts(data, forward))
    return with_noise_of(_without_averaged_frames(bare, point), point), point


def _drifting(parts: tuple[Noise, ...], drift: Drift, axes: int) -> tuple[Noise, ...]:
    """The noise of all channels of a run, with a drift of the first ones in proportion to their noise."""
    shares = [part.sigma_mm / parts[0].sigma_mm if place > 1 else 1.0 for place, part in enumerate(parts[:axes])]
    first = (replace(part, common_drift=drift.scaled(k)) for part, k in zip(parts[:axes], shares, strict=True))
    return (*first, *parts[axes:])


def _without_averaged_frames(problem: Problem, point: Point) -> Problem:
    """The problem without frames that average over a change of the motion: see noise/smoothing.py.

    On open ground poses are filtered as well, but a frame of them moves the robot by less than the ground does.
    """
    if problem.open_ground:
        return problem
    filmed = [PREDICTED_FRAMES if run.filmed else 0 for run in problem.data]
    problem = replace(problem, channels=_away_from_changes(problem, filmed))
    settled = replace(problem, channels=_away_from_changes(problem, [UNSETTLED_FRAMES] * len(problem.data)))
    residuals = settled.residuals([point.task(run) for run in range(len(problem.data))])
    spectra = [
        item
        for run, left in zip(problem.data, residuals, strict=True)
        if np.isfinite(left).all(axis=1).sum() > 1
        for item in residual_spectra(run.time_s, left, run.start_s + SETTLING_S)[:2]
    ]
    window = smoothed_over(spectra)
    if not window:
        return problem
    channels = _away_from_changes(problem, [window // 2 + AROUND_WINDOW] * len(problem.data), ends=True)
    return replace(problem, channels=channels, smoothed_over=window)


def _away_from_changes(problem: Problem, frames: Sequence[int], *, ends: bool = False) -> tuple[Floats, ...]:
    """Channels (n, c) of each run, NaN within some frames of a change of its command; all of them for 0 frames.

    ends: also of the ends of a recording, where a window is cut off and its middle is behind or ahead.
    """
    found = []
    for run, item, reach in zip(problem.data, problem.channels, frames, strict=True):
        near = np.zeros(len(item), dtype=np.bool_)
        if reach:
            changes = [run.start_s, *jumps_of(run.run_command.command)]
            changes += [float(run.time_s[0]), float(run.time_s[-1])] if ends else []
            near = averaged_frames(run.time_s, changes, reach)
        found.append(np.where(near[:, None], np.nan, item) if near.any() else item)
    return tuple(found)


def with_noise_of(problem: Problem, point: Point) -> Problem:
    """The problem with noise estimated from the residuals at a point, and every run compressed accordingly.

    Frames in which the residual jumps and returns are ignored from then on, as tracking errors. Raises
    NotSimulatedError if runs cannot be simulated at the point.
    """
    residuals = problem.residuals([point.task(run) for run in range(len(problem.data))])
    failed = [run.id for run, item in zip(problem.data, residuals, strict=True) if not np.isfinite(item).any()]
    if failed:
        raise NotSimulatedError(failed)
    cleaned = [without_outliers(item, CHANNELS, corners=problem.open_ground) for item in residuals]
    jumps = [np.isnan(new) & np.isfinite(old) for new, old in zip(cleaned, residuals, strict=True)]
    seen = (
        np.where(np.any(jump, axis=1, keepdims=True), np.nan, item)
        for item, jump in zip(problem.channels, jumps, strict=True)
    )
    problem, residuals = replace(problem, channels=tuple(seen)), cleaned
    frames = [problem.counting_frames(run) for run in range(len(problem.data))]
    ends = [int(np.flatnonzero(used)[-1]) + 1 for used in frames]
    bands = [  # on open ground the noise contains all that the model leaves
        () if problem.open_ground else wheel_bands(run.run_command.command, run.time_s[:end], item[:end, 2])
        for run, item, end in zip(problem.data, problem.channels, ends, strict=True)
    ]
    noise = channel_noise(
        [
            residual_spectra(run.time_s[:end], item[:end], run.start_s + SETTLING_S, near)
            for run, item, end, near in zip(problem.data, residuals, ends, bands, strict=True)
        ]
    )
    rigid = [np.zeros_like(used) if run.from_poses else used for run, used in zip(problem.data, frames, strict=True)]
    times, marks = [run.time_s for run in problem.data], [run.marks_mm for run in problem.data]
    noise = with_drift(noise, times, rigid, residuals, marks, problem.field_of_view)
    noise = [_drifting(parts, problem.common_drift, problem.drifting_axes) for parts in noise]
    noise = [
        (*parts[:3], replace(parts[3], white_mm=NO_DISTANCE_MM)) if run.from_poses else parts
        for run, parts in zip(problem.data, noise, strict=True)
    ]
    if problem.open_ground:
        noise = with_discrepancy(noise, [run.time_s for run in problem.data], _left_over(problem, point))
    compressions = tuple(
        compression(run.time_s, used, parts, problem.length * MODEL_FLOOR_MM, near)
        for run, used, parts, near in zip(problem.data, frames, noise, bands, strict=True)
    )
    problem = replace(problem, compressions=compressions, noise=tuple(noise))
    return _with_random_shifts(problem, point)


def _with_random_shifts(problem: Problem, point: Point) -> Problem:
    """The problem with features whitened for varying friction and late changes of commands, linearized at a point."""
    runs = range(len(problem.data))
    late = late_shifts(problem, point, runs) if problem.friction_wander or problem.change_sigma_s else ()
    if not problem.friction_wander and not any(map(len, late)):
        return problem
    found: list[Compression] = []
    for part, (known, wander), more in zip(
        problem.compressions, friction_shifts(problem, point, runs), late, strict=True
    ):
        walk = problem.friction_wander
        shifts = np.concatenate([walk * wander, more]) if walk else more
        random = bool(len(shifts))
        ground = whitening(part.of_tracking(shifts).T) if random else None
        found.append(replace(part, ground=ground, random_mm=_midpoint_about(part, shifts, known) if random else 0.0))
    return replace(problem, compressions=tuple(found))


def late_shifts(problem: Problem, point: Point, runs: Sequence[int]) -> list[Floats]:
    """Shifts (k, n, 4) in mm of the channels of each run at the used frames by one sigma of each late change.

    None on open ground, whose noise contains them, and for a run that cannot be simulated at the point.
    """
    none = [np.zeros((0, problem.compressions[run].used.sum(), 4)) for run in runs]
    if problem.open_ground or not problem.change_sigma_s:
        return none
    changes_s = [jumps_of(problem.data[run].run_command.command) for run in runs]
    if not any(changes_s):
        return none
    found = []
    marks = problem.forward.marks([point.task(run) for run in runs])
    for run, at_s, predicted, nothing in zip(runs, changes_s, marks, none, strict=True):
        if not at_s or not np.isfinite(predicted).all():
            found.append(nothing)
            continue
        shifts = late_changes(problem.data[run].time_s, channels_of(predicted), at_s, problem.half_distance_mm)
        found.append(problem.change_sigma_s * shifts[:, problem.compressions[run].used])
    return found


def friction_shifts(problem: Problem, point: Point, runs: Sequence[int]) -> list[tuple[Floats, Floats]]:
    """Shifts of the channels of each run at the used frames, mm: by fitted quantities, and by varying friction.

    The first, (7, n, 4): start x, y, heading and the random effects, each changed by one unit. The second: see
    wander_shifts. Zeros for a run that cannot be simulated at the point.
    """
    steps, half = problem.per_run_steps, problem.half_distance_mm
    friction = float(steps[FRICTION])
    found = []
    for run in runs:
        robot, used = problem.forward.robots[run], problem.compressions[run].used
        wheels = wheel_friction(len(robot.wheel_positions_mm()))
        tasks = [point.task(run, step) for step in (None, *np.diag(steps)[START_POSE:])]
        tasks += [replace(point, terms={**point.terms, wheel.id: (friction,)}).task(run) for wheel in wheels]
        base, *changed = problem.forward.marks(tasks)
        if np.isnan(base).all():
            found.append((np.zeros((PER_RUN, used.sum(), 4)), np.zeros((MODES, used.sum(), 4))))
            continue
        channels = channels_of(base)
        moved = [channel_residual(channels_of(part), channels, half) for part in changed]
        random, by_wheel = moved[: PER_RUN - START_POSE], moved[PER_RUN - START_POSE :]
        known = np.zeros((PER_RUN, *channels.shape))
        known[0, :, 0] = known[1, :, 1] = 1.0
        known[2, :, :3] = np.column_stack([-channels[:, 1], channels[:, 0], np.full(len(channels), half)])
        known[START_POSE:] = [part / step for part, step in zip(random, steps[START_POSE:], strict=True)]
        wheels_mm = wheel_paths(robot, base)
        wander = wander_shifts(channels, [np.nan_to_num(part / friction) for part in by_wheel], wheels_mm, half)
        found.append((np.nan_to_num(known[:, used]), np.nan_to_num(wander[:, used])))
    return found


def _midpoint_about(part: Compression, shifts: Floats, known: Floats) -> float:
    """RMS of random shifts (k, n, 4) of the midpoint, mm, after a fit of shifts (7, n, 4): see friction_shifts.

    Weighted by the tracking noise, with the usual scatter of the random effects, as the gap of a run is found: a robot
    that hardly turns would otherwise have twice its friction.
    """
    prior = np.diag([0.0] * START_POSE + [1 / scatter for scatter in USUAL_SCATTER])
    fitted = np.vstack([part.of_tracking(known).T, prior])
    random = np.vstack([part.of_tracking(shifts).T, np.zeros((len(prior), len(shifts)))])
    left = shifts - np.tensordot(np.linalg.lstsq(fitted, random, rcond=None)[0].T, known, 1)
    return float(np.sqrt(np.sum(left[:, :, :2] ** 2) / shifts.shape[1]))


def within_horizon(problem: Problem, point: Point, horizon_s: float) -> Problem:
    """The problem of the first seconds of every run, with noise estimated from the residuals at a point.

    Later frames are not simulated, which saves most of the time.
    """
    short = replace(problem, horizon_s=horizon_s)
    frames = [int(np.flatnonzero(short.counting_frames(run))[-1]) + 1 for run in range(len(problem.data))]
    data = tuple(run.first(count) for run, count in zip(problem.data, frames, strict=True))
    channels = tuple(item[:count] for item, count in zip(problem.channels, frames, strict=True))
    return with_noise_of(replace(short, data=data, channels=channels, forward=problem.forward.of_frames(data)), point)


def _left_over(problem: Problem, point: Point) -> Floats:
    """Residuals of every run with the common parameters of a point, (runs, 2) mm: see discrepancy.left_over."""
    same = replace(point, per_run=point.per_run * (np.arange(PER_RUN) < START_POSE))
    marks = problem.forward.marks([same.task(run) for run in range(len(problem.data))])
    pairs = zip(problem.channels, marks, strict=True)
    left = np.array([left_over(seen, channels_of(part), problem.half_distance_mm) for seen, part in pairs])
    return np.where(np.isfinite(left), left, np.nanmax(left, axis=0))
