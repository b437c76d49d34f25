"""Turning radii of single tables: marks with a robot, a single mark, marks in px with a scale, or poses."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.interchange.poses import holds_poses, in_recording_s, poses_of, read_poses
from evaluator.interchange.tracker_faults import without_faults
from evaluator.interchange.tracks import Tracks, read_points
from evaluator.mark_geometry import MarkGeometry
from evaluator.marks import columns_of, read_marks
from evaluator.pose import Poses, poses_from_marks
from evaluator.turning import measure_turning
from evaluator.turning.path import PointPath, measure_path
from evaluator.turning.phase_table import several_motions
from evaluator.turning.pooling import pooled
from evaluator.turning.repetitions import disagreement
from evaluator.turning.status import spacing_fault
from evaluator.wording import with_bounds
from evaluator.workflow.runs.job import spacing_note

if TYPE_CHECKING:
    from calibration.camera import Camera
    from evaluator.robot_geometry import RobotGeometry

Array = NDArray[np.float64]
POINTED_PX = 1.0  # standard uncertainty of a position selected by hand
ITS_TIME = "give the time in the table at which the motors were commanded"
SAME_RUN = 1.1  # largest ratio of radii of repetitions, because commands are unknown here


@dataclass(frozen=True)
class Ruler:
    """Two points of an image and the length between them: the scale of a plane seen vertically from above."""

    ends_px: tuple[float, float, float, float]
    length_mm: float

    @property
    def mm_per_px(self) -> float:
        """Size of a pixel. Raises InputError for a ruler without length."""
        x1, y1, x2, y2 = self.ends_px
        distance = float(np.hypot(x2 - x1, y2 - y1))
        if not (np.isfinite(distance) and distance > POINTED_PX and np.isfinite(self.length_mm) and self.length_mm > 0):
            raise InputError(
                f"--scale-px {x1:g} {y1:g} {x2:g} {y2:g} --length-mm {self.length_mm:g}: no length; give two points of "
                "the image that are apart and the millimetres between them"
            )
        return self.length_mm / distance

    @property
    def sigma(self) -> float:
        """Relative standard uncertainty, with POINTED_PX at both ends."""
        return float(np.sqrt(2) * POINTED_PX * self.mm_per_px / self.length_mm)


@dataclass(frozen=True)
class Request:
    """Options for reading and measuring tables; unknown ones are None."""

    robot: RobotGeometry | None = None
    tracks: Tracks = field(default_factory=Tracks)
    camera: Camera | None = None
    ruler: Ruler | None = None
    start_s: float | None = None
    stop_s: float | None = None
    left_rpm: float | None = None
    right_rpm: float | None = None


@dataclass(frozen=True)
class MeasuredTable:
    """Result of one table: its row of turning.csv, its phases, and lines of text, the most important first."""

    row: dict[str, Any]
    lines: tuple[str, ...]
    phases: tuple[dict[str, float | str], ...] = ()


def measure_table(path: Path, request: Request) -> MeasuredTable:
    """Measure one table. Raises InputError if it cannot be read, or none of its frames can be measured."""
    if holds_poses(path):
        return _of_poses(path, request)
    height = request.robot.height_mm if request.robot else 0.0
    names = request.robot.marks().names if request.robot else ()
    time, points, unit = read_points(path, request.tracks, request.camera, height, names)
    _check_times(path, time, request.start_s, request.stop_s)
    lines: list[str] = []
    scale_sigma = 0.0
    if unit == "px" and request.ruler is not None:
        points = {name: place * request.ruler.mm_per_px for name, place in points.items()}
        unit, scale_sigma = "mm", request.ruler.sigma
        lines.append(
            f"scale from the ruler, known to {100 * scale_sigma:.2g} % (1 sigma); not in the intervals: a camera that "
            "is not straight above, its lens, the height of the marks over the ruler"
        )
    elif request.ruler is not None:
        raise InputError(f"{path}: holds lengths in {unit}; --scale-px is for columns in px")
    head = {"run": path.stem, "left_rpm": request.left_rpm, "right_rpm": request.right_rpm}
    geometry = _marks(path, points, request.robot)
    measured = tuple(points) if geometry is None else geometry.names
    marks = without_faults(_table(path, time, {name: points[name] for name in measured}, request), measured)
    lines += marks.attrs["faults"]
    if geometry is None:
        points = {name: marks[columns_of([name])].to_numpy(float) for name in measured}
        row, said = _each_mark(path, time, points, unit, scale_sigma, request)
        return MeasuredTable({**head, **row}, (*said, *lines))
    if unit == "px":
        per_px = _mm_per_px(path, marks, geometry)
        marks = marks.drop(columns="time_s") * per_px
        marks.insert(0, "time_s", time)
        lines.append(
            f"px: scale from the distance of the marks, {per_px:.4g} mm per px; not in the intervals: where the marks "
            "really are, a camera that is not straight above, its lens"
        )
    poses = poses_from_marks(marks, geometry, request.camera)
    if not poses.measured.any():
        reasons, counts = np.unique(poses.status, return_counts=True)
        raise InputError(f"{path}: no frame can be measured ({reasons[counts.argmax()]}); are two marks in it?")
    return _measured(head, poses, request, lines, scale_sigma)


def _check_times(path: Path, time_s: Array, start_s: float | None, stop_s: float | None) -> None:
    """Raise InputError if the motors are stated to be off throughout a table, by --start-s or --stop-s."""
    first, last = float(time_s[0]), float(time_s[-1])
    if start_s is not None and start_s >= last:
        raise InputError(f"{path}: --start-s is {start_s:g} s, but the table ends at {last:.2f} s; {ITS_TIME} on")
    if stop_s is not None and stop_s <= first:
        raise InputError(f"{path}: --stop-s is {stop_s:g} s, but the table begins at {first:.2f} s; {ITS_TIME} off")


def _of_poses(path: Path, request: Request) -> MeasuredTable:
    """Measure poses of another system; times are those of its clock."""
    if request.ruler is not None:
        raise InputError(f"{path}: holds poses; --scale-px is for columns in px")
    read = read_poses(path)
    stated = request.start_s, request.stop_s
    start_s, stop_s = (None if at is None else in_recording_s(at, read.zero_s) for at in stated)
    head = {"run": path.stem, "left_rpm": request.left_rpm, "right_rpm": request.right_rpm}
    _check_times(path, read.table["time_s"].to_numpy(float), start_s, stop_s)
    shifted = replace(request, start_s=start_s, stop_s=stop_s)
    return _measured(head, poses_of(read.table), shifted, read.notes(), 0.0)


def _measured(
    head: dict[str, Any], poses: Poses, request: Request, lines: list[str], scale_sigma: float
) -> MeasuredTable:
    """Results of poses, with the phases of a run that consists of several motions."""
    found = measure_turning(
        poses,
        request.start_s,
        request.stop_s,
        shape=request.robot.shape if request.robot else None,
        left_rpm=request.left_rpm,
        right_rpm=request.right_rpm,
    )
    if scale_sigma:
        found = found.with_scale(scale_sigma)
    phases = tuple({"run": head["run"], **row} for row in found.phase_rows())
    if several_motions(found.phases, request.start_s, request.stop_s):
        lines = [*lines, *(_phase_line(row) for row in phases)]
    doubts = () if spacing_fault(poses) else spacing_note(found.mark_spacing_ratio)  # a fault is the summary
    return MeasuredTable({**head, **found.to_row()}, (found.summary(), *doubts, *lines), phases)


def _phase_line(phase: dict[str, Any]) -> str:
    radius = ""
    if np.isfinite(phase["radius_mm"]):
        value, low, high = with_bounds(*(phase[name] for name in ("radius_mm", "radius_low_mm", "radius_high_mm")))
        radius = f", radius {value} mm, 95 % from {low} to {high}"
    speed = f", {phase['speed_mm_s']:.3g} mm/s" if np.isfinite(phase["speed_mm_s"]) else ""
    when = f"{phase['start_s']:.2f} to {phase['stop_s']:.2f} s"
    return f"{when}: {phase['kind']}{radius}, {phase['turned_deg']:z.0f} degrees{speed}"


def together(rows: Sequence[dict[str, Any]]) -> str:
    """Pooled radius of repetitions in one sentence; "" for tables that are not repetitions of one run."""
    table = pd.DataFrame(rows)
    if "radius_mm" not in table:
        return ""
    turns = table[table["radius_mm"].notna()]
    if len(turns) < 2:
        return ""
    if fault := disagreement(turns, SAME_RUN):
        return f"not pooled as repetitions: {fault}"
    radius = pooled(turns["radius_mm"].to_numpy(float), turns["radius_random_mm"].to_numpy(float))
    shared = radius.with_systematic(float(turns["radius_systematic_mm"].mean()))
    return (
        f"{radius.runs} repetitions: radius {radius.mean:.4f} mm, 95 % from {shared.low:.4f} to {shared.high:.4f}; "
        f"scatter from run to run {radius.between:.2g} mm, of a single measurement {radius.within:.2g} mm"
    )


def _marks(path: Path, points: dict[str, Array], robot: RobotGeometry | None) -> MarkGeometry | None:
    """Marks of the robot in the table; None if there are fewer than two. Raises InputError for a misspelt one."""
    if robot is None:
        return None
    geometry = robot.marks()
    strange = [name for name in points if name not in geometry.names]
    for missing in (name for name in geometry.names if name not in points):
        if near := difflib.get_close_matches(missing, strange, n=1):
            raise InputError(
                f"{path}: has no mark {missing}: unknown key marks.{missing}_mm; did you mean {near[0]}_mm?"
            )
    there = [name for name in geometry.names if name in points and np.isfinite(points[name]).all(axis=1).any()]
    return geometry.only(there) if len(there) > 1 else None


def _each_mark(
    path: Path, time: Array, points: dict[str, Array], unit: str, scale_sigma: float, request: Request
) -> tuple[dict[str, Any], list[str]]:
    """The path of every mark by itself."""
    paths: dict[str, PointPath] = {
        name: measure_path(time, place, request.start_s, request.stop_s, scale_sigma)
        for name, place in points.items()
        if np.isfinite(place).all(axis=1).any()
    }
    if not paths:
        raise InputError(f"{path}: no mark is in any frame")
    why = "no robot.toml" if request.robot is None else "a single mark"
    suffix = {"px": "px"}.get(unit, "mm")
    row: dict[str, Any] = {"radius_status": f"{why}: paths of marks, no heading and no radius of the robot's centre"}
    lines = [f"{name} mark: {found.summary(suffix)}" for name, found in paths.items()]
    lines += [
        f"{first} and {second} are at the same places in every frame; is one mark in both columns?"
        for first, second in combinations(paths, 2)
        if np.array_equal(points[first], points[second], equal_nan=True)
    ]
    for name, found in paths.items():
        row |= {f"{name}_radius_{suffix}": found.radius, f"{name}_radius_low_{suffix}": found.low}
        row |= {f"{name}_radius_high_{suffix}": found.high, f"{name}_speed_{suffix}_s": found.speed}
        row |= {f"{name}_turned_deg": found.turned_deg, f"{name}_radius_status": found.status}
    return row, [*lines, str(row["radius_status"])]


def _table(path: Path, time: Array, points: dict[str, Array], request: Request) -> pd.DataFrame:
    """Marks table of some marks, with all columns if turnscope wrote the file."""
    from evaluator.interchange.tracks import program_of

    if program_of(path) == "turnscope" and request.tracks.unit in (None, "mm"):
        table = read_marks(path)
        if set(columns_of(points)) <= set(table):
            return table
    table = pd.DataFrame({"time_s": time})
    for name, place in points.items():
        table[[f"{name}_x_mm", f"{name}_y_mm"]] = place
    return table


def _mm_per_px(path: Path, marks: pd.DataFrame, geometry: MarkGeometry) -> float:
    first, second = (marks[columns_of([name])].to_numpy(float) for name in geometry.farthest_pair())
    distance = np.hypot(*(first - second).T)
    usual = float(np.median(distance[np.isfinite(distance)])) if np.isfinite(distance).any() else 0.0
    if not usual > 0:
        raise InputError(f"{path}: both marks are at one position: their distance gives no scale")
    return geometry.spacing_mm / usual
