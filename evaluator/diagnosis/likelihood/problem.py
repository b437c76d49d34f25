"""The measured runs, the simulator and the noise put together: linearizations of an experiment at any point.

A point holds everything that the prediction of every run depends on. Derivatives are differences of simulations: with
tens of microseconds a run they cost less than any cleverness.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.candidates.coordinates import size_of
from evaluator.diagnosis.inference.fit_cache import Ends
from evaluator.diagnosis.inference.watch import Watch
from evaluator.diagnosis.likelihood.discrepancy import left_over, with_discrepancy
from evaluator.diagnosis.likelihood.drift import with_drift
from evaluator.diagnosis.likelihood.features import (
    MODEL_FLOOR_MM,
    Compression,
    channel_noise,
    channel_residual,
    channels_of,
    compression,
    residual_spectra,
)
from evaluator.diagnosis.likelihood.mixed_model import Linearized
from evaluator.diagnosis.likelihood.noise import Noise
from evaluator.diagnosis.likelihood.run_data import OWN_NUMBERS, SHARED_UNIT, Forward, RunData, Task, is_shared
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]

# mm, mm, rad, relative, standard deviations of the start: far above rounding, far below curvature; of the paper's robot
OWN_STEPS = (1e-3, 1e-3, 1e-4, 1e-3, 2e-4, 2e-4, 0.1)
OWN = len(OWN_STEPS)
START_POSE = 3  # of them, the first: x, y, heading
NOMINAL_STEP = 5e-4
NOMINAL_STEPS = {"body": 5e-3}  # mass does little but to inertia
SHARED_STEP = 0.05 * SHARED_UNIT  # a twentieth of a standard deviation
STEP_SHARE = 0.2  # of a visible step: curvature would make effects and run-to-run scatter differ where they are one
TASKS_AT_ONCE = 1500
NO_DISTANCE_MM = 1e9  # noise of a distance that was not measured
SETTLING_S = 0.4  # motors that lag by more would be seen as an effect first


@dataclass(frozen=True)
class Column:
    """A common parameter: a nominal value (term is None) or one coordinate of a term, seen from start values."""

    key: str
    coordinate: int = 0
    term: Candidate | None = None
    start: tuple[float, ...] | None = None
    whole_change: float | None = None  # for an effect without a derivative: the whole change to be tried

    @property
    def step(self) -> float:
        """Size of the difference that makes the derivative."""
        if self.whole_change is not None:
            return self.whole_change
        if self.term is None:
            return SHARED_STEP if is_shared(self.key) else NOMINAL_STEPS.get(self.key.split(".")[0], NOMINAL_STEP)
        return STEP_SHARE * self.term.coordinates[self.coordinate].step

    @property
    def absent(self) -> float:
        """Value where nothing is changed."""
        return 0.0 if self.term is None else self.term.coordinates[self.coordinate].absent


@dataclass(frozen=True)
class Point:
    """Nominal deviations, term coordinates, and every run's own numbers (n, 7) as in Task."""

    own: Floats
    nominal: Mapping[str, float] = field(default_factory=dict)
    terms: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def moved(self, column: Column, amount: float) -> Point:
        """The point with one common parameter changed."""
        if column.term is None:
            return replace(self, nominal={**self.nominal, column.key: self.nominal.get(column.key, 0.0) + amount})
        values = list(self.terms.get(column.key, column.start or column.term.absent))
        values[column.coordinate] += amount
        return replace(self, terms={**self.terms, column.key: tuple(values)})

    def value(self, column: Column) -> float:
        """Value of a common parameter measured from where they change nothing."""
        if column.term is None:
            return self.nominal.get(column.key, 0.0)
        values = self.terms.get(column.key)
        return 0.0 if values is None else values[column.coordinate] - column.absent

    def task(self, run: int, own_shift: Floats | None = None) -> Task:
        """What to simulate for one run."""
        own = self.own[run] if own_shift is None else self.own[run] + own_shift
        return Task(run, tuple(own), self.nominal, self.terms)


@dataclass(frozen=True)
class Problem:
    """An experiment ready for fitting."""

    data: tuple[RunData, ...]
    forward: Forward
    channels: tuple[Floats, ...]
    compressions: tuple[Compression, ...]
    noise: tuple[tuple[Noise, ...], ...]
    half_distance_mm: float
    length: float = 1.0  # of the robots over that of the paper's
    horizon_s: float = np.inf  # only frames up to so long after the start of the motors count
    ends: Ends = field(default_factory=Ends)  # of the fits made before
    watch: Watch = field(default_factory=Watch)  # looked at between the steps of a fit

    @property
    def fingerprint(self) -> str:
        """Hash of the measured marks."""
        return hashlib.sha256(b"".join(np.ascontiguousarray(item).data for item in self.channels)).hexdigest()

    @property
    def own_steps(self) -> Floats:
        """Differences (7,) of a run's own numbers that make derivatives."""
        return np.array(OWN_STEPS) * [self.length, self.length, 1.0, 1.0, 1.0, 1.0, 1.0]

    def counting_frames(self, run: int) -> NDArray[np.bool_]:
        """Frames (n,) of a run that count: both marks seen, within the horizon."""
        data = self.data[run]
        seen = np.isfinite(self.channels[run]).all(axis=1)
        return np.asarray(seen & (data.time_s <= max(data.start_s, data.time_s[0]) + self.horizon_s))

    def residuals(self, tasks: Sequence[Task]) -> list[Floats]:
        """Channel residuals (n, 4) in mm of every task."""
        marks = self.forward.marks(tasks)
        measured = np.concatenate([self.channels[task.run] for task in tasks])
        residual = channel_residual(measured, channels_of(np.concatenate(marks)), self.half_distance_mm)
        ends = np.cumsum([len(item) for item in marks])
        return [residual[end - len(item) : end] for end, item in zip(ends, marks, strict=True)]

    def linearized(
        self, point: Point, columns: Sequence[Column], runs: Sequence[int] | None = None
    ) -> list[Linearized]:
        """Response and derivatives of the runs at a point; FloatingPointError where the simulation fails there."""
        chosen = list(range(len(self.data)) if runs is None else runs)
        found = self.attempted(point, columns, chosen)
        failed = [self.data[run].id for run, item in zip(chosen, found, strict=True) if item is None]
        if failed:
            raise FloatingPointError(f"run {failed[0]} cannot be simulated at this point")
        return [item for item in found if item is not None]

    def attempted(self, point: Point, columns: Sequence[Column], runs: Sequence[int]) -> list[Linearized | None]:
        """Response and derivatives of the runs at a point; None for runs that cannot be simulated there."""
        result: list[Linearized | None] = []
        at_once = max(1, TASKS_AT_ONCE // (len(columns) + OWN + 1))
        points, bases = _points(point, columns)
        size = len(points) + len(OWN_STEPS)
        for first in range(0, len(runs), at_once):  # large batches keep all cores busy, small ones the memory
            group = runs[first : first + at_once]
            residuals = self.residuals([task for run in group for task in self._tasks(point, points, run)])
            for number, run in enumerate(group):
                own = residuals[number * size : (number + 1) * size]
                result.append(self._linearized(point, columns, run, own, bases))
        return result

    def _tasks(self, point: Point, points: Sequence[Point], run: int) -> list[Task]:
        """What to simulate for the derivatives of one run, those by its own numbers last."""
        return [at.task(run) for at in points] + [point.task(run, step) for step in np.diag(self.own_steps)]

    def seen_again(self, point: Point, views: Sequence[Linearized], runs: Sequence[int]) -> list[Linearized | None]:
        """Views of runs without common columns at a point nearby: the response anew, the slopes as they were."""
        result: list[Linearized | None] = []
        for run, view, residual in zip(runs, views, self.residuals([point.task(run) for run in runs]), strict=True):
            used = residual[self.compressions[run].used]
            if not np.isfinite(used).all():
                result.append(None)
                continue
            response = self.compressions[run].features(used) + view.scatter @ point.own[run, 3:]
            result.append(replace(view, response=response))
        return result

    def _linearized(
        self,
        point: Point,
        columns: Sequence[Column],
        run: int,
        channel_residuals: Sequence[Floats],
        bases: Mapping[tuple[str, tuple[float, ...]], int],
    ) -> Linearized | None:
        residuals = np.array(channel_residuals)[:, self.compressions[run].used]
        sound: NDArray[np.bool_] = np.asarray(np.isfinite(residuals).all(axis=(1, 2)))
        if not (sound[0] and sound[-OWN:].all()):
            return None
        residuals[~sound] = 0.0
        features = self.compressions[run].features(residuals)
        base = features[0]
        common = np.zeros((len(base), len(columns)))
        for i, column in enumerate(columns):
            before = bases.get((column.key, column.start), 0) if column.start is not None else 0
            after = len(features) - OWN - len(columns) + i
            if sound[before] and sound[after]:  # a candidate that cannot be simulated offers nothing
                common[:, i] = (features[before] - features[after]) / column.step
        own = ((base - features[-OWN:]) / self.own_steps[:, None]).T
        theta = np.array([0.0 if c.start is not None else point.value(c) for c in columns])
        response = base + common @ theta + own[:, 3:] @ point.own[run, 3:]
        return Linearized(response, common, own[:, :3], own[:, 3:])


def _points(point: Point, columns: Sequence[Column]) -> tuple[list[Point], dict[tuple[str, tuple[float, ...]], int]]:
    """Where to simulate for the derivatives of any run, and where the bases of terms with starting places stand."""
    points = [point]
    bases: dict[tuple[str, tuple[float, ...]], int] = {}
    for column in columns:  # a term seen from its own starting place has its own base
        if column.start is not None and (column.key, column.start) not in bases:
            bases[column.key, column.start] = len(points)
            points.append(replace(point, terms={**point.terms, column.key: column.start}))
    return points + [point.moved(column, column.step) for column in columns], bases


def build_problem(
    data: Sequence[RunData], forward: Forward, ends: Ends | None = None, watch: Watch | None = None
) -> tuple[Problem, Point]:
    """Estimate the tracking noise and compress every run; also gives the nominal point with aligned starts.

    ends: of the fits that an interrupted diagnosis of the same data made. watch: when to end.
    """
    channels = tuple(channels_of(run.marks_mm) for run in data)
    half = float(np.nanmedian(np.concatenate([item[:, 3] for item in channels]))) / 2
    length = max(size_of(robot).length for robot in forward.robots)
    bare = Problem(tuple(data), forward, channels, (), (), half, length, ends=ends or Ends(), watch=watch or Watch())
    point = Point(aligned_starts(data, forward))
    return with_noise_of(bare, point), point


def with_noise_of(problem: Problem, point: Point) -> Problem:
    """The problem with its noise estimated from what a point leaves over, and every run compressed accordingly."""
    residuals = problem.residuals([point.task(run) for run in range(len(problem.data))])
    frames = [problem.counting_frames(run) for run in range(len(problem.data))]
    ends = [int(np.flatnonzero(used)[-1]) + 1 for used in frames]
    noise = channel_noise(
        [
            residual_spectra(run.time_s[:end], item[:end], run.start_s + SETTLING_S)
            for run, item, end in zip(problem.data, residuals, ends, strict=True)
        ]
    )
    rigid = [np.zeros_like(used) if run.from_poses else used for run, used in zip(problem.data, frames, strict=True)]
    noise = with_drift(
        noise, [run.time_s for run in problem.data], rigid, residuals, [run.marks_mm for run in problem.data]
    )
    noise = [
        (*parts[:3], replace(parts[3], white_mm=NO_DISTANCE_MM)) if run.from_poses else parts
        for run, parts in zip(problem.data, noise, strict=True)
    ]
    if problem.length > 1:
        noise = with_discrepancy(noise, [run.time_s for run in problem.data], _left_over(problem, point))
    compressions = tuple(
        compression(run.time_s, used, parts, problem.length * MODEL_FLOOR_MM)
        for run, used, parts in zip(problem.data, frames, noise, strict=True)
    )
    return replace(problem, compressions=compressions, noise=tuple(noise))


def within_horizon(problem: Problem, point: Point, horizon_s: float) -> Problem:
    """The problem of the first seconds of every run, with the noise that a point leaves there.

    Later frames are not simulated: over a short horizon that was nearly all of the work.
    """
    short = replace(problem, horizon_s=horizon_s)
    frames = [int(np.flatnonzero(short.counting_frames(run))[-1]) + 1 for run in range(len(problem.data))]
    data = tuple(run.first(count) for run, count in zip(problem.data, frames, strict=True))
    channels = tuple(item[:count] for item, count in zip(problem.channels, frames, strict=True))
    return with_noise_of(replace(short, data=data, channels=channels, forward=problem.forward.of_frames(data)), point)


def _left_over(problem: Problem, point: Point) -> Floats:
    """What the common parameters of a point leave over in every run, (runs, 2) mm: see discrepancy.left_over."""
    same = replace(point, own=point.own * (np.arange(OWN) < START_POSE))
    marks = problem.forward.marks([same.task(run) for run in range(len(problem.data))])
    pairs = zip(problem.channels, marks, strict=True)
    left = np.array([left_over(seen, channels_of(part), problem.half_distance_mm) for seen, part in pairs])
    return np.where(np.isfinite(left), left, np.nanmax(left, axis=0))


def aligned_starts(data: Sequence[RunData], forward: Forward) -> Floats:
    """Start poses that lay the nominal prediction on the first part of every run, (n, 7) with zero scatter."""
    own = np.zeros((len(data), OWN_NUMBERS))
    predicted = forward.marks([Task(run, (0.0,) * OWN_NUMBERS) for run in range(len(data))])
    for run, (item, marks) in enumerate(zip(data, predicted, strict=True)):
        seen = np.flatnonzero(np.isfinite(item.marks_mm).all(axis=1))
        early = seen[: max(len(seen) // 8, 5)]
        measured = item.marks_mm[early].reshape(-1, 2)
        model = marks[early].reshape(-1, 2)
        measured_z, model_z = (a[:, 0] + 1j * a[:, 1] for a in (measured, model))
        turn = np.angle(np.sum((measured_z - measured_z.mean()) * np.conj(model_z - model_z.mean())))
        shift = measured_z.mean() - np.exp(1j * turn) * model_z.mean()
        own[run, :3] = shift.real, shift.imag, turn
    return own
