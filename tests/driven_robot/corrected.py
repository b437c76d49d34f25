"""turnscope's corrected model of a driven robot: late motors, a drive that mixes its sides and limits its wheels, slip.

The robot of robot.toml is simulated with its four driven wheels. What is fitted to the commands and poses of the fitted
windows: dead time and time constant of the motors (command-lag), the gains of the common part and of the difference of
the two commands (a form that a diagnosis offers as an own effect), the limits of the wheels and of both parts
(speed-limit), and factors of friction and stiffness of the slip law, held near 1 by a prior.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from simulator.command import RPM_PER_RAD_S
from simulator.dynamics.model import compile_robot
from simulator.dynamics.motors import held_drive
from simulator.dynamics.terms import UN_PER_MN
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.robot import Robot
from simulator.simulation import RUN_IN_S, simulate_batch
from tests.driven_robot.drive import Drive, command_of
from tests.driven_robot.peers import SIGMAS, wrapped

Array = NDArray[np.float64]
MM_PER_M = 1000.0
CHECKED = (0.25, 0.5, 0.75, 1.0)  # shares of a window at whose last fresh pose prediction and measurement are compared
TOLERANCE_MM = 1e-4
STEP = 0.05  # of a difference, in standard deviations of the prior
STARTS, STARTING_SHARE, FEW_STEPS, MOST_STEPS = 10, 0.7, 10, 25


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
    # of the median of the commanded speeds of the wheels
    **{f"{part}_limit": Number(1.0, 1.0) for part in ("wheel", "ahead", "turn")},
    # limits of acceleration, of the same median in a second
    **{f"{part}_ramp_per_s": Number(1.0, 1.0) for part in ("ahead", "turn")},
    "longitudinal_friction": Number(1.0, 0.3),
    "lateral_friction": Number(1.0, 0.3),
    "longitudinal_stiffness": Number(1.0, 0.5),
    "lateral_stiffness": Number(1.0, 0.5),
    "drag_of_weight": Number(0.1, 0.5),
    "gravity_x_m": Number(0.0, 0.1, logarithmic=False),
    "pose_x_m": Number(0.0, 0.2, logarithmic=False),
}
SLIP = ("longitudinal_friction", "lateral_friction", "longitudinal_stiffness", "lateral_stiffness")


@dataclass(frozen=True)
class Corrected:
    """A fitted model: its numbers, and their standard deviations, relative where a number cannot be nought."""

    values: Mapping[str, float]
    sigma: Mapping[str, float]


def corrected_robot(robot: Robot, values: Mapping[str, float], usual_rpm: float) -> Robot:
    """The robot with late motors, its drive, another slip law, a drag along it and its centre of gravity elsewhere.

    usual_rpm: what limits of speed and acceleration are relative to.
    """
    slip = robot.slip.model_copy(update={name: getattr(robot.slip, name) * values[name] for name in SLIP})
    lag = {"id": "command-lag", "dead_time_s": values["dead_time_s"], "time_constant_s": values["time_constant_s"]}
    limits = {f"{part}_rpm": usual_rpm * values[f"{part}_limit"] for part in ("wheel", "ahead", "turn")}
    ramps = {f"{part}_rpm_s": usual_rpm * values[f"{part}_ramp_per_s"] for part in ("ahead", "turn")}
    gains = {side: values["common"] / 2 + sign * values["difference"] / 2 for side, sign in (("own", 1), ("other", -1))}
    mixing = [
        {
            "id": "free-form",
            "channel": f"{wheels}_drive",
            "basis": f"{command}_command",
            "coefficient": gains["own"] - 1 if wheels == command else gains["other"],
        }
        for wheels in ("left", "right")
        for command in ("left", "right")
    ]
    drag_mN = values["drag_of_weight"] * robot.weight_uN / UN_PER_MN
    drag = {"id": "free-form", "channel": "force_forward", "basis": "sign_u", "coefficient": -drag_mN}
    gravity = {"id": "mass-offset", "x_mm": MM_PER_M * values["gravity_x_m"], "y_mm": 0.0}
    entries = (lag, {"id": "speed-limit", **limits}, {"id": "acceleration-limit", **ramps}, *mixing, drag, gravity)
    effects = tuple(map(EffectEntry.model_validate, entries))
    return robot.model_copy(update={"slip": slip, "effect": (*robot.effect, *effects)})


class Model:
    """A robot and the commands of a drive, simulated again and again."""

    def __init__(self, robot: Robot, drive: Drive) -> None:
        """Take the commands of all windows, with what was before them."""
        self.robot, self.drive = robot, drive
        told = np.abs(drive.command_rad_s)
        self.usual_rpm = RPM_PER_RAD_S * float(np.median(told[told > 0]))
        self._commands = [command_of(*drive.log(window)) for window in range(len(drive))]
        before = np.arange(-round(RUN_IN_S / drive.interval_s), 0) * drive.interval_s
        self._times = np.r_[before, drive.time_s]
        self._first = len(before)

    def poses(self, values: Mapping[str, float], windows: NDArray[np.int64]) -> Array:
        """Poses (k, m, 3), m and rad, of some windows from their starts; NaN where the motion cannot be followed."""
        robot = corrected_robot(self.robot, values, self.usual_rpm)
        commands = [self._commands[window] for window in windows]
        try:
            states = simulate_batch([robot], commands, self._times, tolerance_mm=TOLERANCE_MM).states
        except SimulationError:  # a centre of gravity outside the wheels: no robot to simulate
            return np.full((len(windows), len(self.drive.time_s), 3), np.nan)
        pose = states[:, self._first :, :3]
        # The point whose pose is measured lies ahead of the wheels' middle.
        ahead = MM_PER_M * values["pose_x_m"] * np.stack([np.cos(pose[..., 2]), np.sin(pose[..., 2])], axis=-1)
        off = pose[..., :2] + ahead - pose[:, :1, :2] - ahead[:, :1]
        cos, sin = np.cos(pose[:, :1, 2]), np.sin(pose[:, :1, 2])
        x, y = cos * off[..., 0] + sin * off[..., 1], cos * off[..., 1] - sin * off[..., 0]
        return np.stack([x / MM_PER_M, y / MM_PER_M, pose[..., 2] - pose[:, :1, 2]], axis=-1)

    def wheels_rad_s(self, values: Mapping[str, float], command_rad_s: Array) -> Array:
        """Speeds (2,) left and right at which the wheels turn once they have been told one command (2,) for long."""
        (record,) = compile_robot(corrected_robot(self.robot, values, self.usual_rpm))
        unit = RPM_PER_RAD_S * float(record["time_unit"])
        return np.array(held_drive(*(unit * command_rad_s).tolist(), record)) / unit

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


def fit(model: Model, windows: NDArray[np.int64], starts: int = STARTS) -> Corrected:
    """Fit the numbers to some windows by robust least squares with their priors.

    A robot that turns on the spot may settle on either of two motions, so that the misfit has many valleys: a third of
    the windows is fitted from several starts drawn from the priors, and all of them from the best end.
    """
    sigmas = np.array([item.sigma for item in NUMBERS.values()])
    draws = np.random.default_rng(0).normal(0, STARTING_SHARE, (starts, len(sigmas))) * sigmas
    draws[0] = 0.0
    ends = [_fitted(model, windows[::3], start, FEW_STEPS) for start in draws]
    best = min(ends, key=lambda end: float(end.cost))
    found = _fitted(model, windows, best.x, MOST_STEPS)
    spread = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    chosen = _values(found.x)
    return Corrected(chosen, dict(zip(NUMBERS, spread, strict=True)))


def _values(free: Array) -> dict[str, float]:
    return {name: item.value(float(part)) for (name, item), part in zip(NUMBERS.items(), free, strict=True)}


def _fitted(model: Model, windows: NDArray[np.int64], start: Array, steps: int) -> OptimizeResult:
    sigmas = np.array([item.sigma for item in NUMBERS.values()])

    def cost(free: Array) -> Array:
        left = model.misfit(model.poses(_values(free), windows), windows).ravel()
        # Misfits beyond some sigmas, of a robot that was not where its commands say, count in proportion to their size.
        size = np.sqrt(2 * (np.sqrt(1 + left**2) - 1))
        return np.r_[np.copysign(size, left), free / sigmas]

    def slopes(free: Array) -> Array:
        base = cost(free)
        return np.stack([(cost(free + step) - base) / STEP for step in STEP * np.diag(sigmas)], axis=1) / sigmas

    return least_squares(cost, start, jac=slopes, x_scale=sigmas, max_nfev=steps, ftol=1e-4)
