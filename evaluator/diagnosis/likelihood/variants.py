"""Robots with changed nominal values and added terms, compiled for the simulator and shared by tasks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from threading import Lock

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from evaluator.diagnosis.candidates.free_form import FreeTerm
from evaluator.diagnosis.likelihood.known_to import (
    CLOCK,
    GRAVITY,
    LEVEL,
    RADIUS_DIFFERENCE,
    SIMULATED,
    START,
    TURNS,
    amount_of,
)
from evaluator.diagnosis.likelihood.run_data import RunData, Task, Values, is_shared
from evaluator.robot_geometry import reference_places
from simulator.dynamics.model import apply_effects, record_of, room_for
from simulator.dynamics.terms import is_of_plate
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate
from simulator.effects.draft import Draft
from simulator.effects.view import View
from simulator.errors import SimulationError
from simulator.observation import view_of
from simulator.robot import Robot

MOST_VARIANTS = 5000  # of some kB each
_compiling = Lock()  # threads share the variants


@dataclass(frozen=True)
class Variant:
    """A robot with changed nominal values and added terms, which many runs share.

    record: compiled model with nominal friction as words, None if it cannot be simulated; shared by all variants with
    the same motion. of_place, of_direction: whether its motion depends on position and direction on the plate.
    """

    record: NDArray[np.int64] | None
    view: View
    of_place: bool = True
    of_direction: bool = True

    def begin(self, pose: Sequence[float]) -> tuple[float, float, float]:
        """The pose at which to simulate a run, equal for all start poses with the same motion."""
        x, y, heading = pose
        if self.of_place:
            return x, y, heading
        return 0.0, 0.0, heading if self.of_direction else 0.0


@dataclass(frozen=True)
class _Asked:
    """Common parameters of a task.

    task: kept so that the identities of its mappings are not reused. ordered: whether an effect varies from run to run.
    nominal: deviations that act in a simulation. lasting: key of the parameters.
    """

    task: Task
    ordered: bool
    nominal: Mapping[str, float]
    lasting: tuple[object, ...]


class Variants:
    """The variants of an experiment's robots, compiled on first use; threads may share them.

    slots: number of terms for which the records of all robots have space.
    """

    def __init__(self, robots: Sequence[Robot], terms: Mapping[str, Candidate], known: Mapping[str, float]) -> None:
        """robots: one per run. terms, known: see Simulated."""
        self.slots = room_for(tuple(robots))
        self._robots, self._terms, self._known = tuple(robots), terms, known
        self._kinds = [self._robots.index(robot) for robot in self._robots]  # equal robots have equal variants
        self._places = {kind: reference_places(self._robots[kind]) for kind in set(self._kinds)}  # of the file
        self._found: dict[tuple[object, ...], Variant] = {}
        self._asked: dict[tuple[int, int, int], _Asked] = {}
        self._records: dict[bytes, NDArray[np.int64]] = {}

    def of(self, tasks: Sequence[Task], data: Sequence[RunData]) -> list[Variant]:
        """The variant of every task; tasks with equal common parameters share one."""
        with _compiling:
            return self._of(tasks, data)

    def _of(self, tasks: Sequence[Task], data: Sequence[RunData]) -> list[Variant]:
        if max(len(self._found), len(self._asked)) > MOST_VARIANTS:
            self._found.clear()
            self._asked.clear()
            self._records.clear()
        here: dict[tuple[int, int, int, int], Variant] = {}
        result = []
        for task in tasks:
            kind, order = self._kinds[task.run], data[task.run].order
            shared = kind, id(task.nominal), id(task.terms)  # tasks of a linearization share their mappings
            asked = self._asked.get(shared)
            if asked is None:
                asked = self._asked[shared] = self._of_point(kind, task)
            place = *shared, order if asked.ordered else 0
            if place not in here:
                key = place[3], asked.lasting
                if key not in self._found:
                    self._found[key] = self._compiled(kind, place[3], asked.nominal, task.terms)
                here[place] = self._found[key]
            result.append(here[place])
        return result

    def _of_point(self, kind: int, task: Task) -> _Asked:
        effects = *task.terms, *(entry.id for entry in self._robots[kind].effect)
        nominal = {
            name: value
            for name, value in task.nominal.items()
            if not is_shared(name) or (name in SIMULATED and name in self._known and name != START)
        }
        lasting = kind, *nominal.items(), *task.terms.items()
        return _Asked(task, any(map(varies_by_run, effects)), nominal, lasting)

    def _compiled(self, kind: int, order: int, nominal: Mapping[str, float], terms: Values) -> Variant:
        robot = varied_robot(self._robots[kind], {key: value for key, value in nominal.items() if not is_shared(key)})
        view, draft = view_of(robot, self._places[kind]), Draft(robot, order)
        try:
            apply_effects(draft, robot.effect)
            self._add_known(nominal, draft, view)
            for effect, values in terms.items():
                add_term(self._terms[effect], values, draft, view)
            record = record_of(draft, slots=self.slots).view(np.int64)
            record = self._records.setdefault(record.tobytes(), record)
            of_place = any(term.depends_on_place for term in draft.terms)
            of_direction = any(is_of_plate(term.channel, term.basis) for term in draft.terms)
            return Variant(record, view, of_place, of_direction)
        except SimulationError:
            return Variant(None, view)  # cannot be simulated: marks are NaN, and a fit shortens its step

    def _add_known(self, nominal: Mapping[str, float], draft: Draft, view: View) -> None:
        """Apply deviations of quantities known to a tolerance to a draft, or to the view of its marks."""
        view.time_factor *= 1 + amount_of(nominal, CLOCK, self._known)
        half = amount_of(nominal, RADIUS_DIFFERENCE, self._known) / 2
        draft.speed_factor *= np.array([1 + half, 1 - half])
        for side, key in enumerate(TURNS):
            more = amount_of(nominal, key, self._known)
            draft.mix[side, side] += more
            draft.speed_factor[side] /= 1 + more
        down_x, down_y = (amount_of(nominal, key, self._known) for key in LEVEL)
        if down_x or down_y:
            tilt = {"angle_deg": math.hypot(down_x, down_y), "azimuth_deg": math.degrees(math.atan2(down_y, down_x))}
            _act("plate-tilt", draft, tilt)
        x, y = (amount_of(nominal, key, self._known) for key in GRAVITY)
        if x or y:
            _act("mass-offset", draft, {"x_mm": x, "y_mm": y})


def add_term(term: Candidate, values: tuple[float, ...], draft: Draft, view: View) -> None:
    """Apply one term to a draft, or to the view of its marks."""
    if isinstance(term, FreeTerm):
        parts = term.kernel_terms(values)
        draft.add(*(part for part in parts if not part.is_seen_only))
        view.errors += tuple(part for part in parts if part.is_seen_only)
        return
    act, see = EFFECTS[term.id].act, EFFECTS[term.id].view
    if act is not None:
        act(draft, term.physical(values))
    if see is not None:
        see(view, term.physical(values))


def depends_on_place(robot: Robot, terms: Iterable[Candidate]) -> bool:
    """Whether the motion or the observation of a robot with these terms depends on its position."""
    view, draft = view_of(robot, reference_places(robot)), Draft(robot)
    try:
        apply_effects(draft, robot.effect)
        for term in terms:
            usual = tuple(item.absent + item.step for item in term.coordinates)
            add_term(term, term.starts[0] if term.starts else usual, draft, view)
        draft.finish()
    except SimulationError:
        return True  # unknown
    return view.bends_with_place or any(term.depends_on_place for term in draft.terms)


def varies_by_run(effect: str) -> bool:
    """Whether an effect varies from run to run of a session; others are compiled once for all runs of a robot."""
    return effect in EFFECTS and EFFECTS[effect].varies_by_run


def _act(effect: str, draft: Draft, values: Mapping[str, float]) -> None:
    act = EFFECTS[effect].act
    assert act is not None
    act(draft, values)


def varied_robot(robot: Robot, deviations: Mapping[str, float]) -> Robot:
    """The robot with nominal values, by dotted key, multiplied by 1 + deviation; in a [[wheel]] list those of each."""
    factors: dict[str, dict[str, float]] = {}
    for key, deviation in deviations.items():
        if deviation:
            table, name = key.split(".")
            factors.setdefault(table, {})[name] = 1 + deviation
    if not factors:
        return robot

    def scaled(part: BaseModel, by: Mapping[str, float]) -> BaseModel:
        return part.model_copy(update={name: getattr(part, name) * factor for name, factor in by.items()})

    tables = {table: getattr(robot, table) for table in factors}
    changed = {
        table: tuple(scaled(item, factors[table]) for item in part)
        if isinstance(part, tuple)
        else scaled(part, factors[table])
        for table, part in tables.items()
    }
    return robot.model_copy(update=changed)
