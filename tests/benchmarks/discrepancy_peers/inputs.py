"""What every method is given: the cleaned marks of an experiment, its commands, its robot file, what is known to within
a tolerance, the simulator; and the two gaps by which all are judged on the held-out runs.

A path is the midpoint of the two marks and the direction of the line between them, (n, 3): x mm, y mm, rad.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.comparison import start_pose
from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.experiment import Session, session_of
from evaluator.diagnosis.held_out import held_out_runs
from evaluator.diagnosis.likelihood.known_to import predicted_sigmas
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import PER_RUN, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.mark_geometry import MarkGeometry
from evaluator.marks import columns_of
from evaluator.pose import Poses, poses_from_marks
from evaluator.robot_geometry import reference_pair, reference_places
from evaluator.settings import load_experiment
from simulator.effects.coordinates import Candidate
from simulator.robot import Robot

Floats = NDArray[np.float64]
PathFrom = Callable[[int, Floats], Floats]  # number of a run and its start pose (3,) -> path (n, 3) at its frames
ALIGNMENTS = 3  # of a start pose; only what depends on the place needs more than one


@dataclass(frozen=True)
class Inputs:
    """An experiment as every method gets it."""

    session: Session
    terms: Mapping[str, Candidate]
    problem: Problem
    nominal: Point
    aside: tuple[int, ...]

    @property
    def fitted(self) -> tuple[int, ...]:
        """Numbers of the runs that a method may fit."""
        return tuple(run for run in range(len(self.session.data)) if run not in self.aside)

    @property
    def half_mm(self) -> float:
        """Half of the distance of the marks: turns directions into lengths."""
        return self.problem.half_distance_mm

    def measured(self, run: int) -> Floats:
        """Path of a run as measured; NaN where a mark is missing."""
        return unwrapped(self.problem.channels[run])

    def simulated(self, run: int, terms: Mapping[str, tuple[float, ...]] | None = None) -> Floats:
        """Path of a run as the robot file has it, with effects by the coordinates of their candidates."""
        own = np.zeros(PER_RUN)
        own[:3] = self.nominal.per_run[run, :3]
        (marks,) = self.problem.forward.marks([Task(run, tuple(own), {}, terms or {})])
        return unwrapped(_channels(marks))

    def path_from(self, run: int, start: Floats) -> Floats:
        """Path of a run as the robot file has it, from a start pose: it is one rigid body."""
        path = self.simulated(run)
        first = path[np.flatnonzero(np.isfinite(path).all(axis=1))[0]]
        turn = start[2] - first[2]
        place = turned(turn, path[:, :2] - first[:2]) + start[:2]
        return np.column_stack([place, path[:, 2] + turn])


def read(experiment: Path) -> Inputs:
    """The inputs of an experiment whose marks are given."""
    told = load_experiment(experiment)
    return _inputs(session_of(told, {run.id: run.marks for run in told.run if run.marks is not None}))


def with_robot(inputs: Inputs, robot: Robot) -> Inputs:
    """The inputs with another robot file."""
    return _inputs(replace(inputs.session, robots=(robot,) * len(inputs.session.robots)))


def _inputs(session: Session) -> Inputs:
    reach = float(np.nanmax([np.nanmax(np.abs(run.marks_mm)) for run in session.data]))
    levels = tuple(sorted({abs(rpm) for run in session.data for rpm in run.command}))
    terms = named_terms(reach, levels)
    forward = Simulated(session.robots, session.data, terms, predicted_sigmas(session.known), session.start_sigma_s)
    problem, nominal = build_problem(session.data, forward)
    return Inputs(session, terms, problem, nominal, held_out_runs(session.data))


def poses_of(run: RunData, robot: Robot) -> Poses:
    """Poses of the robot's centre, by the places of the marks in the robot file."""
    pair = reference_pair(robot) or ()
    table = pd.DataFrame(np.column_stack([run.time_s, run.marks_mm]), columns=["time_s", *columns_of(pair)])
    return poses_from_marks(table, MarkGeometry.of_robot(robot).only(pair))


def gaps_mm(inputs: Inputs, path_from: PathFrom) -> dict[str, float]:
    """RMS over the held-out runs of the gap with its start pose fitted, and of that predicted from the start pose."""
    refitted = [_refitted(inputs.measured(run), path_from, run) for run in inputs.aside]
    predicted = [_predicted(inputs, path_from, run) for run in inputs.aside]
    return {name: float(np.sqrt(np.mean(np.square(v)))) for name, v in (("pose", refitted), ("predicted", predicted))}


def turned(angle_rad: Floats | float, vector: Floats) -> Floats:
    """Vectors (..., 2) turned counter-clockwise."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vector[..., 0], vector[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def unwrapped(channels: Floats) -> Floats:
    """Path (n, 3) of channels, its direction continuous across the frames that are known."""
    path = channels[:, :3].copy()
    known = np.isfinite(path).all(axis=1)
    path[~known] = np.nan
    path[known, 2] = np.unwrap(path[known, 2])
    return path


def _channels(marks_mm: Floats) -> Floats:
    across = marks_mm[:, :2] - marks_mm[:, 2:]
    return np.column_stack([(marks_mm[:, :2] + marks_mm[:, 2:]) / 2, np.arctan2(across[:, 1], across[:, 0])])


def _refitted(measured: Floats, path_from: PathFrom, run: int) -> float:
    """RMS distance of the midpoint, mm, from the start pose that suits a run best."""
    known = np.isfinite(measured).all(axis=1)
    start, best = measured[np.flatnonzero(known)[0]].copy(), np.inf
    for _ in range(ALIGNMENTS + 1):
        path = path_from(run, start)
        best = min(best, _rms(path - measured))
        start = _aligned(path[known], measured[known], start)
    return best


def _aligned(path: Floats, measured: Floats, start: Floats) -> Floats:
    """The start pose moved with its path as a rigid body onto the measured midpoints."""
    a, b = path[:, :2] @ [1, 1j], measured[:, :2] @ [1, 1j]
    turn = float(np.angle(np.sum(np.conj(a - a.mean()) * (b - b.mean()))))
    place = np.exp(1j * turn) * (start[0] + 1j * start[1] - a.mean()) + b.mean()
    return np.array([place.real, place.imag, start[2] + turn])


def _predicted(inputs: Inputs, path_from: PathFrom, run: int) -> float:
    """RMS distance of the centre, mm, from the measured start pose alone: as gap.predicted of diagnosis.json."""
    data, robot = inputs.session.data[run], inputs.session.robots[run]
    poses = poses_of(data, robot)
    x, y, heading = start_pose(poses, data.start_s)
    middle = np.mean(np.asarray(reference_places(robot), dtype=float), axis=0)
    at = turned(heading, middle) + np.array([x, y])
    path = path_from(run, np.array([at[0], at[1], heading + data.line_rad]))
    centre = path[:, :2] - turned(path[:, 2] - data.line_rad, middle)
    return _rms(centre - np.column_stack([poses.x_mm, poses.y_mm]))


def _rms(apart: Floats) -> float:
    return float(np.sqrt(np.nanmean(np.sum(apart[:, :2] ** 2, axis=1))))
