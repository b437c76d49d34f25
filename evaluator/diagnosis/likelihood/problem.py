"""The fit problem: runs, simulator and noise, and linearizations of an experiment at any point.

A point contains all parameters of the prediction of every run. Derivatives are finite differences, because a simulation
takes only tens of microseconds.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.watch import Watch
from evaluator.diagnosis.likelihood.feature_cache import FeatureCache
from evaluator.diagnosis.likelihood.features import Compression, residual_of_marks
from evaluator.diagnosis.likelihood.jumps import bends, central_slope, jumps, smooth_slope, with_slopes
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.noise.drift_evidence import OF_MARKS, OF_POSES
from evaluator.diagnosis.likelihood.noise.tracking import NO_DRIFT, Drift, Noise
from evaluator.diagnosis.likelihood.point import Column, Point, points_of, theta_of
from evaluator.diagnosis.likelihood.run_data import PER_RUN, Forward, NotSimulatedError, RunData, Task
from simulator.effects.parameter import Size

Floats = NDArray[np.float64]

# mm, mm, rad, relative, standard deviations of the start: large against rounding, small against curvature; for the
# paper's robot
PER_RUN_STEPS = (1e-3, 1e-3, 1e-4, 1e-3, 2e-4, 2e-4, 0.1)
FRICTION, START = 3, 6  # indices among them
# Parameters of runs on open ground: start pose and start, and where a camera sees the marks also friction. Without it,
# friction that scatters by 10 % between runs on a slope was named as friction that varies over the plate.
OF_GROUND = (0, 1, 2, START)
# Simulations in one piece of work: their marks, some 20 kB each, fit into the processor's cache, and there are several
# pieces for several cores. Pieces do not depend on the number of cores.
TASKS_AT_ONCE = 80
RUNS_AT_ONCE = 6  # in one piece of work, if each is simulated once


@dataclass(frozen=True)
class Problem:
    """An experiment ready for fitting."""

    data: tuple[RunData, ...]
    forward: Forward
    channels: tuple[Floats, ...]
    compressions: tuple[Compression, ...]
    noise: tuple[tuple[Noise, ...], ...]
    half_distance_mm: float
    length: float = 1.0  # of the robots, relative to the paper's robot
    starts_show: bool = True  # whether the uncertainty of a run's start of motion has a visible influence
    common_drift: Drift = NO_DRIFT  # of the midpoint of the marks: see noise/common_drift.py
    friction_wander: float = 0.0  # relative, after 1 mm of path: see noise/friction_wander.py
    change_sigma_s: float = 0.0  # of each change of a command after the start: see noise/late_changes.py
    smoothed_over: int = 0  # frames of smoothed tracks; those near changes are left out: see noise/smoothing.py
    horizon_s: float = np.inf  # only frames up to this time after the start of the motors are used
    fits: FitCache = field(default_factory=FitCache)  # of earlier fits
    watch: Watch = field(default_factory=Watch)  # checked between the steps of a fit; shares work among cores
    cache: FeatureCache = field(default_factory=FeatureCache, init=False, repr=False, compare=False)  # of this problem

    @property
    def fingerprint(self) -> str:
        """Hash of the measured marks."""
        return hashlib.sha256(b"".join(np.ascontiguousarray(item).data for item in self.channels)).hexdigest()

    @property
    def given(self) -> frozenset[str]:
        """Ids of the effects of the robot files."""
        return frozenset(entry.id for robot in self.forward.robots for entry in robot.effect)

    @property
    def open_ground(self) -> bool:
        """Whether the robot drives on open ground, so that its noise is estimated from residuals.

        Gains and friction of each run are then omitted, because the noise includes them already: three parameters for
        two seconds of poses absorbed any dynamics of the drive, so that their scatter reached the end of its grid and
        few fits converged. See noise/discrepancy.py.
        """
        return Size(self.length, filmed=not any(run.from_poses for run in self.data)).on_ground

    @property
    def field_of_view(self) -> float:
        """Size of the field of view that the robot needs, as a multiple of that of the paper's robot; at least 1.

        Drifts of a camera are shares of a pixel. Not on open ground, where the noise is estimated from the residuals.
        """
        return 1.0 if self.open_ground else max(1.0, self.length)

    @property
    def drifting_axes(self) -> int:
        """Number of channels, the first ones, that drift together."""
        return OF_POSES if not self.open_ground and all(run.from_poses for run in self.data) else OF_MARKS

    @property
    def of_tracking(self) -> Problem:
        """The problem with the noise of marks and camera only, without varying friction and late changes of commands.

        With it the fitted start pose minimizes the distance to the marks of the whole run. With varying friction the
        start pose is determined by the first frames, and the distance grows along the path.
        """
        return replace(self, compressions=tuple(replace(part, ground=None) for part in self.compressions))

    @property
    def varied(self) -> NDArray[np.int64]:
        """Indices of the parameters per run that are fitted."""
        every = OF_GROUND if self.open_ground else range(PER_RUN)
        return np.array([number for number in every if number != START or self.starts_show])

    @property
    def per_run_steps(self) -> Floats:
        """Steps (7,) of finite differences of the parameters per run."""
        return np.array(PER_RUN_STEPS) * [self.length, self.length, 1.0, 1.0, 1.0, 1.0, 1.0]

    def counting_frames(self, run: int) -> NDArray[np.bool_]:
        """Frames (n,) of a run that are used: both marks found, within the horizon."""
        data = self.data[run]
        seen = np.isfinite(self.channels[run]).all(axis=1)
        return np.asarray(seen & (data.time_s <= max(data.start_s, data.time_s[0]) + self.horizon_s))

    def residuals(self, tasks: Sequence[Task]) -> list[Floats]:
        """Channel residuals (n, 4) in mm of every task."""
        return [
            residual_of_marks(self.channels[task.run], marks, self.half_distance_mm)
            for task, marks in zip(tasks, self.forward.marks(tasks), strict=True)
        ]

    def features(self, tasks: Sequence[Task]) -> list[Floats]:
        """Whitened features (k,) of the residuals of every task; not finite if it cannot be simulated."""
        return self.cache.of(tasks, self._simulated_features)

    def _simulated_features(self, tasks: Sequence[Task]) -> list[Floats]:
        """Features of tasks; they must not depend on earlier or simultaneous simulations.

        Otherwise an interrupted search would give a different result.
        """
        found: list[Floats] = []
        marks = self.forward.marks(tasks)
        for run, group in groupby(range(len(tasks)), lambda number: tasks[number].run):
            predicted = np.array([marks[number] for number in group])
            part = self.compressions[run]
            found += list(part.features_of_marks(self.channels[run], predicted, self.half_distance_mm))
        return found

    def linearized(
        self, point: Point, columns: Sequence[Column], runs: Sequence[int] | None = None
    ) -> list[Linearized]:
        """Response and derivatives of the runs at a point; NotSimulatedError if the simulation fails there."""
        chosen = list(range(len(self.data)) if runs is None else runs)
        found = self.attempted(point, columns, chosen)
        failed = [self.data[run].id for run, item in zip(chosen, found, strict=True) if item is None]
        if failed:
            raise NotSimulatedError(failed)
        return [item for item in found if item is not None]

    def attempted(self, point: Point, columns: Sequence[Column], runs: Sequence[int]) -> list[Linearized | None]:
        """Response and derivatives of the runs at a point; None for runs that cannot be simulated there."""
        point = point.without_absent(columns)
        at_once = max(1, TASKS_AT_ONCE // (len(columns) + len(self.varied) + 1))
        work = partial(self._attempted, point, columns, *points_of(point, columns))
        return [item for part in self.watch.each(work, _pieces(runs, at_once)) for item in part]

    def _attempted(
        self,
        point: Point,
        columns: Sequence[Column],
        points: Sequence[Point],
        bases: Mapping[tuple[str, tuple[float, ...]], int],
        runs: Sequence[int],
    ) -> list[Linearized | None]:
        """One piece of the work of `attempted`; points, bases: from points_of."""
        size = len(points) + len(self.varied)
        every = self.features([task for run in runs for task in self._tasks(point, points, run)])
        features = [np.array(every[number * size : (number + 1) * size]) for number in range(len(runs))]
        before = [bases.get((column.key, column.start), 0) if column.start is not None else 0 for column in columns]
        views = [self._linearized(point, columns, run, item, before) for run, item in zip(runs, features, strict=True)]
        steps = np.array([0.0 if column.to is not None else column.step for column in columns])
        doubtful = (
            self._jumping(views, steps) if self.open_ground else self._bending(point, columns, runs, views, steps)
        )
        amounts = {i: _amount_beside(points[before[i]], columns[i]) for i in {i for _, i in doubtful}}
        able = [(number, i) for number, i in doubtful if self.open_ground or amounts[i] < 0]
        places = {i: points[before[i]].moved(columns[i], amounts[i]) for i in {i for _, i in able}}
        beside = [places[i].task(runs[number]) for number, i in able]
        slopes: dict[tuple[int, int], Floats] = {}
        for (number, i), item in zip(able, self.features(beside), strict=True):
            here, view = features[number][before[i]], views[number]
            assert view is not None
            if self.open_ground:
                slopes[number, i] = smooth_slope(view.common[:, i], here, item, steps[i], amounts[i])
            elif np.isfinite(item).all() and view.common[:, i].any():  # else the side ahead is unknown
                slopes[number, i] = central_slope(view.common[:, i], here, item, steps[i])
        return with_slopes(views, slopes, theta_of(point, columns))

    @staticmethod
    def _jumping(views: Sequence[Linearized | None], steps: Floats) -> list[tuple[int, int]]:
        """Numbers of views and columns whose derivative contains a jump."""
        return [(number, i) for number, view in enumerate(views) if view for i in jumps(view.common, steps)]

    def _bending(
        self,
        point: Point,
        columns: Sequence[Column],
        runs: Sequence[int],
        views: Sequence[Linearized | None],
        steps: Floats,
    ) -> list[tuple[int, int]]:
        """Numbers of views and columns of the model whose derivatives need differences to both sides."""
        inside = [
            i
            for i, column in enumerate(columns)
            if (column.term is None or column.key in point.terms)
            and column.has_two_sides
            and _amount_beside(point, column) < 0
        ]
        sound = [(number, view) for number, view in enumerate(views) if view is not None]
        if not inside or not sound:
            return []
        behind = point.beside([columns[i] for i in inside], -1)
        tasks = [place.task(runs[number]) for number, _ in sound for place in (point, behind)]
        found = self.features(tasks)
        return [
            (number, i)
            for (number, view), here, there in zip(sound, found[::2], found[1::2], strict=True)
            if bends(view, inside, steps, there - here)
            for i in inside
        ]

    def _tasks(self, point: Point, points: Sequence[Point], run: int) -> list[Task]:
        """Tasks for the derivatives of one run, those by its own parameters last."""
        return [at.task(run) for at in points] + [
            point.task(run, step) for step in np.diag(self.per_run_steps)[self.varied]
        ]

    def seen_again(
        self, point: Point, views: Sequence[Linearized], runs: Sequence[int], columns: Sequence[Column] = ()
    ) -> list[Linearized | None]:
        """Linearizations of runs at a nearby point, with new responses and the slopes of views."""
        result: list[Linearized | None] = []
        theta = theta_of(point, columns)
        pieces = _pieces(runs, RUNS_AT_ONCE)
        parts = self.watch.each(lambda piece: self.features([point.task(run) for run in piece]), pieces)
        every = [features for part in parts for features in part]
        for run, view, features in zip(runs, views, every, strict=True):
            sound = bool(np.isfinite(features).all())
            response = features + view.common @ theta + view.scatter @ point.per_run[run, 3:]
            result.append(replace(view, response=response) if sound else None)
        return result

    def _linearized(
        self,
        point: Point,
        columns: Sequence[Column],
        run: int,
        features: Floats,
        before: Sequence[int],
    ) -> Linearized | None:
        """Linearization of a run from the features (m, k) of its tasks; None if it cannot be simulated."""
        varied = self.varied
        sound: NDArray[np.bool_] = np.asarray(np.isfinite(features).all(axis=1))
        if not (sound[0] and sound[-len(varied) :].all()):
            return None
        base = features[0]
        common = np.zeros((len(base), len(columns)))
        for i, column in enumerate(columns):
            after = len(features) - len(varied) - len(columns) + i
            if sound[before[i]] and sound[after]:  # the derivative of a candidate that cannot be simulated is 0
                common[:, i] = (features[before[i]] - features[after]) / column.step
        per_run = np.zeros((len(base), PER_RUN))
        per_run[:, varied] = ((base - features[-len(varied) :]) / self.per_run_steps[varied, None]).T
        response = base + common @ theta_of(point, columns) + per_run[:, 3:] @ point.per_run[run, 3:]
        return Linearized(response, common, per_run[:, :3], per_run[:, 3:])


def _pieces(runs: Sequence[int], at_once: int) -> list[Sequence[int]]:
    return [runs[first : first + at_once] for first in range(0, len(runs), at_once)]


def _amount_beside(point: Point, column: Column) -> float:
    """Distance to a second point of a derivative: a step back or, if that is beyond a bound, half a step ahead."""
    behind = point.moved(column, -column.step)
    return -column.step if behind.is_within_bounds(column) else column.step / 2
