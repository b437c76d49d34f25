"""The project's simulator as the diagnosis uses it: thousands of small variations of the same runs.

Motors start at start_s in the time of the recording. A recording that begins after that starts its simulation at
start_s all the same; the start pose is then the pose at start_s, which is fitted like any other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.discrepancy.forward import SHARED_UNIT, Floats, RunData, Task, is_shared
from evaluator.discrepancy.free import FreeTerm
from evaluator.discrepancy.terms import Parameters, Term
from simulator.command import Command
from simulator.effects.catalogue import EFFECTS, apply_effects, view_of
from simulator.effects.view import View
from simulator.errors import SimulationError
from simulator.many import integrate_many
from simulator.model import MODEL, Draft
from simulator.robot import Robot

# Runs of a robot take up to some hundred steps. Where a fit tries what makes wheels chatter they would take any number:
# such a point is as good as one that cannot be simulated.
MOST_STEPS = 1500
# Well under the tracking noise, and small enough that a difference of two runs keeps four digits.
TOLERANCE_MM = 1e-6


class Simulated:
    """Marks of an experiment's runs for any parameters; see the protocol Forward."""

    def __init__(self, robots: Sequence[Robot], data: Sequence[RunData], terms: Mapping[str, Term]) -> None:
        """robots: one per run, with the effects already in the model. terms: how to read the coordinates of a task."""
        self.robots: tuple[Robot, ...] = tuple(robots)
        self._data = tuple(data)
        self._terms = terms
        self._commands = [Command.constant(*run.command, run.start_s, run.stop_s) for run in data]
        self._knots = np.concatenate([command.knots for command in self._commands])
        self._edges = np.cumsum([0, *(len(command.time_s) for command in self._commands)])
        self._varied: dict[tuple[object, ...], Robot] = {}
        self._records: dict[tuple[object, ...], NDArray[np.void] | None] = {}

    def marks(self, tasks: Sequence[Task]) -> list[Floats]:
        """Marks (n, 4) of every task at the frame times of its run; NaN where the simulation fails.

        Tasks that differ only in errors which runs share (of the camera) have one simulation.
        """
        bare = [_without_shared(task) for task in tasks]
        keys = [(task.run, task.own, *task.nominal.items(), *task.terms.items()) for task in bare]
        distinct = dict(zip(keys, bare, strict=True))
        simulated = dict(zip(distinct, self._simulated(list(distinct.values())), strict=True))
        return [_with_shared(simulated[key], task, self._data[task.run]) for key, task in zip(keys, tasks, strict=True)]

    def _simulated(self, tasks: Sequence[Task]) -> list[Floats]:
        self._records.clear()
        views = [self._view(task) for task in tasks]
        models = np.zeros(len(tasks), MODEL)
        able = []
        for number, task in enumerate(tasks):
            record = self._record(task)
            if record is not None:
                models[number] = record[0]
                able.append(number)
        result = [np.full((len(self._data[task.run].time_s), 4), np.nan) for task in tasks]
        if not able:
            return result
        times = [self._true_times(self._data[tasks[number].run], views[number]) for number in able]
        edges = np.cumsum([0, *(len(item) for item in times)])
        poses = self._poses(models[able], [tasks[number] for number in able], times, edges)
        for index, number in enumerate(able):
            x, y, heading = poses[edges[index] + 1 : edges[index + 1]].T
            at = times[index][1:]
            result[number] = np.concatenate(views[number].marks(x, y, heading, at), axis=1)
        return result

    def _poses(
        self, models: NDArray[np.void], tasks: Sequence[Task], times: Sequence[Floats], edges: NDArray[np.int64]
    ) -> Floats:
        """Poses (edges[-1], 3) of all tasks, stacked."""
        count = len(tasks)
        states = np.zeros((count, 6))
        states[:, :3] = [task.own[:3] for task in tasks]
        out = np.empty((edges[-1], 6))
        command_of = np.array([task.run for task in tasks], dtype=np.int64)
        integrate_many(
            models,
            np.arange(count),
            self._knots,
            self._edges,
            command_of,
            states,
            np.concatenate(times),
            edges,
            out,
            TOLERANCE_MM,
            np.zeros((count, 0, 2)),
            np.zeros(count, dtype=np.int64),
            False,
            MOST_STEPS,
        )
        return out[:, :3]

    def _true_times(self, run: RunData, view: View) -> Floats:
        """Start of the simulation, then the frames; a measured time is the true one times the time factor."""
        frames = run.time_s / view.time_factor
        begin = min(frames[0], run.start_s) - 1e-3
        return np.concatenate([[begin], frames])

    def _record(self, task: Task) -> NDArray[np.void] | None:
        order = self._data[task.run].order
        key = (task.run, *task.own[3:], *task.nominal.items(), *task.terms.items())
        if key in self._records:
            return self._records[key]
        draft = Draft(self._robot(task), order)
        record: NDArray[np.void] | None
        try:
            apply_effects(draft)
            for effect, values in self._physical(task).items():
                if effect in EFFECTS:
                    act = EFFECTS[effect].act
                    if act is not None:
                        act(draft, values)
                else:
                    term = self._terms[effect]
                    assert isinstance(term, FreeTerm)  # what is not in the catalogue is of the grammar
                    draft.add(*(part for part in term.kernel_terms(task.terms[effect]) if not part.is_seen_only))
            draft.friction_factor = draft.friction_factor * (1 + task.own[3])
            draft.speed_factor = draft.speed_factor * (1 + np.array(task.own[4:]))
            record = draft.record()
        except SimulationError:
            record = None  # outside what can be simulated; the caller sees NaN and steps back
        self._records[key] = record
        return record

    def _robot(self, task: Task) -> Robot:
        key = (task.run, *task.nominal.items())
        if key not in self._varied:
            if len(self._varied) > 5000:
                self._varied.clear()
            self._varied[key] = varied_robot(self.robots[task.run], task.nominal)
        return self._varied[key]

    def _physical(self, task: Task) -> dict[str, Parameters]:
        return {effect: self._terms[effect].physical(values) for effect, values in task.terms.items()}

    def _view(self, task: Task) -> View:
        view = view_of(self.robots[task.run])
        for effect, values in self._physical(task).items():
            see = EFFECTS[effect].view if effect in EFFECTS else None
            if see is not None:
                see(view, values)
            term = self._terms[effect]
            if isinstance(term, FreeTerm):
                parts = term.kernel_terms(task.terms[effect])
                view.errors += tuple(part for part in parts if part.is_seen_only)
        return view


def _without_shared(task: Task) -> Task:
    return replace(task, nominal={key: value for key, value in task.nominal.items() if not is_shared(key)})


def _with_shared(marks: Floats, task: Task, run: RunData) -> Floats:
    """Marks as seen with the errors that runs share; always an array of its own."""
    seen = marks.copy()
    for key, shift in run.systematic.items():
        if amount := task.nominal.get(key):
            seen += amount / SHARED_UNIT * shift
    return seen


def varied_robot(robot: Robot, deviations: Mapping[str, float]) -> Robot:
    """The robot with nominal values, by dotted key, multiplied by 1 + deviation."""
    for key, deviation in deviations.items():
        if deviation:
            table, name = key.split(".")
            part = getattr(robot, table)
            changed = part.model_copy(update={name: getattr(part, name) * (1 + deviation)})
            robot = robot.model_copy(update={table: changed})
    return robot
