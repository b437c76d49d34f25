"""The project's simulator as the diagnosis uses it: thousands of small variations of the same runs.

Motors start at start_s in the time of the recording. A recording that begins after that starts its simulation at
start_s all the same; the start pose is then the pose at start_s, which is fitted like any other. A robot that does not
start at rest has at its first frame the velocity that its commands have given it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from evaluator.diagnosis.candidates.free_form import FreeTerm
from evaluator.diagnosis.likelihood.known_to import CLOCK, GRAVITY, LEVEL, RADIUS_DIFFERENCE, SCALE, START
from evaluator.diagnosis.likelihood.observed_marks import marks_of_poses, with_shared_errors
from evaluator.diagnosis.likelihood.run_data import Floats, RunData, Task, Values, is_shared
from evaluator.robot_geometry import reference_places
from simulator.dynamics.model import apply_effects, record_of, room_for
from simulator.dynamics.record import model_type
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate
from simulator.effects.draft import Draft
from simulator.effects.view import View
from simulator.errors import SimulationError
from simulator.integrator.batch import integrate_many
from simulator.observation import view_of
from simulator.robot import Robot
from simulator.simulation import RUN_IN_S

# Runs of a robot take up to some hundred steps. Where a fit tries what makes wheels chatter they would take any number:
# such a point is as good as one that cannot be simulated.
MOST_STEPS = 1500
# Well under the tracking noise, and small enough that a difference of two runs keeps four digits.
TOLERANCE_MM = 1e-6
MOST_VARIANTS = 5000


@dataclass(frozen=True)
class Variant:
    """A robot with nominal values moved and terms added, which many runs share.

    record: compiled at nominal friction, the words of a record, None where it cannot be simulated.
    """

    record: NDArray[np.int64] | None
    view: View


class Simulated:
    """Marks of an experiment's runs for any parameters; see the protocol Forward."""

    def __init__(
        self,
        robots: Sequence[Robot],
        data: Sequence[RunData],
        terms: Mapping[str, Candidate],
        known: Mapping[str, float] | None = None,
        start_sigma_s: float = 0.0,
        variants: dict[tuple[object, ...], Variant] | None = None,
    ) -> None:
        """robots: one per run, with the effects already in the model. terms: how to read the coordinates of a task.

        known: size of a deviation of 1 of each quantity of the laboratory that acts here (known_to.simulated_sigmas);
        start_sigma_s: standard deviation of a run's start. variants: compiled before, of the same robots and terms.
        """
        self.known = dict(known or {})
        self.start_sigma_s = start_sigma_s
        self.robots: tuple[Robot, ...] = tuple(robots)
        self._slots = room_for(self.robots)
        self._data = tuple(data)
        self._terms = terms
        told = [run.told for run in data]
        self._knots = [item.command.knots for item in told]
        self._from_rest = np.array([item.starts_at_rest for item in told], dtype=np.bool_)
        self._kinds = [self.robots.index(robot) for robot in self.robots]  # equal robots have equal variants
        self._variants = {} if variants is None else variants

    def of_frames(self, data: Sequence[RunData]) -> Simulated:
        """The same runs, of which only these frames are asked for; robots compiled for one serve the other."""
        return Simulated(self.robots, data, self._terms, self.known, self.start_sigma_s, self._variants)

    def marks(self, tasks: Sequence[Task]) -> list[Floats]:
        """Marks (n, 4) of every task at the frame times of its run; NaN where the simulation fails.

        Tasks that differ only in errors which runs share (of the camera) have one simulation.
        """
        variants = self._variants_of(tasks)
        keys = [
            (task.run, task.own, self._late_s(task), id(variant)) for task, variant in zip(tasks, variants, strict=True)
        ]
        distinct = dict(zip(keys, zip(tasks, variants, strict=True), strict=True))
        simulated = dict(zip(distinct, self._simulated(*zip(*distinct.values(), strict=True)), strict=True))
        return [
            with_shared_errors(simulated[key], task, self._data[task.run], self.known.get(SCALE))
            for key, task in zip(keys, tasks, strict=True)
        ]

    def _simulated(self, tasks: Sequence[Task], variants: Sequence[Variant]) -> list[Floats]:
        result = [np.full((len(self._data[task.run].time_s), 4), np.nan) for task in tasks]
        # friction must stay above zero
        pairs = enumerate(zip(tasks, variants, strict=True))
        able = [n for n, (task, variant) in pairs if variant.record is not None and task.own[3] > -1.0]
        if not able:
            return result
        tasks, variants = [tasks[n] for n in able], [variants[n] for n in able]
        times = self._true_times(tasks, variants)
        edges = np.cumsum([0, *map(len, times)])
        stacked_s = np.concatenate(times)
        poses = self._poses(tasks, variants, stacked_s, edges)
        frame = np.ones(len(poses), dtype=np.bool_)
        frame[edges[:-1]] = False  # the start of the simulation is none
        marks = marks_of_poses(
            poses[frame], stacked_s[frame], [variant.view for variant in variants], np.diff(edges) - 1
        )
        ends = edges[1:] - np.arange(1, len(edges))
        for number, begin, end in zip(able, [0, *ends], ends, strict=False):
            result[number] = marks[begin:end]
        return result

    def _poses(
        self, tasks: Sequence[Task], variants: Sequence[Variant], times_s: Floats, edges: NDArray[np.int64]
    ) -> Floats:
        """Poses (edges[-1], 3) of all tasks, stacked."""
        count = len(tasks)
        own = np.array([task.own for task in tasks])
        models = np.array([variant.record for variant in variants]).view(model_type(self._slots))[:, 0]
        _with_friction(models, own)
        states = np.zeros((count, 6))
        states[:, :3] = own[:, :3]
        knots, knot_edges = self._told(tasks, own)
        moving = np.flatnonzero(~self._from_rest[[task.run for task in tasks]])
        if len(moving):
            begin = times_s[edges[:-1]][moving]
            run_in = np.column_stack([begin - RUN_IN_S, begin]).ravel()
            ends = _integrated(
                models, knots, knot_edges, states[moving], run_in, 2 * np.arange(len(moving) + 1), moving
            )
            states[moving, 3:] = ends[1::2, 3:]
        return _integrated(models, knots, knot_edges, states, times_s, edges, np.arange(count))[:, :3]

    def _told(self, tasks: Sequence[Task], own: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Commands of all tasks, stacked, and where each begins and ends: a run's own gains are those of its motors."""
        parts = [self._knots[task.run] for task in tasks]
        sizes = [len(part) for part in parts]
        knots = np.concatenate(parts)
        knots[:, 1:] *= np.repeat(1 + own[:, 4:6], sizes, axis=0)
        knots[:, 0] += np.repeat([self._late_s(task) for task in tasks], sizes)
        return knots, np.cumsum([0, *sizes])

    def _late_s(self, task: Task) -> float:
        """How much later than stated the motors of a task start."""
        return task.own[6] * self.start_sigma_s + self._deviation(task.nominal, START)

    def _deviation(self, nominal: Mapping[str, float], key: str) -> float:
        """Deviation of a quantity of the laboratory in its unit."""
        return nominal.get(key, 0.0) * self.known.get(key, 0.0)

    def _true_times(self, tasks: Sequence[Task], variants: Sequence[Variant]) -> list[Floats]:
        """Start of the simulation, then the frames; a measured time is the true one times the time factor."""
        known: dict[tuple[int, float, float], Floats] = {}
        result = []
        for task, variant in zip(tasks, variants, strict=True):
            key = task.run, variant.view.time_factor, self._late_s(task)
            if key not in known:
                run = self._data[task.run]
                frames = run.time_s / variant.view.time_factor
                known[key] = np.concatenate([[min(frames[0], run.start_s + key[2]) - 1e-3], frames])
            result.append(known[key])
        return result

    def _variants_of(self, tasks: Sequence[Task]) -> list[Variant]:
        """The variant of every task; tasks of a linearization share theirs, and so do those of later ones."""
        if len(self._variants) > MOST_VARIANTS:
            self._variants.clear()
        met: dict[tuple[object, ...], Variant] = {}
        result = []
        for task in tasks:
            run = self._data[task.run]
            kind = self._kinds[task.run]
            ordered = any(varies_by_run(effect) for effect in task.terms) or any(
                varies_by_run(entry.id) for entry in self.robots[kind].effect
            )
            place = kind, run.order if ordered else 0
            key = *place, id(task.nominal), id(task.terms)  # mappings live as long as their tasks
            if key not in met:
                nominal = {
                    name: value
                    for name, value in task.nominal.items()
                    if not is_shared(name) or (name in self.known and name not in (START, SCALE))
                }
                lasting = *place, *nominal.items(), *task.terms.items()
                if lasting not in self._variants:
                    self._variants[lasting] = self._compiled(*place, nominal, task.terms)
                met[key] = self._variants[lasting]
            result.append(met[key])
        return result

    def _compiled(self, kind: int, order: int, nominal: Mapping[str, float], terms: Values) -> Variant:
        robot = varied_robot(self.robots[kind], {key: value for key, value in nominal.items() if not is_shared(key)})
        view, draft = view_of(robot, reference_places(robot)), Draft(robot, order)
        try:
            apply_effects(draft, robot.effect)
            self._add_known(nominal, draft, view)
            for effect, values in terms.items():
                self._add(effect, values, draft, view)
            return Variant(record_of(draft, slots=self._slots).view(np.int64), view)
        except SimulationError:
            return Variant(None, view)  # outside what can be simulated; the caller sees NaN and steps back

    def _add_known(self, nominal: Mapping[str, float], draft: Draft, view: View) -> None:
        """Let the quantities of the laboratory act on a draft, or on the view of its marks."""
        view.time_factor *= 1 + self._deviation(nominal, CLOCK)
        half = self._deviation(nominal, RADIUS_DIFFERENCE) / 2
        draft.speed_factor *= np.array([1 + half, 1 - half])
        down_x, down_y = (self._deviation(nominal, key) for key in LEVEL)
        if down_x or down_y:
            tilt = {"angle_deg": math.hypot(down_x, down_y), "azimuth_deg": math.degrees(math.atan2(down_y, down_x))}
            _act("plate-tilt", draft, tilt)
        x, y = (self._deviation(nominal, key) for key in GRAVITY)
        if x or y:
            _act("mass-offset", draft, {"x_mm": x, "y_mm": y})

    def _add(self, effect: str, values: tuple[float, ...], draft: Draft, view: View) -> None:
        """Let one term act on a draft, or on the view of its marks."""
        term = self._terms[effect]
        if isinstance(term, FreeTerm):
            parts = term.kernel_terms(values)
            draft.add(*(part for part in parts if not part.is_seen_only))
            view.errors += tuple(part for part in parts if part.is_seen_only)
            return
        act, see = EFFECTS[effect].act, EFFECTS[effect].view
        if act is not None:
            act(draft, term.physical(values))
        if see is not None:
            see(view, term.physical(values))


def _integrated(
    models: NDArray[np.void],
    knots: Floats,
    knot_edges: NDArray[np.int64],
    states: Floats,
    times_s: Floats,
    edges: NDArray[np.int64],
    chosen: NDArray[np.int64],
) -> Floats:
    """States (edges[-1], 6) of runs from states (n, 6) at the first of their times; chosen: their models and knots."""
    count = len(states)
    out = np.empty((len(times_s), 6))
    integrate_many(
        models,
        chosen,
        knots,
        knot_edges,
        chosen,
        states.copy(),
        times_s,
        edges,
        out,
        TOLERANCE_MM,
        np.zeros((count, 0, 2)),
        np.zeros(count, dtype=np.int64),
        False,
        MOST_STEPS,
    )
    return out


def varies_by_run(effect: str) -> bool:
    """Whether an effect differs from run to run of a session; all others are compiled once for all runs of a robot."""
    return effect in EFFECTS and EFFECTS[effect].varies_by_run


def _act(effect: str, draft: Draft, values: Mapping[str, float]) -> None:
    act = EFFECTS[effect].act
    assert act is not None
    act(draft, values)


def _with_friction(models: NDArray[np.void], own: Floats) -> None:
    """Give every record (n,) the friction of its run, own (n, 7); as simulator.dynamics.model compiles it."""
    friction = 1 + own[:, 3:4]
    for name in ("grip_x", "grip_y"):
        models[name] *= friction
    for name in ("steep_x", "steep_y"):
        models[name] /= friction


def varied_robot(robot: Robot, deviations: Mapping[str, float]) -> Robot:
    """The robot with nominal values, by dotted key, multiplied by 1 + deviation; of a [[wheel]] list, those of each."""

    def scaled(part: BaseModel, name: str, factor: float) -> BaseModel:
        return part.model_copy(update={name: getattr(part, name) * factor})

    for key, deviation in deviations.items():
        if deviation:
            table, name = key.split(".")
            part = getattr(robot, table)
            factor = 1 + deviation
            each = isinstance(part, tuple)
            changed = tuple(scaled(item, name, factor) for item in part) if each else scaled(part, name, factor)
            robot = robot.model_copy(update={table: changed})
    return robot
