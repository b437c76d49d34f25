"""turnscope's corrected model of a driven robot, with bands: late motors, a drive that mixes its sides, slip.

The robot of robot.toml is simulated with its four driven wheels. What is fitted to the commands and poses of the fitted
windows: dead time and time constant of the motors (command-lag), the gains of the common part and of the difference of
the two commands and how far the difference is limited (an own effect, of the commands), and factors of friction and
stiffness of the slip law, held near 1 by a prior.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from simulator.command import RPM_PER_RAD_S, Command
from simulator.effects.entry import EffectEntry
from simulator.robot import Robot
from simulator.simulation import RUN_IN_S, simulate_batch
from tests.benchmarks.husky.drive import Drive, command_of
from tests.benchmarks.husky.peers import SIGMAS, wrapped

Array = NDArray[np.float64]
MM_PER_M = 1000.0
CHECKED = (0.25, 0.5, 0.75, 1.0)  # shares of a window at whose last fresh pose prediction and measurement are compared
TOLERANCE_MM = 1e-4
COVERED = 0.95


@dataclass(frozen=True)
class Number:
    """A number that is fitted: as start · exp(free), or start + free; sigma: of its prior."""

    start: float
    sigma: float
    logarithmic: bool = True

    def value(self, free: float) -> float:
        """The number at a coordinate."""
        return self.start * float(np.exp(free)) if self.logarithmic else self.start + free


# Lengths of times and gains of an ordinary drive; wide priors but for what the robot file states.
NUMBERS: dict[str, Number] = {
    "dead_time_s": Number(0.2, 1.0),
    "time_constant_s": Number(0.2, 1.0),
    "common": Number(1.0, 0.5),
    "difference": Number(1.0, 0.5),
    "difference_limit_rad_s": Number(10.0, 1.5),
    "common_limit_rad_s": Number(10.0, 1.5),
    "longitudinal_friction": Number(1.0, 0.3),
    "lateral_friction": Number(1.0, 0.3),
    "longitudinal_stiffness": Number(1.0, 0.5),
    "lateral_stiffness": Number(1.0, 0.5),
}
SLIP = ("longitudinal_friction", "lateral_friction", "longitudinal_stiffness", "lateral_stiffness")


@dataclass(frozen=True)
class Corrected:
    """A fitted model: its numbers with their standard deviations, and what it leaves at the end of fitted windows."""

    values: Mapping[str, float]
    relative_sigma: Mapping[str, float]
    scatter: Array  # (3,), see bands


def mixed(command: Command, values: Mapping[str, float]) -> Command:
    """What the drive makes of a command: common part and difference have their own gains, and the difference a limit.

    It shrinks as 1/√(1 + (difference/limit)² + (common/limit)²), with both limits in rad/s of the command as it is.
    """
    common = (command.left_rpm + command.right_rpm) / 2
    difference = command.right_rpm - command.left_rpm
    limits = (RPM_PER_RAD_S * values[f"{name}_limit_rad_s"] for name in ("difference", "common"))
    shrinking = np.sqrt(1 + sum((part / limit) ** 2 for part, limit in zip((difference, common), limits, strict=True)))
    half = values["difference"] * difference / shrinking / 2
    return Command(command.time_s, values["common"] * common - half, values["common"] * common + half)


def corrected_robot(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with late motors and another slip law."""
    slip = robot.slip.model_copy(update={name: getattr(robot.slip, name) * values[name] for name in SLIP})
    lag = {"id": "command-lag", "dead_time_s": values["dead_time_s"], "time_constant_s": values["time_constant_s"]}
    return robot.model_copy(update={"slip": slip, "effect": (*robot.effect, EffectEntry.model_validate(lag))})


class Model:
    """A robot and the commands of a drive, simulated again and again."""

    def __init__(self, robot: Robot, drive: Drive) -> None:
        """Take the commands of all windows, with what was before them."""
        self.robot, self.drive = robot, drive
        self._commands = [command_of(*drive.log(window)) for window in range(len(drive))]
        before = np.arange(-round(RUN_IN_S / drive.interval_s), 0) * drive.interval_s
        self._times = np.r_[before, drive.time_s]
        self._first = len(before)

    def poses(self, values: Mapping[str, float], windows: NDArray[np.int64]) -> Array:
        """Poses (k, m, 3), m and rad, of some windows from their starts; NaN where the motion cannot be followed."""
        robot = corrected_robot(self.robot, values)
        commands = [mixed(self._commands[window], values) for window in windows]
        states = simulate_batch([robot], commands, self._times, tolerance_mm=TOLERANCE_MM).states
        pose = states[:, self._first :, :3]
        off = pose[..., :2] - pose[:, :1, :2]
        cos, sin = np.cos(pose[:, :1, 2]), np.sin(pose[:, :1, 2])
        x, y = cos * off[..., 0] + sin * off[..., 1], cos * off[..., 1] - sin * off[..., 0]
        return np.stack([x / MM_PER_M, y / MM_PER_M, pose[..., 2] - pose[:, :1, 2]], axis=-1)

    def misfit(self, poses: Array, windows: NDArray[np.int64]) -> Array:
        """Predicted minus measured poses (k, c, 3) at the last fresh sample before each of CHECKED, in SIGMAS.

        Where the motion cannot be followed, a misfit that no fit keeps.
        """
        rows = np.stack([self._checked(window) for window in windows])
        at = np.arange(len(windows))[:, None]
        off = poses[at, rows] - self.drive.pose[windows[:, None], rows]
        off[..., 2] = wrapped(off[..., 2])
        return np.where(np.isfinite(off), off / SIGMAS, 20.0)

    def _checked(self, window: int) -> NDArray[np.int64]:
        fresh = np.flatnonzero(self.drive.fresh[window])
        wanted = np.array(CHECKED) * (len(self.drive.time_s) - 1)
        return np.asarray(fresh[np.maximum(np.searchsorted(fresh, wanted, side="right") - 1, 0)])


def fit(model: Model, windows: NDArray[np.int64]) -> Corrected:
    """Fit the numbers to some windows by robust least squares with their priors."""
    names = list(NUMBERS)
    sigmas = np.array([item.sigma for item in NUMBERS.values()])

    def values(free: Array) -> dict[str, float]:
        return {name: NUMBERS[name].value(float(part)) for name, part in zip(names, free, strict=True)}

    def cost(free: Array) -> Array:
        poses = model.poses(values(free), windows)
        left = model.misfit(poses, windows).ravel()
        # Misfits beyond some sigmas, of a robot that was not where its commands say, count in proportion to their size.
        size = np.sqrt(2 * (np.sqrt(1 + left**2) - 1))
        return np.r_[np.copysign(size, left), free / sigmas]

    found = least_squares(cost, np.zeros(len(names)), diff_step=1e-3, x_scale=0.3 * np.ones(len(names)), max_nfev=25)
    spread = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    chosen = values(found.x)
    last = model.poses(chosen, windows)[:, -1]
    return Corrected(chosen, dict(zip(names, spread, strict=True)), _scatter(last, model.drive.pose[windows, -1]))


def _scatter(predicted: Array, measured: Array) -> Array:
    """Half-widths (3,) that hold COVERED of the fitted windows, in units of widths()."""
    off = np.abs(predicted - measured)
    off[:, 2] = np.abs(wrapped(off[:, 2]))
    # As many parts as a new window would need: the rank of order statistics of one more.
    rank = min(COVERED * (len(off) + 1) / len(off), 1.0)
    return np.asarray(np.nanquantile(off / widths(predicted), rank, axis=0))


def widths(predicted: Array) -> Array:
    """How the error of a prediction (n, 3) may be expected to grow, (n, 3) in m, m, rad: with the way and the turn."""
    way, turn = np.hypot(predicted[:, 0], predicted[:, 1]), np.abs(predicted[:, 2])
    place = SIGMAS[0] * (0.5 + way)
    return np.stack([place, place, SIGMAS[2] * (0.5 + turn)], axis=1)


def bands(model: Corrected, predicted: Array) -> Array:
    """95 % half-widths (n, 3) of predictions (n, 3), from what the model leaves of the fitted windows."""
    return model.scatter * widths(predicted)
