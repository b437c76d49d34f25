"""Marks of runs that are given as marks or poses, as the analysis reads them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.interchange.poses import read_poses, refuse_few, with_marks
from evaluator.interchange.tracks import Tracks, read_any_marks
from evaluator.mark_geometry import MarkGeometry, equal_height_mm
from evaluator.marks import write_marks

if TYPE_CHECKING:
    from calibration.camera import Camera
    from evaluator.settings import Experiment, MeasuredRobot, Run
    from simulator.robot import Robot


@dataclass(frozen=True)
class GivenMarks:
    """A marks table (evaluator.marks), and notes on the file that it was read from."""

    table: pd.DataFrame
    notes: tuple[str, ...]


def read_given(run: Run, robot: Robot | MeasuredRobot, tracks: Tracks | None, camera: Camera | None) -> GivenMarks:
    """Read the marks of a run with marks or poses; those of poses are where the robot's marks would be.

    tracks, camera: see read_any_marks. Raises InputError for a file that cannot be read, or holds too few poses.
    """
    if run.poses is not None:
        found = read_poses(run.poses, run.topics)
        refuse_few(found, run.poses)
        return GivenMarks(with_marks(found.table, MarkGeometry.of_robot(robot)), tuple(found.notes()))
    assert run.marks is not None  # a run has one of the three, by its validation, and no video here
    height_mm, names = equal_height_mm(robot.layout, robot.name), tuple(robot.points_mm)
    table = read_any_marks(run.marks, tracks, camera, height_mm, names)
    return GivenMarks(table, tuple(table.attrs["faults"]))


def converted_marks(experiment: Experiment, given: Mapping[str, Path], folder: Path) -> dict[str, Path]:
    """Marks files, written to a folder, of runs of poses and of other programs, by run id; of those that can be read.

    given: runs with a marks file of their own (given_marks).
    """
    from calibration.store import load_camera
    from evaluator.settings import load_any_robot
    from simulator.errors import SimulationError

    robots: dict[str, Robot | MeasuredRobot] = {}
    result: dict[str, Path] = {}
    for number, run in enumerate(experiment.run):
        if run.id in given or run.video is not None:
            continue
        name, camera = run.robot or experiment.robot, run.camera or experiment.camera
        try:
            if name not in robots:
                robots[name] = read_with(load_any_robot, Path(name))
            seen_by = read_with(load_camera, camera) if run.marks is not None and camera is not None else None
            file = folder / f"{number}.csv"  # a run may have any name
            write_marks(read_given(run, robots[name], experiment.tracks, seen_by).table, file)
        except (InputError, SimulationError, OSError):
            continue
        result[run.id] = file
    return result
