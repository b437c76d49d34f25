"""Simulation of a run, or of a batch over robots, commands and starts.

The full dynamics are integrated, starts and reversals included; see simulator.integrator.run_kernel for how.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.command import Command
from simulator.dynamics.model import compile_robot, room_for
from simulator.dynamics.record import model_type
from simulator.errors import SimulationError
from simulator.integrator.batch import TOLERANCE_MM, integrate_many, integrate_one
from simulator.integrator.convergence import CHECKS, MOST_CHECK_STEPS, commands_beside, settled_mm, unsettled_mm
from simulator.integrator.run_kernel import DONE, MOST_STEPS
from simulator.nominal_robot import WHEELS
from simulator.robot import Robot
from simulator.run import Run, State
from simulator.wheel_states import wheel_states

Array = NDArray[np.float64]
LARGEST_LOGARITHM = 700.0  # of a double
# Slip relaxes within milliseconds for a robot of a gram, and within some tenths of a second for one of 50 kg; the state
# of the motors after earlier commands is known in closed form.
RUN_IN_S = 1.0


def simulate(
    robot: Robot | NDArray[np.void],
    command: Command,
    times_s: ArrayLike,
    start: State | None = None,
    run_index: int = 0,
    tolerance_mm: float = TOLERANCE_MM,
) -> Run:
    """Integrate the full dynamics from start at times_s[0]; outputs at times_s (n,), increasing.

    robot: a Robot with its effects, or its record from compile_robot, which does not hold the names of wheels.
    run_index: number of the run within its session, from 0. tolerance_mm: local error of a step for a robot of the
    paper's size; for others in proportion to their size (simulator.dynamics.scale). If added forces drag a robot away
    over sliding wheels, errors of its velocity do not decay, and its position may be wrong by up to 1e-3 of its path.
    Run.is_by_chance states that an arbitrarily small disturbance decides which turn is taken; Run.is_converged, that
    smaller step errors and slightly different speeds give the same motion. Raises SimulationError for times that do not
    increase or are not finite, and if the integration fails.
    """
    times = _checked_times(times_s)
    model: Any = (compile_robot(robot, run_index) if isinstance(robot, Robot) else robot)[0]
    problem = (model, command.knots, (start or State()).to_array(), times)
    states, grown = _followed(problem, tolerance_mm, MOST_STEPS)
    apart_mm = 0.0
    for finer in CHECKS:
        try:
            closer, closer_grown = _followed(problem, tolerance_mm / finer, MOST_CHECK_STEPS)
        except SimulationError:
            apart_mm = math.inf
            break
        apart_mm = unsettled_mm(states, closer, settled_mm(model))
        if apart_mm == 0.0:
            break
        states, grown = closer, closer_grown
    if apart_mm == 0.0:
        apart_mm = _beside_mm(problem, states, tolerance_mm)
    states.setflags(write=False)
    x, y, heading, u, v, yaw_rate = states.T
    return Run(
        *(times, x, y, heading, u, v, yaw_rate),
        lambda: wheel_states(model, command.knots, times, states),
        math.exp(min(grown, LARGEST_LOGARITHM)),
        robot.wheel_names if isinstance(robot, Robot) else _names(int(model["wheels"])),
        apart_mm,
    )


def _followed(problem: tuple[Any, Array, Array, Array], tolerance_mm: float, most_steps: int) -> tuple[Array, float]:
    """States (n, 6) at a tolerance, and the logarithm of the growth of disturbances. Raises SimulationError."""
    model, knots, state, times = problem
    states = np.empty((len(times), 6))
    # Writable copies: for read-only arrays the kernel would be compiled again.
    done, steps, grown = integrate_one(model, knots, state.copy(), times.copy(), states, tolerance_mm, most_steps)
    if done != DONE:
        raise SimulationError(
            f"the simulation did not finish within {steps} steps; "
            "are wheel speeds and effects plausible, or is the run too long?"
        )
    return states, grown


def _beside_mm(problem: tuple[Any, Array, Array, Array], usual: Array, tolerance_mm: float) -> float:
    """Distance, mm, between a run and runs with speeds changed within their uncertainty; 0 if they agree."""
    model, knots, start, times = problem
    found = 0.0
    for finer in (1.0, CHECKS[0]):  # a difference may come from the step errors of the changed runs
        near = [(model, changed, start, times) for changed in commands_beside(knots)]
        try:
            beside = [_followed(each, tolerance_mm / finer, MOST_CHECK_STEPS)[0] for each in near]
        except SimulationError:
            found = math.inf
            continue
        found = unsettled_mm(np.mean(beside, axis=0), usual, settled_mm(model))
        if found == 0.0:
            break
    return found


def moving_state(robot: Robot, command: Command, pose: State, at_s: float, run_index: int = 0) -> State:
    """A pose with the velocity that the robot has at at_s under the command, after RUN_IN_S from that of the pose.

    pose: with its velocity as measured near at_s, or none. The command forgets it, except where the robot has two
    motions to choose from, as in some turns on the spot: there it chooses.
    """
    run_in = simulate(robot, command, [at_s - RUN_IN_S, at_s], start=pose, run_index=run_index)
    return replace(
        pose,
        u_mm_s=float(run_in.u_mm_s[-1]),
        v_mm_s=float(run_in.v_mm_s[-1]),
        yaw_rate_rad_s=float(run_in.yaw_rate_rad_s[-1]),
    )


def _names(count: int) -> tuple[str, ...]:
    """Names of the wheels of a record."""
    return WHEELS if count == len(WHEELS) else tuple(f"wheel_{number + 1}" for number in range(count))


@dataclass(frozen=True)
class Batch:
    """Runs of a batch: states (n, t, 6) as x, y, heading, u, v, yaw rate in mm, rad, s; NaN for a run that failed.

    For summaries, t is 2: start and end. unsettled_mm: (n,), see Run.unsettled_mm; NaN for runs that were not checked.
    """

    time_s: Array
    states: Array
    unsettled_mm: Array

    @property
    def final(self) -> Array:
        """States at the end, (n, 6)."""
        return self.states[:, -1]

    @property
    def is_converged(self) -> NDArray[np.bool_]:
        """Whether a run was checked and found to be converged, (n,)."""
        return np.equal(self.unsettled_mm, 0.0)

    @property
    def curvature_per_mm(self) -> Array:
        """Curvature of the path at the end, (n,), positive for a centre to the robot's left; NaN at rest."""
        u, v, yaw_rate = self.final[:, 3:].T
        speed = np.hypot(u, v)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(speed > 0, np.where(u < 0, -1.0, 1.0) * yaw_rate / speed, np.nan)


def simulate_batch(
    robots: Sequence[Robot] | NDArray[np.void],
    commands: Sequence[Command],
    times_s: ArrayLike,
    starts: ArrayLike | None = None,
    *,
    summary: bool = False,
    tolerance_mm: float = TOLERANCE_MM,
    check: bool = False,
) -> Batch:
    """Simulate n runs in parallel; robots, commands and starts each hold n entries, or one that all runs share.

    robots: Robots or records (n,) of one dtype; starts: (n, 6), (6,) or None for rest at the origin. summary: keep
    start and end only, so that memory does not grow with the number of times. check: test convergence as `simulate`
    does, with smaller step errors and slightly different speeds. With summary, start and end are compared and their
    distance is taken as the length of the path, so that runs on a circle are reported as unconverged too often. A run
    whose integration fails is NaN. Raises SimulationError if the numbers of entries disagree.
    """
    times = _checked_times(times_s)
    kept = times[[0, -1]] if summary else times
    models = robots if isinstance(robots, np.ndarray) else _records(robots)
    begin = np.zeros((1, 6)) if starts is None else np.atleast_2d(np.asarray(starts, dtype=float))
    runs = max(len(models), len(commands), len(begin))
    for name, count in (("robots", len(models)), ("commands", len(commands)), ("starts", len(begin))):
        if count not in (1, runs):
            raise SimulationError(f"a batch of {runs} runs needs {runs} {name} or a single one; found {count}")
    batch = _Problems(
        models,
        _shared(len(models), runs),
        np.concatenate([command.knots for command in commands]),
        np.cumsum([0, *(len(command.time_s) for command in commands)]),
        _shared(len(commands), runs),
        np.array(np.broadcast_to(begin, (runs, 6)), order="C"),
        kept,
    )
    states = batch.states(np.arange(runs), tolerance_mm, MOST_STEPS)
    apart_mm = batch.settle(states, tolerance_mm) if check else np.full(runs, np.nan)
    for array in (states, apart_mm):
        array.setflags(write=False)
    return Batch(kept, states, apart_mm)


@dataclass(frozen=True)
class _Problems:
    """Runs to integrate: records of robots, concatenated knots of commands, starts (n, 6), common times.

    model, command: (n,), index of each run's robot and command; first: index of each command's first knot.
    """

    models: NDArray[np.void]
    model: NDArray[np.int64]
    knots: Array
    first: NDArray[np.int64]
    command: NDArray[np.int64]
    starts: Array
    times_s: Array

    def states(self, which: NDArray[np.int64], tolerance_mm: float, most_steps: int) -> Array:
        """States (m, t, 6) of some of the runs at a tolerance; NaN if the integration fails."""
        count, times = len(which), len(self.times_s)
        states = np.empty((count, times, 6))
        integrate_many(
            self.models,
            self.model[which],
            self.knots,
            self.first,
            self.command[which],
            self.starts[which],
            np.tile(self.times_s, count),
            np.arange(count + 1) * times,
            states.reshape(-1, 6),
            tolerance_mm,
            most_steps,
        )
        return states

    def settle(self, states: Array, tolerance_mm: float) -> Array:
        """Distance between each run and its solutions with smaller step errors or changed speeds, (n,); see `simulate`.

        0 if they agree; otherwise the more accurate solution replaces the usual one in states.
        """
        allowed_mm = settled_mm(self.models)[self.model]
        found, which = np.zeros(len(states)), np.arange(len(states))
        for finer in CHECKS:
            closer = self.states(which, tolerance_mm / finer, MOST_CHECK_STEPS)
            for run, other in zip(which, closer, strict=True):
                found[run] = _apart_mm(states[run], other, allowed_mm[run])
            again = np.isfinite(found[which]) & (found[which] > 0.0)
            which = which[again]
            if not len(which):
                break
            states[which] = closer[again]
        which = np.flatnonzero(found == 0.0)
        for finer in (1.0, CHECKS[0]):
            near = [replace(self, knots=knots) for knots in commands_beside(self.knots)]
            both = [each.states(which, tolerance_mm / finer, MOST_CHECK_STEPS) for each in near]
            for run, other in zip(which, np.mean(both, axis=0), strict=True):
                found[run] = _apart_mm(other, states[run], allowed_mm[run])
            which = which[found[which] > 0.0]
        return found


def _apart_mm(usual: Array, other: Array, allowed_mm: float) -> float:
    followed = np.isfinite(usual).all() and np.isfinite(other).all()
    return unsettled_mm(usual, other, allowed_mm) if followed else math.inf


def _records(robots: Sequence[Robot]) -> NDArray[np.void]:
    slots = room_for(robots)
    models = np.empty(len(robots), model_type(slots))
    for number, robot in enumerate(robots):
        models[number] = compile_robot(robot, slots=slots)[0]
    return models


def _shared(count: int, runs: int) -> NDArray[np.int64]:
    return np.arange(runs) if count == runs else np.zeros(runs, dtype=np.int64)


def _checked_times(times_s: ArrayLike) -> Array:
    times = np.array(times_s, dtype=float)
    if times.ndim != 1 or len(times) < 2 or not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise SimulationError("times of a simulation must be at least two finite numbers that increase")
    times.setflags(write=False)
    return times
