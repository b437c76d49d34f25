"""One simulated run, or a map of steady turns, of a robot by its name, file or value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from evaluator.errors import InputError
from evaluator.files import read_with, write_text
from evaluator.settings import FASTEST_RPM
from simulator.command import Command
from simulator.robot import Robot, load_robot
from simulator.run import Run, State
from simulator.simulation import simulate as simulate_run
from simulator.steady import steady_map

MOST_ROWS = 1_000_000  # of a table: half a minute, 230 MB, and as many as a spreadsheet opens


def simulate(
    robot: Robot | Path | str,
    left_rpm: float | None = None,
    right_rpm: float | None = None,
    *,
    duration_s: float,
    commands: Command | Path | str | None = None,
    start_s: float = 0.0,
    stop_s: float | None = None,
    start: State | None = None,
    rate_hz: float = 60.0,
) -> Run:
    """Simulate one run from rest: pose, velocities, and slip and friction of every wheel over time.

    robot: a shipped name, a robot.toml or a Robot; commands: a log (`time_s, left_rpm, right_rpm`; each value holds
    until the next, as in an experiment) or a Command instead of constant speeds; start_s: motors on, or time at which
    the clock of a log reads 0; stop_s: motors off; start: pose at time 0, by default the origin of the plate.
    Raises InputError, SimulationError.
    """
    if commands is None and (left_rpm is None or right_rpm is None):
        raise InputError("expected the speed of both sides (--left, --right) or a command log (--command)")
    if commands is not None and not (left_rpm is None and right_rpm is None):
        raise InputError("expected either speeds (--left, --right) or a command log (--command), not both")
    if commands is not None and stop_s is not None:
        raise InputError("a command log says when the motors stop: leave out --stop-s, or end the log with zeros")
    for name, value in {"duration": duration_s, "rate": rate_hz}.items():
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"the {name} must be a positive number; found {value}")
    if duration_s * rate_hz >= MOST_ROWS:
        raise InputError(
            f"a duration of {duration_s:g} s at a rate of {rate_hz:g} Hz is {duration_s * rate_hz:.3g} rows; at most "
            f"{MOST_ROWS:,} are written: give a shorter duration or a lower rate"
        )
    rows = round(duration_s * rate_hz) + 1
    if rows < 2:
        raise InputError(f"a duration of {duration_s} s at a rate of {rate_hz} Hz holds no second row")
    _refuse_too_fast(left_rpm or 0.0, right_rpm or 0.0)
    if commands is not None:
        read = commands if isinstance(commands, Command) else read_with(Command.held, Path(commands))
        command = read.retimed(later_s=start_s)
    else:
        command = Command.constant(left_rpm or 0.0, right_rpm or 0.0, start_s, stop_s)
    return simulate_run(robot_of(robot), command, np.arange(rows) / rate_hz, start or State())


def steady_turns(robot: Robot | Path | str, left_rpm: Sequence[float], ratios: Sequence[float]) -> pd.DataFrame:
    """Steady turn of a robot at every left speed and every ratio right/left, a row each.

    Columns: left_rpm, right_rpm, ratio, radius_mm (signed, positive to the left; infinite on a straight line),
    speed_mm_s, yaw_rate_deg_s. NaN if there is no steady turn. Neighbouring ratios should be given in order.
    Raises InputError, SimulationError.
    """
    _refuse_too_fast(*left_rpm, *(rpm * ratio for rpm in left_rpm for ratio in ratios))
    found = steady_map(robot_of(robot), left_rpm, ratios)
    left, ratio = np.meshgrid(found.left_rpm, found.ratio, indexing="ij")
    curvature = found.curvature_per_mm.ravel()
    with np.errstate(divide="ignore"):
        radius = np.where(curvature == 0, np.inf, 1 / curvature)
    columns = {
        "left_rpm": left.ravel(),
        "right_rpm": (left * ratio).ravel(),
        "ratio": ratio.ravel(),
        "radius_mm": radius,
        "speed_mm_s": np.hypot(found.u_mm_s, found.v_mm_s).ravel(),
        "yaw_rate_deg_s": np.degrees(found.yaw_rate_rad_s).ravel(),
    }
    return pd.DataFrame(columns)


def export_robot(
    robot: Robot | Path | str, output: Path | str, left_rpm: float = 33.3, right_rpm: float = 14.4, kind: str = "mjcf"
) -> tuple[str, ...]:
    """Write a robot for MuJoCo ("mjcf") or Gazebo ("sdf"), matched at the steady turn of a command.

    Returns sentences about properties that cannot be exported.

    Raises InputError and SimulationError as robot_of, InputError for a command at which the robot stands, and
    SimulationError for a robot with effects.
    """
    from simulator.exchange.losses import losses
    from simulator.exchange.mjcf import mjcf
    from simulator.exchange.sdf import sdf

    _refuse_too_fast(left_rpm, right_rpm)
    if left_rpm == right_rpm == 0:
        raise InputError(
            "the robot stands at 0 / 0 rpm, and friction is matched at a turn: give the speeds of one (--left, --right)"
        )
    described = robot_of(robot)
    write_text(Path(output), (sdf if kind == "sdf" else mjcf)(described, left_rpm, right_rpm))
    return losses(described, left_rpm, right_rpm, kind)


def _refuse_too_fast(*speeds_rpm: float) -> None:
    """Refuse speeds that an experiment cannot have either, of which no equation of motion is solved in doubles."""
    fastest = max(speeds_rpm, key=abs)
    if abs(fastest) > FASTEST_RPM:
        raise InputError(f"a speed of {fastest:g} rpm is beyond every motor; give at most {FASTEST_RPM:,.0f} rpm")


def robot_of(robot: Robot | Path | str) -> Robot:
    """A robot by its shipped name, its file, or itself. Raises InputError, SimulationError."""
    return robot if isinstance(robot, Robot) else read_with(load_robot, Path(robot))
