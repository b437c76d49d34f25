"""Random runs, and how far their solution is from one of finer steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulator.command import Command
from simulator.dynamics.model import compile_robot
from simulator.effects.catalogue import EFFECTS
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.integrator.batch import TOLERANCE_MM
from simulator.robot import Robot, load_robot
from simulator.simulation import _followed, simulate

# Two orders above the tolerance of a step, and the 1e-3 of the way that `simulate` states for robots which added forces
# drag over sliding wheels.
ALLOWED_MM, ALLOWED_SHARE = 0.01, 1e-3
FINER, MOST_STEPS = 1000.0, 1_000_000
STEPS_AWAY = 15.0  # an effect is drawn up to so many of its steps from absent
LONGEST_S = 4.0
WHEELS = ("tire", "column", "barrel")


@dataclass(frozen=True)
class Drawn:
    """One random run."""

    robot: Robot
    command: Command
    times_s: np.ndarray


def drawn(rng: np.random.Generator) -> Drawn:
    """Draw a run."""
    entries = []
    of_plate = sorted(id_ for id_, effect in EFFECTS.items() if not effect.of_ground)  # the robots are small
    for effect_id in rng.choice(of_plate, size=rng.integers(0, 3), replace=False):
        values = {}
        for item in EFFECTS[str(effect_id)].parameters:
            low = 0.0 if item.absent - STEPS_AWAY * item.step < item.at_least else -STEPS_AWAY
            values[item.name] = float(item.absent + rng.uniform(low, STEPS_AWAY) * item.step)
        entries.append(EffectEntry.model_validate({"id": str(effect_id), **values}))
    robot = load_robot(str(rng.choice(WHEELS))).model_copy(update={"effect": tuple(entries)})
    duration = float(rng.uniform(0.5, LONGEST_S))
    return Drawn(robot, _command(rng, duration), np.linspace(0.0, duration, 121))


def _command(rng: np.random.Generator, duration: float) -> Command:
    """One to three levels, between them jumps and ramps; a wheel stands at every tenth."""
    count = int(rng.integers(1, 4))
    begin = np.sort(np.append(0.0, rng.uniform(0, duration, count - 1)))
    rpm = rng.uniform(-130, 130, (count, 2)) * (rng.random((count, 2)) > 0.1)
    knots = [(0.0, *rpm[0])]
    for at, before, after in zip(begin[1:], rpm, rpm[1:], strict=False):
        ramp = float(rng.choice([0.0, 10 ** rng.uniform(-2, 0)]))
        start = max(at, knots[-1][0])
        knots += [(start, *before), (start + ramp, *after)]
    return Command(*np.transpose(knots))


def disagreement_mm(run: Drawn) -> tuple[float, float, bool]:
    """Largest distance of the two solutions, the length of the way, and whether the coarser says it is no solution.

    The distance is NaN where the motion cannot be followed at the finer tolerance.
    """
    try:
        usual = simulate(run.robot, run.command, run.times_s)
    except SimulationError:
        return np.inf, 0.0, True
    says_so = usual.is_by_chance or not usual.is_converged
    if says_so:
        return np.inf, 0.0, True
    problem = (compile_robot(run.robot)[0], run.command.knots, np.zeros(6), run.times_s)
    try:
        finer, _ = _followed(problem, TOLERANCE_MM / FINER, MOST_STEPS)
    except SimulationError:
        return np.nan, 0.0, False
    apart = np.hypot(usual.x_mm - finer[:, 0], usual.y_mm - finer[:, 1])
    way = float(np.hypot(*np.diff(finer[:, :2], axis=0).T).sum())
    return float(apart.max()), way, False
