"""Simulation of many variations of the same runs for a diagnosis.

Motors start at start_s in the time of the recording. If the recording begins later, the simulation still starts at
start_s; the start pose is then the pose at start_s, which is fitted like any other. A robot that does not start at rest
has in its first frame the velocity that its commands give it after RUN_IN_S from the measured one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.candidates.coordinates import on_open_ground
from evaluator.diagnosis.candidates.free_form import wheel_friction
from evaluator.diagnosis.likelihood.feature_cache import Paths
from evaluator.diagnosis.likelihood.known_to import START, amount_of, mark_keys
from evaluator.diagnosis.likelihood.observed_marks import Pose, SharedErrors, Sight
from evaluator.diagnosis.likelihood.run_data import START_POSE, Floats, RunData, Task
from evaluator.diagnosis.likelihood.variants import Variant, Variants
from evaluator.robot_geometry import reference_places
from simulator.dynamics.record import model_type
from simulator.effects.coordinates import Candidate
from simulator.integrator.batch import integrate_many
from simulator.robot import Robot
from simulator.simulation import RUN_IN_S

# Runs need up to some hundred steps. Parameters that make wheels chatter would need many more; such points are treated
# as not simulable. Wheels whose speed ripples by 28 % need up to 61 a revolution; larger ripple is left room.
MOST_STEPS, STEPS_OF_A_TURN = 1500, 150
# Tolerance of a step, in the unit of length of the kernel of a robot. On a plate it is far below the tracking noise, so
# that differences of two runs have four digits. With ripple at 533 rpm, runs end 2 µm off and differences are accurate
# to half a per cent, in 40 % of the time. On open ground the noise is ten thousand times larger: errors at the end of a
# run are below a third of the model floor (features.MODEL_FLOOR_MM), in half the time.
TOLERANCE_MM, RIPPLE_TOLERANCE_MM, GROUND_TOLERANCE_MM = 1e-6, 1e-5, 1e-4
RIPPLE = "speed-ripple"


class Simulated:
    """Marks of an experiment's runs for any parameters; see the protocol Forward."""

    def __init__(
        self,
        robots: Sequence[Robot],
        data: Sequence[RunData],
        terms: Mapping[str, Candidate],
        known: Mapping[str, float] | None = None,
        start_sigma_s: float = 0.0,
        variants: Variants | None = None,
    ) -> None:
        """robots: one per run, with the effects of the model. terms: candidates whose coordinates a task contains.

        known: scale of each shared deviation of a task (known_to.predicted_sigmas); start_sigma_s: standard deviation
        of a run's start. variants: compiled robots of another Simulated with the same robots and terms.
        """
        self.known = dict(known or {})
        self.start_sigma_s = start_sigma_s
        self.robots: tuple[Robot, ...] = tuple(robots)
        distinct = {id(robot): robot for robot in self.robots}
        keys = {known: mark_keys(robot) for known, robot in distinct.items()}
        self._mark_keys = [keys[id(robot)] for robot in self.robots]
        self._data = tuple(data)
        self._errors = [SharedErrors(run, self.known) for run in data]
        counts = {len(robot.wheel_positions_mm()) for robot in distinct.values()}
        self._terms = {term.id: term for count in counts for term in wheel_friction(count)} | dict(terms)
        run_commands = [run.run_command for run in data]
        self._knots = [item.command.knots for item in run_commands]
        self._from_rest = np.array([item.starts_at_rest for item in run_commands], dtype=np.bool_)
        self._run_in = np.array([_run_in(*pair) for pair in zip(self._data, self.robots, strict=True)])
        self._variants = variants or Variants(self.robots, self._terms, self.known)
        self._paths = Paths()
        self._rippling = any(entry.id == RIPPLE for robot in distinct.values() for entry in robot.effect)
        self._most_turns = max(map(_turns, data), default=0.0)
        on_ground = on_open_ground(self.robots, data)
        self._tolerance_mm = GROUND_TOLERANCE_MM if on_ground else TOLERANCE_MM

    def of_frames(self, data: Sequence[RunData]) -> Simulated:
        """A simulation of the same runs at the frames of data, which shares the compiled robots."""
        return Simulated(self.robots, data, self._terms, self.known, self.start_sigma_s, self._variants)

    def marks(self, tasks: Sequence[Task]) -> list[Floats]:
        """Marks (n, 4) of every task at the frame times of its run; NaN if the simulation fails.

        Tasks that differ only in their start pose or in the observation of the marks (errors of the camera, positions
        of the marks) share a simulation.
        """
        variants = self._variants.of(tasks, self._data)
        able = [  # friction must stay above zero
            number
            for number, (task, variant) in enumerate(zip(tasks, variants, strict=True))
            if variant.record is not None and task.per_run[START_POSE] > -1.0
        ]
        paths = self._paths_of([(tasks[number], variants[number]) for number in able])
        sights: dict[tuple[int, int], Sight] = {}
        found: dict[int, Floats] = {}
        for number, (begin, path, times_s) in zip(able, paths, strict=True):
            task = tasks[number]
            place = task.run, id(task.nominal)  # a mapping lives as long as its task
            if place not in sights:
                sights[place] = self._sight(task)
            x, y, heading = task.per_run[:START_POSE]
            found[number] = sights[place].marks(path, times_s, begin, (x, y, heading), variants[number].view)
        return [
            found[number] if number in found else np.full((len(self._data[task.run].time_s), 4), np.nan)
            for number, task in enumerate(tasks)
        ]

    def _sight(self, task: Task) -> Sight:
        """Observation of the marks of a task."""
        moved = tuple(amount_of(task.nominal, name, self.known) for name in self._mark_keys[task.run])
        return Sight(*self._errors[task.run].of(task.nominal), moved)

    def _paths_of(self, items: Sequence[tuple[Task, Variant]]) -> list[tuple[Pose, Floats, Floats]]:
        """Per task: pose at which its simulation begins, states (n, 6) at the frames, and the true times of these.

        All tasks with the same motion share the pose.
        """
        if not items:
            return []
        late_s = self._late_s([task for task, _ in items])
        times = self._true_times(items, late_s)
        begins = [variant.begin(task.per_run[:START_POSE]) for task, variant in items]

        def of_a_kind(numbers: Sequence[int], *, ripples: bool) -> list[Floats]:
            asked, variants = zip(*(items[n] for n in numbers), strict=True)
            per_run = np.array([(*begins[n], *items[n][0].per_run[START_POSE:]) for n in numbers])
            runs, late = [task.run for task in asked], [late_s[n] for n in numbers]
            edges = np.cumsum([0, *(len(times[n]) for n in numbers)])
            states = self._states(
                runs, variants, per_run, late, np.concatenate([times[n] for n in numbers]), edges, ripples=ripples
            )
            return [states[begin + 1 : end] for begin, end in pairwise(edges)]  # the first of each is its start

        def simulated(numbers: Sequence[int]) -> list[Floats]:
            found: dict[int, Floats] = {}
            for ripples in (False, True):
                same = [n for n in numbers if (self._rippling or RIPPLE in items[n][0].terms) == ripples]
                if same:
                    found.update(zip(same, of_a_kind(same, ripples=ripples), strict=True))
            return [found[n] for n in numbers]

        keys = [
            (begin, task.per_run[START_POSE:], late, id(variant.record), variant.view.time_factor)
            for begin, late, (task, variant) in zip(begins, late_s, items, strict=True)
        ]
        records = [variant.record for _, variant in items]
        paths = self._paths.of([task.run for task, _ in items], keys, records, simulated)
        return [(begin, path, time[1:]) for begin, path, time in zip(begins, paths, times, strict=True)]

    def _states(
        self,
        runs: Sequence[int],
        variants: Sequence[Variant],
        per_run: Floats,
        late_s: Sequence[float],
        times_s: Floats,
        edges: NDArray[np.int64],
        *,
        ripples: bool,
    ) -> Floats:
        """States (edges[-1], 6) of simulations of runs, stacked.

        per_run: (n, 7) as in Task. late_s: of their motors. ripples: whether the speed of their wheels does.
        """
        tolerance_mm = max(self._tolerance_mm, RIPPLE_TOLERANCE_MM) if ripples else self._tolerance_mm
        most_steps = MOST_STEPS + int(ripples * STEPS_OF_A_TURN * self._most_turns)
        count = len(runs)
        models = np.array([variant.record for variant in variants]).view(model_type(self._variants.slots))[:, 0]
        _with_friction(models, per_run)
        states = np.zeros((count, 6))
        states[:, :3] = per_run[:, :3]
        knots, knot_edges = self._commands(runs, per_run, [variant.view.time_factor for variant in variants], late_s)
        moving = np.flatnonzero(~self._from_rest[runs])
        if len(moving):
            begin = times_s[edges[:-1]][moving]
            run_in = np.column_stack([begin - RUN_IN_S, begin]).ravel()
            states[moving, 3:] = self._run_in[np.asarray(runs)[moving]]
            ends = _integrated(
                *(models, knots, knot_edges, states[moving], run_in, 2 * np.arange(len(moving) + 1), moving),
                tolerance_mm,
                most_steps,
            )
            states[moving, 3:] = ends[1::2, 3:]
        chosen = np.arange(count)
        return _integrated(models, knots, knot_edges, states, times_s, edges, chosen, tolerance_mm, most_steps)

    def _commands(
        self, runs: Sequence[int], per_run: Floats, time_factors: Sequence[float], late_s: Sequence[float]
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Stacked commands of runs in true time, multiplied by the gains of each, and their edges."""
        parts = [self._knots[run] for run in runs]
        sizes = [len(part) for part in parts]
        knots = np.concatenate(parts)
        knots[:, 1:] *= np.repeat(1 + per_run[:, 4:6], sizes, axis=0)
        moved = [
            self._data[run].run_command.true_clock(factor, late)
            for run, factor, late in zip(runs, time_factors, late_s, strict=True)
        ]
        later_s, times = (np.repeat(part, sizes) for part in np.array(moved).T)
        knots[:, 0] = (knots[:, 0] + later_s) * times
        return knots, np.cumsum([0, *sizes])

    def _late_s(self, tasks: Sequence[Task]) -> list[float]:
        """Delay of the start of the motors of tasks, in the time of the recording."""
        points = {id(task.nominal): task.nominal for task in tasks}  # which many tasks share
        common = {point: amount_of(nominal, START, self.known) for point, nominal in points.items()}
        return [task.per_run[6] * self.start_sigma_s + common[id(task.nominal)] for task in tasks]

    def _true_times(self, items: Sequence[tuple[Task, Variant]], late_s: Sequence[float]) -> list[Floats]:
        """True times of the start of the simulation and of the frames; measured times are true ones times a factor."""
        known: dict[tuple[int, float, float], Floats] = {}
        result = []
        for (task, variant), late in zip(items, late_s, strict=True):
            key = task.run, variant.view.time_factor, late
            if key not in known:
                run = self._data[task.run]
                later_s, times = run.run_command.true_clock(key[1], late)
                frames_s = run.time_s / key[1]
                begin_s = min(frames_s[0], (run.start_s + later_s) * times)
                known[key] = np.concatenate([[begin_s - 1e-3], frames_s])
            result.append(known[key])
        return result


def _integrated(
    models: NDArray[np.void],
    knots: Floats,
    knot_edges: NDArray[np.int64],
    states: Floats,
    times_s: Floats,
    edges: NDArray[np.int64],
    chosen: NDArray[np.int64],
    tolerance_mm: float,
    most_steps: int,
) -> Floats:
    """States (edges[-1], 6) of runs from states (n, 6) at their first times; chosen: indices of models and knots."""
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
        tolerance_mm,
        most_steps,
    )
    return out


def _run_in(run: RunData, robot: Robot) -> tuple[float, float, float]:
    """Velocity of the centre of the robot RUN_IN_S before a run, body frame, mm/s and rad/s; see RunData.run_in."""
    if run.run_in is None:
        return 0.0, 0.0, 0.0
    along, across, spin = run.run_in
    x, y = np.mean(reference_places(robot), axis=0)
    return along + spin * y, across - spin * x, spin


def _turns(run: RunData) -> float:
    """Turns of a wheel during the recording of a run, if the fastest one turned throughout."""
    command = run.run_command.command
    rpm = np.abs(np.concatenate([command.left_rpm, command.right_rpm])).max()
    return float(rpm / 60 * np.ptp(run.time_s))


def _with_friction(models: NDArray[np.void], per_run: Floats) -> None:
    """Scale the friction of every record (n,) as compiled by simulator.dynamics.model; per_run: (n, 7)."""
    friction = 1 + per_run[:, 3:4]
    for name in ("grip_x", "grip_y"):
        models[name] *= friction
    for name in ("steep_x", "steep_y"):
        models[name] /= friction
