"""The runs of a steady-state circular test (ISO 4138): both sides and directions, several speeds, repetitions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import pandas as pd

from evaluator.errors import InputError
from evaluator.workflow.diagnosis.planned_experiment import write_planned
from evaluator.workflow.simulation import robot_of
from simulator.robot import Robot
from simulator.steady import steady_turn

CIRCLES = 1.25  # of a run: a full circle after the transient of the start
LONGEST_S, SHORTEST_S = 60.0, 3.0  # limits of the duration, for manageable recordings that can still be fitted
LEVELS_RPM = (15.0, 30.0, 45.0, 60.0)  # in even steps, for a slope over the lateral acceleration
RATIOS = (0.43, 0.7)  # a tight turn, that of the paper's Figure 19, and a wide one
FARTHEST = 1e-3  # relative tolerance of a radius


@dataclass(frozen=True)
class CircularRun:
    """A planned run: command, duration, and the circle predicted by the model."""

    left_rpm: float
    right_rpm: float
    duration_s: float
    radius_mm: float
    speed_mm_s: float


def circular_runs(
    robot: Robot | Path | str = "barrel",
    *,
    rpm: Sequence[float] = LEVELS_RPM,
    ratios: Sequence[float] = RATIOS,
    radius_mm: float | None = None,
    repetitions: int = 3,
) -> list[CircularRun]:
    """The runs of a circular test in order, at constant commands, or at a constant radius if one is given.

    rpm: speeds of the faster wheel; ratios: slower over faster wheel. All speeds, sides and directions are driven once
    before any is repeated, so that a drift over the session does not appear as an influence of speed. Raises InputError
    for unusable values and for a radius at which the robot cannot turn, and as load_robot does.
    """
    described = robot_of(robot)
    levels = sorted(set(rpm))
    if len(levels) < 3 or min(levels) <= 0 or not all(map(math.isfinite, levels)):
        raise InputError(
            f"{', '.join(f'{level:g}' for level in rpm)} rpm: a circular test needs at least three speeds above 0"
        )
    if radius_mm is None and not (ratios and all(-1 < ratio < 1 for ratio in ratios)):
        raise InputError("the ratio of slower to faster wheel must lie between -1 and 1, exclusive")
    if radius_mm is not None and not (math.isfinite(radius_mm) and radius_mm > 0):
        raise InputError(f"a radius of {radius_mm:g} mm is none; give one above 0")
    pairs = [
        (level, ratio)
        for level in levels
        for ratio in (ratios if radius_mm is None else [_ratio_at(described, level, radius_mm)])
    ]
    cells = [_run(described, *cell) for cell in _cells(pairs)]
    return cells * repetitions


def write_circular_test(runs: Sequence[CircularRun], robot: str, output: Path | str) -> list[Path]:
    """Write an experiment.toml with these runs and their command files; see write_planned."""
    return write_planned(runs, "steady-state circular test", robot, output)


def simulated_turns(robot: Robot, commands: pd.DataFrame) -> pd.DataFrame:
    """Steady turns of a robot at commands (left_rpm, right_rpm), in the columns of turning.csv that a test reads."""
    known: dict[tuple[float, float], tuple[float, float, float]] = {}
    for left, right in zip(commands["left_rpm"], commands["right_rpm"], strict=True):
        if (left, right) not in known:
            turn = steady_turn(robot, left, right)
            speed = math.copysign(turn.speed_mm_s, turn.u_mm_s)
            slip = math.degrees(math.atan2(turn.v_mm_s, abs(turn.u_mm_s)))
            known[left, right] = speed, math.degrees(turn.yaw_rate_rad_s), slip
    keys = zip(commands["left_rpm"], commands["right_rpm"], strict=True)
    columns = ["speed_mm_s", "yaw_rate_deg_s", "body_slip_angle_deg"]
    found = pd.DataFrame([known[key] for key in keys], columns=columns, index=commands.index)
    return pd.concat([commands, found], axis=1)


def _cells(pairs: Sequence[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """Commands (left, right) of all pairs of speed and ratio, sides and directions."""
    for (level, ratio), direction, side in product(pairs, (1, -1), (1, -1)):
        faster, slower = direction * level, direction * round(level * ratio, 3)
        yield (slower, faster) if side > 0 else (faster, slower)


def _run(robot: Robot, left: float, right: float) -> CircularRun:
    turn = steady_turn(robot, left, right)
    circle_s = 2 * math.pi / max(abs(turn.yaw_rate_rad_s), 1e-9)
    duration = round(min(max(CIRCLES * circle_s, SHORTEST_S), LONGEST_S), 1)
    return CircularRun(left, right, duration, abs(turn.radius_mm), turn.speed_mm_s)


def _ratio_at(robot: Robot, level: float, radius_mm: float) -> float:
    """Ratio of the slower to the faster wheel at which the robot turns with a radius."""
    from scipy.optimize import brentq

    def tighter(ratio: float) -> float:
        return abs(steady_turn(robot, level * ratio, level).curvature_per_mm) * radius_mm - 1

    widest, tightest = 1 - FARTHEST, 0.0
    if tighter(widest) > 0 or tighter(tightest) < 0:
        least = abs(steady_turn(robot, 0.0, level).radius_mm)
        raise InputError(
            f"{robot.name} does not turn with a radius of {radius_mm:g} mm at {level:g} rpm; with the slower wheel "
            f"between standing and nearly as fast as the other it turns with {least:.4g} mm or more"
        )
    return float(brentq(tighter, tightest, widest, xtol=1e-6))
