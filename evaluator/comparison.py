"""Measured against simulated runs: the same command from the same start pose, evaluated by the same estimator.

Everything in the plate frame, mm and rad. The simulated run starts at rest at the measured start pose and is observed
through simulated marks, so that biases of the estimator affect both equally.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from evaluator.interchange.commands import RunCommand
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import Poses, poses_from_marks
from evaluator.robust import sigma_of_bends
from evaluator.turning import Turning, only_mark
from evaluator.turning.motion.rest import MOVING_FRAMES, ONSET_LEAST_MM, ONSET_SIGMAS, RESTS_S
from evaluator.turning.motion.velocity import velocity_at
from simulator.effects.view import View
from simulator.nominal_robot import WHEELS
from simulator.observation import marks_of_run, view_of
from simulator.robot import Robot
from simulator.run import Run as Motion
from simulator.run import State
from simulator.simulation import moving_state, simulate

Array = NDArray[np.float64]

LEAST_TURNED_RAD = 0.01  # what ONSET_LEAST_MM turns marks about a centre 2 mm away
LEAST_POSES = 4  # one more than a parabola needs
START_SPAN_S = 0.25  # recording that determines the start pose: 15 frames at 60/s reduce the noise to a quarter

STRAIGHT_MM = 1e6  # rounding bends a simulated straight line; this circle deviates by 1 nm over 100 mm of plate


# Columns of turning.csv that are compared with their simulated counterparts.
BESIDE = (
    "speed_mm_s",
    "yaw_rate_deg_s",
    "body_slip_angle_deg",
    "front_left_slip_ratio",
    "front_right_slip_ratio",
    *(f"{wheel}_slip_angle_deg" for wheel in WHEELS),
)


def simulated_poses(robot: Robot, run_command: RunCommand, poses: Poses, run_index: int = 0) -> tuple[Motion, Poses]:
    """Motion of a run simulated from its measured start pose, and its poses as they would be measured.

    A robot with errors of observation (marks elsewhere, millimetres or seconds off by a factor) starts at the pose in
    which its marks, observed with these errors, coincide with the measured ones, and at the start time of its erroneous
    clock. A run that does not start at rest has at the first pose the velocity that its command has produced by then.
    """
    first = float(poses.time_s[0])
    start_s = run_command.start_s if run_command.starts_at_rest and run_command.start_s is not None else first
    measured = start_pose(poses, start_s, at_rest=run_command.starts_at_rest)
    start = State(*resting_pose(view_of(robot), MarkGeometry.of_robot(robot), measured))
    return _simulated_from(start, robot, run_command, poses, run_index)


def simulated_path(robot: Robot, run_command: RunCommand, poses: Poses, run_index: int = 0) -> tuple[Motion, Poses]:
    """Motion of a run of a robot with a single mark, and the path of this mark as it would be measured.

    One mark does not show the heading at the start. The run is simulated from any pose; the rigid motion that brings
    the path of its mark nearest to the measured path (least squares) moves the start, from which it is simulated again.
    """
    start = State()
    _, seen = _simulated_from(start, robot, run_command, poses, run_index)
    simulated, measured = (each.x_mm + 1j * each.y_mm for each in (seen, poses))
    both = np.isfinite(simulated) & np.isfinite(measured)
    middle, target = simulated[both].mean(), measured[both].mean()
    turn = float(np.angle(np.sum((simulated[both] - middle).conj() * measured[both])))
    place = target + np.exp(1j * turn) * (complex(start.x_mm, start.y_mm) - middle)
    moved = State(float(place.real), float(place.imag), start.heading_rad + turn)
    return _simulated_from(moved, robot, run_command, poses, run_index)


def _simulated_from(
    start: State, robot: Robot, run_command: RunCommand, poses: Poses, run_index: int
) -> tuple[Motion, Poses]:
    """Motion from a pose, and its poses as they would be measured at the times of the measured ones."""
    factor = view_of(robot).time_factor
    command = run_command.in_true_time(factor)
    if not run_command.starts_at_rest:
        first = float(poses.time_s[0])
        start = moving_state(robot, command, _moving(start, poses, first), first / factor, run_index)
    motion = simulate(robot, command, poses.time_s / factor, start=start, run_index=run_index)
    return motion, poses_from_marks(marks_of_run(robot, motion), MarkGeometry.of_robot(robot))


def _moving(start: State, poses: Poses, at_s: float) -> State:
    """A pose with the velocity that the robot was measured to have near a time; at rest if it was not measured."""
    known = np.isfinite(poses.heading_rad)
    path = np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad])[known]
    along, across, spin = velocity_at(poses.time_s[known], path, at_s) or (0.0, 0.0, 0.0)
    return replace(start, u_mm_s=along, v_mm_s=across, yaw_rate_rad_s=spin)


def resting_pose(
    view: View, geometry: MarkGeometry, measured: tuple[float, float, float]
) -> tuple[float, float, float]:
    """True pose (mm, mm, rad) whose marks, as observed in a view, match those of a measured pose (least squares)."""
    plain = View(tuple(geometry.places_mm.values()))
    target = np.concatenate(plain.marks(*measured))

    def misfit(pose: Array) -> Array:
        return np.concatenate(view.marks(*pose)) - target

    return tuple(map(float, least_squares(misfit, measured, x_scale=(1.0, 1.0, 0.3)).x))  # type: ignore[return-value]


def start_pose(poses: Poses, start_s: float, *, at_rest: bool = True) -> tuple[float, float, float]:
    """Pose (x mm, y mm, heading rad) in which the run starts.

    The mean of the frames at rest before start_s, since it was last moved by hand. Without such frames, the start of a
    line through the headings of the first frames, and of parabolas through their positions (exact for a steady turn to
    second order). A run that does not start at_rest has no frames at rest.
    """
    known = np.isfinite(poses.heading_rad)
    time = poses.time_s
    resting = known & (time <= start_s) & at_rest
    if np.count_nonzero(resting) >= 3:
        chosen, powers = resting.copy(), (0, 0, 0)
        chosen[resting] = _since_moved(poses, resting)
    else:
        first = time[known][0]
        chosen = known & (time <= first + START_SPAN_S)
        if np.count_nonzero(chosen) < LEAST_POSES:  # for a slow sensor, enough for a parabola with some redundancy
            chosen = known & (np.cumsum(known) <= LEAST_POSES)
        few = np.count_nonzero(chosen) < LEAST_POSES
        powers = (0, 0, 0) if few else (2, 2, 1)
    at = max(start_s, float(time[chosen][0]))
    since = time[chosen] - at
    values = (poses.x_mm, poses.y_mm, poses.heading_rad)
    x, y, heading = (
        float(np.polynomial.polynomial.polyfit(since, value[chosen], power)[0])
        for value, power in zip(values, powers, strict=True)
    )
    return x, y, heading


def _since_moved(poses: Poses, resting: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the frames at rest (m,) are those since it was last moved: all, if it moves in the last of them.

    A hand withdraws softly: what follows within RESTS_S does not count if later frames do.
    """
    time = poses.time_s[resting]
    places = np.column_stack([poses.x_mm[resting], poses.y_mm[resting], poses.heading_rad[resting]])
    last = time > time[-1] - RESTS_S
    off = np.abs(places - np.median(places[last], axis=0))
    least = np.array([ONSET_LEAST_MM, ONSET_LEAST_MM, LEAST_TURNED_RAD])
    elsewhere = (off > ONSET_SIGMAS * sigma_of_bends(places) + least).any(axis=1)
    in_a_row = np.convolve(elsewhere, np.ones(MOVING_FRAMES))[: len(time)] == MOVING_FRAMES  # up to each frame
    if elsewhere[last].any() or not in_a_row.any():
        return np.ones(len(time), dtype=np.bool_)
    return np.asarray(time > min(time[in_a_row].max() + RESTS_S, time[-1] - RESTS_S))


def comparison_row(turning: dict[str, Any], poses: Poses, seen: Poses, read: Turning) -> dict[str, Any]:
    """One row of comparison.csv from the row of turning.csv and the measured poses.

    seen: poses simulated at the same times; read: results of the estimator for these. For a robot with a single mark,
    radius and speed of its path are compared.
    """
    simulated = read.to_row()
    if abs(read.curvature_per_mm) * STRAIGHT_MM < 1:
        simulated |= {"radius_mm": float("nan"), "steady_radius_mm": float("nan")}
    row: dict[str, Any] = {}
    mark = only_mark(turning)
    for name in ("radius_mm", "steady_radius_mm", *([f"{mark}_radius_mm"] if mark else [])):
        stem = name.removesuffix("_mm")
        row[name] = turning[name]
        row[f"{stem}_low_mm"], row[f"{stem}_high_mm"] = turning[f"{stem}_low_mm"], turning[f"{stem}_high_mm"]
        row[f"simulated_{name}"] = found = simulated.get(name, float("nan"))
        row[f"{stem}_difference_percent"] = 100 * (found / turning[name] - 1)
    of_marks = [name for name in turning if name.endswith("_speed_mm_s") and name in simulated]
    for name in (*BESIDE[:2], *of_marks, *BESIDE[2:]):
        row[name], row[f"simulated_{name}"] = turning[name], simulated[name]
    return {**row, **trajectory_gap(poses, seen)}


def trajectory_gap(poses: Poses, seen: Poses) -> dict[str, float]:
    """RMS and final gap between the simulated and the measured trajectory, over the frames with a pose.

    Both are poses of the marks, so that errors of the observation affect both.
    """
    distance = np.hypot(seen.x_mm - poses.x_mm, seen.y_mm - poses.y_mm)
    known = np.flatnonzero(np.isfinite(distance))
    turn = np.degrees(seen.heading_rad - poses.heading_rad)[known]
    if not len(known):
        return {"gap_rms_mm": float("nan"), "gap_end_mm": float("nan"), "heading_gap_end_deg": float("nan")}
    turn -= 360 * np.round(turn[0] / 360)
    return {
        "gap_rms_mm": float(np.sqrt(np.mean(distance[known] ** 2))),
        "gap_end_mm": float(distance[known[-1]]),
        "heading_gap_end_deg": float(turn[-1]),
    }
