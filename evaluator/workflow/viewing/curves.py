"""The curves of one analysed run: marks, poses and simulation over time, in mm on the plate and in px of its frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.marks import mark_names, read_marks
from evaluator.workflow.editing.unfinished import UnfinishedRun, run_of
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.viewing.overview import out_folder

if TYPE_CHECKING:
    from calibration.camera import Camera
    from evaluator.mark_geometry import MarkGeometry

Array = NDArray[np.float64]
Column = dict[str, Any]
SPAN_S = 0.2  # interval of the slopes for speeds: tracking noise of 0.005 mm causes 0.04 mm/s


@dataclass(frozen=True)
class RunCurves:
    """Columns by name, each (n,); unknown values are NaN.

    marks: frame, time_s, status and px of every mark. poses: time_s, mm, heading_deg, speed_mm_s, yaw_rate_deg_s and
    centre and nose in px. simulated: the same for the simulated counterpart. Empty if there are no results.
    """

    marks: Column = field(default_factory=dict)
    poses: Column = field(default_factory=dict)
    simulated: Column = field(default_factory=dict)


def run_curves(experiment: Path, run_id: str) -> RunCurves:
    """The curves of a run in the last analysis. Raises InputError for an experiment that cannot be read."""
    run, outputs = run_of(experiment, run_id), Outputs(out_folder(experiment))
    if not outputs.marks(run_id).is_file() or not outputs.poses(run_id).is_file():
        return RunCurves()
    marks = read_marks(outputs.marks(run_id))
    camera = _camera_of(run)
    marks_of_robot = _marks_of(run.robot)
    poses = _pose_columns(pd.read_csv(outputs.poses(run_id)), camera, marks_of_robot)
    simulated: Column = {}
    if outputs.simulated(run_id).is_file():
        simulated = _pose_columns(pd.read_csv(outputs.simulated(run_id)), camera, marks_of_robot)
    return RunCurves(_mark_columns(marks), poses, simulated)


def _mark_columns(marks: pd.DataFrame) -> Column:
    wanted = ["frame", "time_s"]
    for name in mark_names(marks):
        wanted += [f"{name}_{part}" for part in ("x_px", "y_px", "x_sigma_px", "x_mm", "y_mm", "x_sigma_mm", "status")]
    return {
        name: marks[name].fillna("").tolist() if name.endswith("status") else marks[name].to_numpy(float)
        for name in wanted
        if name in marks
    }


def _pose_columns(table: pd.DataFrame, camera: Camera | None, marks: MarkGeometry) -> Column:
    time, x, y = (table[name].to_numpy(float) for name in ("time_s", "x_mm", "y_mm"))
    heading = np.radians(table["heading_deg"].to_numpy(float))
    u, v = _slope(time, x), _slope(time, y)
    found: Column = {
        "time_s": time,
        "x_mm": x,
        "y_mm": y,
        "heading_deg": np.degrees(heading),
        "speed_mm_s": u * np.cos(heading) + v * np.sin(heading),
        "yaw_rate_deg_s": np.degrees(_slope(time, heading)),
    }
    if camera is not None:
        ahead_mm, _ = marks.axes_mm
        nose = x + ahead_mm * np.cos(heading), y + ahead_mm * np.sin(heading)
        for name, (at_x, at_y) in {"center": (x, y), "nose": nose}.items():
            px = camera.image_from_plate(np.stack([at_x, at_y, np.full_like(at_x, marks.height_mm)], axis=-1))
            found[f"{name}_x_px"], found[f"{name}_y_px"] = px[:, 0], px[:, 1]
    return found


def _slope(time: Array, values: Array) -> Array:
    """Change per second between SPAN_S / 2 before and after, shorter at the ends."""
    known = np.isfinite(values)
    if np.count_nonzero(known) < 2:
        return np.full_like(values, np.nan)
    before, after = np.maximum(time - SPAN_S / 2, time[0]), np.minimum(time + SPAN_S / 2, time[-1])
    slope = np.interp(after, time[known], values[known]) - np.interp(before, time[known], values[known])
    return np.where(known, slope / np.where(after > before, after - before, np.nan), np.nan)


def _camera_of(run: UnfinishedRun) -> Camera | None:
    from calibration.errors import CalibrationError
    from calibration.store import load_camera

    if run.camera is None or run.video is None:
        return None
    try:
        camera: Camera = read_with(load_camera, run.camera)
    except (InputError, CalibrationError):
        return None
    return camera


def _marks_of(robot: str) -> MarkGeometry:
    from evaluator.mark_geometry import MarkGeometry
    from simulator.robot import load_robot

    return MarkGeometry.of_robot(read_with(load_robot, Path(robot)))
