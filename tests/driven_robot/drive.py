"""Recordings of a driven robot in windows: commanded wheel speeds, lidar poses, and wheel encoders for checking.

A folder holds poses.csv.gz (step, window, time_s, command_left_rad_s, command_right_rad_s, x_m, y_m, heading_rad) and
may hold encoders.csv.gz (left_wheel_rad_s, right_wheel_rad_s, row by row as the poses). Windows follow one another;
each starts its poses at zero. Poses are held until the next scan.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.interchange.poses import held
from simulator.command import RPM_PER_RAD_S, Command

Array = NDArray[np.float64]
HISTORY_S = 6.0  # of commands before a window: motors that follow within seconds have forgotten what was before
FOLDS = 3
POSE = ["x_m", "y_m", "heading_rad"]
COMMAND = ["command_left_rad_s", "command_right_rad_s"]


@dataclass(frozen=True)
class Drive:
    """n windows of m samples.

    step: (n,) windows that end under one command, in order from 0. time_s: (m,) from the start of a window.
    command_rad_s: (n, m, 2) left, right. pose: (n, m, 3) x and y in m and heading in rad, from the first pose of the
    window. fresh: (n, m) samples that do not repeat the one before.
    encoder_rad_s: (n, m, 2), NaN without encoders.
    """

    step: NDArray[np.int64]
    time_s: Array
    command_rad_s: Array
    pose: Array
    fresh: NDArray[np.bool_]
    encoder_rad_s: Array

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.step)

    @property
    def interval_s(self) -> float:
        """Between samples."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def fold(self) -> NDArray[np.int64]:
        """Fold (n,) of FOLDS of every window: whole steps in turn, so that no step is fitted and predicted at once."""
        return np.asarray(np.unique(self.step, return_inverse=True)[1] % FOLDS)

    def log(self, window: int) -> tuple[Array, Array]:
        """Commands (k, 2), rad/s, of a window and of the time before it, and their times, s; 0 is its start."""
        before = min(round(HISTORY_S / self.interval_s / len(self.time_s)) + 1, window)
        rows = self.command_rad_s[window - before : window + 1].reshape(-1, 2)
        return rows, self.interval_s * (np.arange(len(rows)) - before * len(self.time_s))

    def mean_commands(self, begin_s: float, end_s: float) -> Array:
        """Mean commands (n, 2), rad/s, between two times of every window, before its start too; 0 before any."""
        result = np.zeros((len(self), 2))
        for window in range(len(self)):
            rows, times = self.log(window)
            inside = (times >= begin_s) & (times < end_s)
            result[window] = rows[inside].mean(axis=0) if inside.any() else 0.0
        return result


def load(folder: Path) -> Drive:
    """Read a folder. Raises OSError, and ValueError for windows of different lengths."""
    table = pd.read_csv(folder / "poses.csv.gz")
    keys = table[["step", "window"]].to_numpy()
    starts = np.flatnonzero(np.r_[True, (np.diff(keys, axis=0) != 0).any(axis=1)])
    length = int(np.median(np.diff(starts)))
    # A window that was cut short ends before the pose that is to be predicted.
    whole = starts[np.diff(np.r_[starts, len(table)]) == length]
    rows = whole[:, None] + np.arange(length)
    if not len(whole):
        raise ValueError(f"{folder}: no windows of equal length")
    pose = table[POSE].to_numpy(float)[rows]
    fresh = np.array([~held(item) for item in pose])
    pose = relative_to_start(pose)
    command = table[COMMAND].to_numpy(float)[rows]
    # By the commands: the recordings' own numbers of steps change a window early or late in four steps of ten.
    changes = np.r_[False, (np.diff(command[:, -1], axis=0) != 0).any(axis=1)]
    encoders = folder / "encoders.csv.gz"
    wheels = np.full((len(table), 2), np.nan)
    if encoders.is_file():
        wheels = pd.read_csv(encoders)[["left_wheel_rad_s", "right_wheel_rad_s"]].to_numpy(float)
    return Drive(
        np.cumsum(changes),
        table["time_s"].to_numpy(float)[rows[0]],
        command,
        pose,
        fresh,
        wheels[rows],
    )


def relative_to_start(pose: Array) -> Array:
    """Poses (n, m, 3) in the frame of the first of each window; heading unwrapped."""
    x, y = pose[..., 0] - pose[:, :1, 0], pose[..., 1] - pose[:, :1, 1]
    first = pose[:, :1, 2]
    cos, sin = np.cos(first), np.sin(first)
    heading = np.unwrap(pose[..., 2], axis=1) - first
    return np.stack([cos * x + sin * y, cos * y - sin * x, heading], axis=-1)


def command_of(rows: Array, times: Array) -> Command:
    """A command, rpm, from the samples (k, 2), rad/s, of a log; each holds until the next."""
    rpm = RPM_PER_RAD_S * rows
    changes = np.r_[True, (np.diff(rpm, axis=0) != 0).any(axis=1)]
    steps = Command.steps(
        (float(t), float(a), float(b)) for t, (a, b) in zip(times[changes], rpm[changes], strict=True)
    )
    return Command(steps.time_s[1:], steps.left_rpm[1:], steps.right_rpm[1:])  # before it: as at its first row


def write_experiment(drive: Drive, windows: NDArray[np.int64], robot: Path, folder: Path) -> Path:
    """Write windows as an experiment that turnscope reads: a run each, its poses and its log of commands."""
    lines = ["format = 1", 'name = "driven steps"', f'robot = "{robot.name}"']
    (folder / robot.name).write_text(robot.read_text(encoding="utf-8"), encoding="utf-8")
    for window in windows:
        run = f"w{window:03d}"
        poses = pd.DataFrame(drive.pose[window], columns=POSE)
        poses.insert(0, "time_s", drive.time_s)
        poses.to_csv(folder / f"{run}.csv", index=False)
        rows, times = drive.log(int(window))
        log = pd.DataFrame({"time_s": times, "left_rad_s": rows[:, 0], "right_rad_s": rows[:, 1]})
        log.to_csv(folder / f"{run}_commands.csv", index=False)
        lines += ["", "[[run]]", f'id = "{run}"', f'poses = "{run}.csv"', f'commands = "{run}_commands.csv"']
        lines.append("starts_at_rest = false")
    path = folder / "experiment.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
