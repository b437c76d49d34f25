"""Precompilation of kernels in other processes while the main process does other work.

This only speeds up the first analysis after installation; afterwards kernels are read from the cache on disk.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import islice
from pathlib import Path
from threading import Thread

from evaluator.workflow.execution.machine import PROCESSES, available_cores

FRAMES = 60  # of a recording, enough for every kernel of the tracker


def precompile(video: Path) -> bool:
    """Start processes that compile the kernels of the demo that are not on disk; they end with this one at the latest.

    video: a recording for a trial of the tracker. If a kernel is needed earlier, its caller waits. Returns whether
    processes were necessary.
    """
    from calibration.compilation import is_cached
    from simulator.integrator.batch import integrate_some

    if is_cached(integrate_some):
        return False
    works = (assign_dots, partial(measure_turn, video), simulate_run, find_steady_turn)
    # In a thread: the first process waits until the libraries are imported.
    Thread(target=_start, args=works, daemon=True).start()
    return True


def precompile_tracker() -> None:
    """Start a process that compiles later kernels of the tracker that are not on disk.

    The fit of a mark takes about half of the time; the calling process compiles it at the same time.
    """
    from calibration.compilation import is_cached
    from evaluator.tracking.uncertainty import rim

    if not is_cached(rim._rim_power):  # noqa: SLF001 - the last kernel that is called
        Thread(target=_start, args=(measure_mark,), daemon=True).start()


def _start(*works: Callable[[], None]) -> None:
    """Do works that are listed in the order in which they are needed, in a process for each core but this one's.

    With more processes than cores, the first kernels that this process waits for would be ready later.
    """
    others = max(available_cores() - 1, 1)
    for first in range(min(others, len(works))):
        PROCESSES.Process(target=_quietly, args=works[first::others], daemon=True).start()


def _quietly(*works: Callable[[], None]) -> None:
    """Do works in turn and ignore errors: they occur again, with their location, when a kernel is needed."""
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    for work in works:
        with suppress(Exception):
            work()


def assign_dots() -> None:
    """Call the kernels that follow the fit of the dots in a gauge image.

    The fit takes about half of the time; the calling process compiles it at the same time.
    """
    import numpy as np

    from calibration.assignment.growth import bucket, grow
    from calibration.detection.noise_correlation import SAMPLE, correlation_factors

    dot = np.array([20.0, 20.0, 0.04, 0.0, 0.04, 1.0, 1.0, -1.0, 0.0, 0.0])  # of radius 5 px, see ellipse_fit
    correlation_factors(
        np.zeros((41, 41), np.float32), np.tile(dot, (SAMPLE, 1)), np.full(SAMPLE, 3.0), np.ones(SAMPLE)
    )
    place, none = np.zeros((1, 2)), np.zeros(1, np.bool_)
    cells, following, origin = bucket(place, 1.0)
    grow(place, 0, np.ones(4), none, none, cells, following, 1.0, origin)


def measure_mark() -> None:
    """Call the kernels that follow the fit of a mark, with a blank frame of eight bits."""
    import numpy as np

    from evaluator.tracking.detection.color_kernels import color_window
    from evaluator.tracking.refinement import kernels
    from evaluator.tracking.refinement.disc import make_disc
    from evaluator.tracking.refinement.occluded_pixels import CORE
    from evaluator.tracking.refinement.occlusion import fit_uncovered
    from evaluator.tracking.uncertainty.rim import rim_power

    disc = make_disc(6.0, 0.8, (0.0, 0.0), (100.0, 30.0), 1.0)
    fitted = np.zeros(kernels.RESULTS)
    fitted[: kernels.BASE + 1] = 20.0, 20.0, disc.amplitude, disc.base
    luma, chroma = np.zeros((41, 41), np.uint8), np.zeros((21, 21), np.uint8)
    shape = disc.numbers(), disc.table, np.array([disc.noise, 4.0])
    color_window(chroma, chroma, np.ones(4), 20.0, 20.0, 6.0, np.ones(6), np.zeros(5))
    fit_uncovered(luma, 0, 1, fitted, *shape, np.zeros(kernels.RESULTS), None, CORE, 1.0)
    rim_power(luma, 0, 1, fitted, *shape)
    kernels.interior_slope(luma, 0, 1, 20.0, 20.0, 4.0, np.zeros(2))


def simulate_run() -> None:
    """Simulate a run, alone and as one of many."""
    import numpy as np

    from simulator.command import Command
    from simulator.robot import load_robot
    from simulator.simulation import simulate, simulate_batch

    robot, command, times_s = load_robot("barrel"), Command.constant(33.3, 14.4), np.linspace(0.0, 1.0, 61)
    simulate(robot, command, times_s).to_table()
    simulate_batch([robot], [command], times_s)


def find_steady_turn() -> None:
    """Find the turn on which a robot settles, as a report does."""
    from simulator.robot import load_robot
    from simulator.steady import steady_turn

    steady_turn(load_robot("barrel"), 33.3, 14.4)


def measure_turn(video: Path) -> None:
    """Track a few frames, and measure the turn of marks on a circle."""
    import numpy as np
    import pandas as pd

    from evaluator.mark_geometry import MarkGeometry
    from evaluator.pose import poses_from_marks
    from evaluator.recording import open_recording
    from evaluator.robot_geometry import robot_shape
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
    poses = poses_from_marks(pd.DataFrame(marks), MarkGeometry.of_robot(robot))
    measure_turning(poses, shape=robot_shape(robot), left_rpm=33.3, right_rpm=14.4)
