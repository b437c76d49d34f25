"""Precompilation of kernels in other processes while the main process does other work.

This only speeds up the first analysis after installation; afterwards kernels are read from the cache on disk.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from itertools import islice
from pathlib import Path
from threading import Thread

from evaluator.workflow.execution.machine import PROCESSES

FRAMES = 60  # of a recording, enough for every kernel of the tracker


def precompile(video: Path) -> None:
    """Start processes that compile what an analysis needs, unless it is on disk; they end with this one at the latest.

    video: a recording that the tracker is tried on. Whoever needs a kernel of the simulator earlier waits for it.
    """
    from calibration.compilation import is_kept
    from simulator.integrator.batch import integrate_some

    if is_kept(integrate_some):
        return
    # In a thread: the first process waits until the libraries are imported.
    Thread(target=_start, args=(video,), daemon=True).start()


def _start(video: Path) -> None:
    for work in (simulate_run, partial(measure_turn, video)):
        PROCESSES.Process(target=_quietly, args=(work,), daemon=True).start()


def _quietly(work: Callable[[], None]) -> None:
    """Work and say nothing: what goes wrong here shows, with its place, where it is needed."""
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    work()


def simulate_run() -> None:
    """Simulate a run, alone and as one of many."""
    import numpy as np

    from simulator.command import Command
    from simulator.dynamics.model import compile_robot
    from simulator.integrator.batch import Trials
    from simulator.robot import load_robot
    from simulator.simulation import simulate

    robot, command, times_s = load_robot("barrel"), Command.constant(33.3, 14.4), np.linspace(0.0, 1.0, 61)
    simulate(robot, command, times_s).to_table()
    Trials([command], [times_s]).states(compile_robot(robot), np.zeros(6))


def measure_turn(video: Path) -> None:
    """Track a few frames, and measure the turn of marks on a circle."""
    import numpy as np
    import pandas as pd

    from evaluator.pose import poses_from_marks
    from evaluator.recording import open_recording
    from evaluator.robot_geometry import mark_geometry, robot_shape
    from evaluator.tracking import track
    from evaluator.turning import measure_turning
    from simulator.robot import load_robot

    track(islice(open_recording(video, threads=1), FRAMES))
    robot = load_robot("barrel")
    time_s = np.arange(300) / 60
    angle = -0.3 * time_s
    marks = {"time_s": time_s}
    for name, (x, y) in robot.points_mm.items():
        marks[f"{name}_x_mm"] = np.cos(angle) * x - np.sin(angle) * (y + 8.0)
        marks[f"{name}_y_mm"] = np.sin(angle) * x + np.cos(angle) * (y + 8.0)
    poses = poses_from_marks(pd.DataFrame(marks), mark_geometry(robot))
    measure_turning(poses, shape=robot_shape(robot), left_rpm=33.3, right_rpm=14.4)
