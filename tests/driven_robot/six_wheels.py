"""A six-wheeled robot of 80 kg that drives late and mixes its sides: recordings with known truth.

A world of its own, nothing of the simulator is used. Every wheel rubs isotropically, F = −μ·N·w/√(w² + w₀²), against
its sliding velocity w (regularised Coulomb friction); the body has mass and inertia; steps of fourth-order Runge-Kutta.
The drive waits, follows with first order, and gives each side a share of the command of the other. Poses come at about
10 Hz by a clock that is late, with jitter, noise and outliers.

    python -m tests.driven_robot.six_wheels FOLDER [--steps 60] [--seed 1]

writes a recording for tests.benchmarks.husky, whose robot is six_wheels.toml.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.compilation import compiled
from tests.driven_robot.drive import COMMAND, POSE, Drive, relative_to_start

Array = NDArray[np.float64]
State = tuple[float, float, float, float, float, float]  # x, y, heading, forward and left speed, yaw rate

MASS_KG, INERTIA_KG_M2, FRICTION, GRAVITY_M_S2 = 80.0, 9.2, 0.7, 9.81
WHEELS_M = np.array([[x, y] for x in (0.36, 0.0, -0.36) for y in (0.35, -0.35)])
RADIUS_M = 0.15
SETTLING_M_S = 0.02  # w₀: sliding at which friction has come up to 70 %
STEP_S = 0.002  # friction over mass changes the velocity at μ·g/w₀ = 340 per second at most
POSE_S, WINDOW_S, WINDOWS = 0.1, 3.0, 2  # interval of poses; windows of a step of one command
MOST_RAD_S = 6.0


@dataclass(frozen=True)
class Truth:
    """What is to be found: each side turns own · its command + other · that of the other side, late."""

    dead_time_s: float = 0.15
    time_constant_s: float = 0.25
    own: float = 0.95
    other: float = 0.25
    clock_s: float = 0.12  # poses are stamped so much late
    jitter_s: float = 0.01
    sigma_m: float = 0.01
    sigma_rad: float = 0.01
    outliers: float = 0.02  # share of poses
    outlier_m: float = 1.0

    @property
    def delay_s(self) -> float:
        """By how much poses are later than commands on the whole, as a recording shows it."""
        return self.dead_time_s + self.time_constant_s + self.clock_s


def recorded(steps: int, seed: int, truth: Truth | None = None) -> Drive:
    """Windows of a drive through so many random commands, poses as a sensor gives them."""
    truth, random = truth or Truth(), np.random.default_rng(seed)
    commands = np.repeat(_commands(steps, random), WINDOWS, axis=0)
    count = round(WINDOW_S / POSE_S)
    nominal = np.arange(len(commands) * count).reshape(len(commands), count) * POSE_S
    stamped = nominal + random.uniform(-truth.jitter_s, truth.jitter_s, nominal.shape)
    fine_s, poses = driven(commands, truth)
    late = np.clip(stamped.ravel() - truth.clock_s, 0.0, None)
    pose = np.column_stack([np.interp(late, fine_s, poses[:, k]) for k in range(3)])
    pose += random.normal(0.0, [truth.sigma_m, truth.sigma_m, truth.sigma_rad], pose.shape)
    wrong = random.random(len(pose)) < truth.outliers
    wrong[::count] = wrong[count - 1 :: count] = False  # a window begins and ends at a pose
    pose[wrong, :2] += random.normal(0.0, truth.outlier_m, (int(wrong.sum()), 2))
    windows = pose.reshape(len(commands), count, 3)
    return Drive(
        step=np.repeat(np.arange(steps), WINDOWS),
        time_s=nominal[0],
        command_rad_s=np.repeat(commands[:, None], count, axis=1),
        pose=relative_to_start(windows),
        fresh=np.ones(nominal.shape, dtype=np.bool_),
        encoder_rad_s=np.full((len(commands), count, 2), np.nan),
    )


def _commands(steps: int, random: np.random.Generator) -> Array:
    """Left and right (steps, 2), rad/s: forward and backward, straight and curved, none so slow that it rests."""
    found = random.uniform(-MOST_RAD_S, MOST_RAD_S, (50 * steps, 2))
    found = found[np.abs(found.mean(axis=1)) > MOST_RAD_S / 4]
    return np.asarray(found[:steps])


def driven(commands: Array, truth: Truth) -> tuple[Array, Array]:
    """Times (n,), s, and poses (n, 3), m and rad, of a drive from rest through commands (k, 2) of WINDOW_S each."""
    count = round(len(commands) * WINDOW_S / STEP_S)
    times = np.arange(count) * STEP_S
    waiting = round(truth.dead_time_s / STEP_S)
    told = commands[np.minimum((times / WINDOW_S).astype(int), len(commands) - 1)]
    told = np.vstack([np.zeros((waiting, 2)), told])[:count]
    wanted = truth.own * told + truth.other * told[:, ::-1]
    return times, _rolled(wanted * RADIUS_M, truth.time_constant_s)


@compiled()
def _rolled(wanted_m_s: Array, time_constant_s: float) -> Array:
    """Poses (n, 3) from rest, at every STEP_S, of wheels that follow wanted surface speeds (n, 2) with first order."""
    state, left, right = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0
    poses = np.zeros((len(wanted_m_s), 3))
    for n in range(len(wanted_m_s)):
        poses[n, 0], poses[n, 1], poses[n, 2] = state[0], state[1], state[2]
        first = _slopes(state, left, right)
        second = _slopes(_moved(state, first, STEP_S / 2), left, right)
        third = _slopes(_moved(state, second, STEP_S / 2), left, right)
        fourth = _slopes(_moved(state, third, STEP_S), left, right)
        slopes = _moved(_moved(_moved(first, second, 2.0), third, 2.0), fourth, 1.0)
        state = _moved(state, slopes, STEP_S / 6)
        left += (wanted_m_s[n, 0] - left) * STEP_S / time_constant_s
        right += (wanted_m_s[n, 1] - right) * STEP_S / time_constant_s
    return poses


@compiled()
def _moved(state: State, slopes: State, time_s: float) -> State:
    """state + time_s · slopes; numbers compile in an eighth of the time of arrays."""
    x, y, heading, ahead, left, yaw = slopes
    return (
        state[0] + time_s * x, state[1] + time_s * y, state[2] + time_s * heading,
        state[3] + time_s * ahead, state[4] + time_s * left, state[5] + time_s * yaw,
    )  # fmt: skip


@compiled()
def _slopes(state: State, rolling_left_m_s: float, rolling_right_m_s: float) -> State:
    """Time derivatives of x, y, heading, forward and left speed, yaw rate, of wheels that roll so fast."""
    heading, ahead, left, yaw = state[2], state[3], state[4], state[5]
    along, across, moment = 0.0, 0.0, 0.0
    for number in range(len(WHEELS_M)):
        x, y = WHEELS_M[number, 0], WHEELS_M[number, 1]
        rolling = rolling_right_m_s if number % 2 else rolling_left_m_s
        slide_x, slide_y = ahead - yaw * y - rolling, left + yaw * x
        grip = -FRICTION * MASS_KG * GRAVITY_M_S2 / len(WHEELS_M)
        grip /= math.sqrt(slide_x**2 + slide_y**2 + SETTLING_M_S**2)
        along, across = along + grip * slide_x, across + grip * slide_y
        moment += grip * (x * slide_y - y * slide_x)
    cos, sin = math.cos(heading), math.sin(heading)
    forces = along / MASS_KG + yaw * left, across / MASS_KG - yaw * ahead, moment / INERTIA_KG_M2
    return cos * ahead - sin * left, sin * ahead + cos * left, yaw, forces[0], forces[1], forces[2]


def write_recording(drive: Drive, folder: Path) -> None:
    """Write windows as drive.load reads them."""
    count, length = len(drive), len(drive.time_s)
    table = pd.DataFrame({"step": np.repeat(drive.step, length), "window": np.repeat(np.arange(count), length)})
    table["time_s"] = np.tile(drive.time_s, count)
    table[COMMAND] = drive.command_rad_s.reshape(-1, 2)
    table[POSE] = drive.pose.reshape(-1, 3)
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "poses.csv.gz", index=False)


def main() -> None:
    """Write a recording."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    write_recording(recorded(given.steps, given.seed), given.folder)


if __name__ == "__main__":
    main()
