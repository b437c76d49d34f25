"""How a run turns: minimum and steady turning radius with 95 % intervals, speeds, centre of rotation, phases.

Radius and speed are those of the robot's centre, the middle between the axles. Curvature is the change of the direction
of travel per length of path, positive counter-clockwise. Speeds are positive forward, yaw rate is positive
counter-clockwise.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.pose import Poses
from evaluator.turning.fit import FEWEST_FRAMES, Scaled, TurnFit, fit_turn, scaled_poses
from evaluator.turning.noise import averaged_least_squares
from evaluator.turning.phases import find_phases

Array = NDArray[np.float64]
NAN = float("nan")
COVERED = (0.025, 0.975)


@dataclass(frozen=True)
class Turning:
    """One run's row of turning.csv; NaN where a quantity is unknown, with the reason in `radius_status`.

    radius_mm: smallest sustained turning radius of the centre, with 95 % bounds; steady_radius_mm: of the steady turn
    as a whole. Both are NaN where the interval of the curvature reaches straight: the curvature itself then says how
    straight.
    """

    radius_mm: float = NAN
    radius_low_mm: float = NAN
    radius_high_mm: float = NAN
    radius_status: str = "ok"
    steady_radius_mm: float = NAN
    steady_radius_low_mm: float = NAN
    steady_radius_high_mm: float = NAN
    speed_mm_s: float = NAN
    green_speed_mm_s: float = NAN
    yellow_speed_mm_s: float = NAN
    yaw_rate_deg_s: float = NAN
    curvature_per_mm: float = NAN
    curvature_low_per_mm: float = NAN
    curvature_high_per_mm: float = NAN
    center_x_mm: float = NAN
    center_y_mm: float = NAN
    body_slip_angle_deg: float = NAN
    turned_deg: float = NAN
    share_used: float = NAN
    noise_correlation: float = NAN
    residual_rms_mm: float = NAN
    start_s: float = NAN
    steady_start_s: float = NAN
    steady_stop_s: float = NAN
    stop_s: float = NAN
    start_delay_s: float = NAN
    mark_spacing_ratio: float = NAN
    mark_spacing_ratio_sigma: float = NAN

    def to_row(self) -> dict[str, float | str]:
        """Columns of turning.csv in order, to follow run, left_rpm and right_rpm."""
        return {item.name: getattr(self, item.name) for item in fields(self)}


def measure_turning(poses: Poses, start_s: float | None = None, stop_s: float | None = None) -> Turning:
    """Measure one run.

    start_s, stop_s: when the motors were commanded on and off, where known; phases are found without them too. A run
    that does not turn, rests, or has too few poses is a Turning whose radius is NaN and whose radius_status says why.
    """
    if start_s is not None and stop_s is not None and stop_s <= start_s:
        raise InputError(f"stop at {stop_s} s is not after start at {start_s} s")
    there = poses.measured
    ratio, ratio_sigma = poses.spacing_ratio()
    seen = Turning(mark_spacing_ratio=ratio, mark_spacing_ratio_sigma=ratio_sigma)
    if there.sum() < FEWEST_FRAMES:
        return replace(seen, radius_status=f"{int(there.sum())} frames with a pose; {FEWEST_FRAMES} are needed")
    time = poses.time_s[there]
    pose = np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad])[there]
    scaled = scaled_poses(pose, poses.covariance[there])
    stretched = scaled.pose * np.array([1.0, 1.0, scaled.length_mm])
    phases = find_phases(time, stretched, scaled.sigma_mm, start_s, stop_s)
    seen = replace(
        seen,
        start_s=phases.start_s,
        steady_start_s=phases.steady_start_s,
        steady_stop_s=phases.steady_stop_s,
        stop_s=phases.stop_s,
        start_delay_s=phases.delay_s,
    )
    if phases.reason:
        return replace(seen, radius_status=phases.reason)
    steady = phases.names(time) == "steady"
    if steady.sum() < FEWEST_FRAMES:
        return replace(seen, radius_status=f"steady turn of {int(steady.sum())} frames; {FEWEST_FRAMES} are needed")
    fit = fit_turn(time[steady], _part(scaled, steady))
    total = int(((poses.time_s >= phases.steady_start_s) & (poses.time_s <= phases.steady_stop_s)).sum())
    return _filled(seen, fit, time[steady], poses, total)


def _part(scaled: Scaled, where: NDArray[np.bool_]) -> Scaled:
    return replace(scaled, pose=scaled.pose[where], covariance=scaled.covariance[where])


def _filled(seen: Turning, fit: TurnFit, time: Array, poses: Poses, total: int) -> Turning:
    motion = fit.motion
    forwards = 1.0 if np.median(np.diff(motion.along_mm[fit.used]) / np.diff(time[fit.used])) >= 0 else -1.0
    curvature, low, high = _curvature(fit, forwards)
    radius = _radius(curvature, low, high)
    center_twist = fit.body_twist(fit.averaged.mean()[None], np.zeros(2))[0] * forwards
    interval = float(np.median(np.diff(time)))
    ticks = (time[fit.used] - time[fit.used].mean()) / interval
    clock = averaged_least_squares(
        ticks,
        np.zeros_like(ticks),
        motion.along_mm[fit.used, None] * forwards,
        np.stack([np.ones_like(ticks), ticks], 1)[:, None],
    )
    rate = float(clock.mean()[1]) / interval  # path parameter per second
    speeds = [_speed(fit, place, rate * forwards) for place in _places(poses)]
    status = "ok"
    if low < 0 < high:
        status = f"straight: curvature {curvature:.3g} 1/mm, 95 % from {low:.3g} to {high:.3g}"
    center = _circle_center(fit, center_twist)
    return replace(
        seen,
        radius_mm=radius[0],
        radius_low_mm=radius[1],
        radius_high_mm=radius[2],
        radius_status=status,
        steady_radius_mm=radius[0],
        steady_radius_low_mm=radius[1],
        steady_radius_high_mm=radius[2],
        speed_mm_s=speeds[0],
        green_speed_mm_s=speeds[1],
        yellow_speed_mm_s=speeds[2],
        yaw_rate_deg_s=float(np.degrees(center_twist[2] * rate)),
        curvature_per_mm=curvature,
        curvature_low_per_mm=low,
        curvature_high_per_mm=high,
        center_x_mm=center[0] if status == "ok" else NAN,
        center_y_mm=center[1] if status == "ok" else NAN,
        body_slip_angle_deg=_slip_angle_deg(center_twist),
        turned_deg=float(np.degrees(motion.turn_rad)),
        share_used=float(fit.used.sum() / total),
        noise_correlation=fit.averaged.correlation(),
        residual_rms_mm=float(np.sqrt((motion.residual_mm[fit.used] ** 2).mean())),
    )


def _bend(fit: TurnFit, step: Array, forwards: float) -> float:
    """Angle whose tangent is length × curvature of the centre: finite for a straight run and for a turn on the spot."""
    twist = fit.body_twist(np.asarray(step)[None], np.zeros(2))[0] * forwards
    return float(np.arctan2(fit.motion.length_mm * twist[2], np.hypot(twist[0], twist[1])))


def _curvature(fit: TurnFit, forwards: float) -> tuple[float, float, float]:
    """Curvature of the centre's path with its 95 % bounds, 1/mm."""
    zero = np.zeros(4)
    delta = 1e-5
    gradient = np.array(
        [(_bend(fit, axis * delta, forwards) - _bend(fit, -axis * delta, forwards)) / (2 * delta) for axis in np.eye(4)]
    )
    bend = _bend(fit, zero, forwards)
    best = bend + float(fit.averaged.mean() @ gradient)
    low, high = bend + fit.averaged.quantiles(gradient, COVERED)
    half = np.pi / 2
    curves = [float(np.tan(np.clip(angle, -half, half)) / fit.motion.length_mm) for angle in (best, low, high)]
    return curves[0], curves[1], curves[2]


def _radius(curvature: float, low: float, high: float) -> tuple[float, float, float]:
    if low < 0 < high:
        return NAN, NAN, NAN
    return abs(1 / curvature), min(abs(1 / low), abs(1 / high)), max(abs(1 / low), abs(1 / high))


def _places(poses: Poses) -> list[Array]:
    """Body places of the centre and, where known, both marks."""
    if poses.geometry is None:
        return [np.zeros(2), np.full(2, np.nan), np.full(2, np.nan)]
    return [np.zeros(2), np.array(poses.geometry.green_mm), np.array(poses.geometry.yellow_mm)]


def _speed(fit: TurnFit, place: Array, rate: float) -> float:
    """Speed of a body point, positive where it moves forward in the body frame."""
    twist = fit.body_twist(fit.averaged.mean()[None], place)[0] * rate
    return float(np.copysign(np.hypot(twist[0], twist[1]), twist[0]))


def _slip_angle_deg(twist: Array) -> float:
    """Angle from the body's axis of travel (forward or backward) to the velocity, ISO 8855."""
    ahead = -1.0 if twist[0] < 0 else 1.0
    return float(np.degrees(np.arctan2(twist[1] * ahead, abs(twist[0]))))


def _circle_center(fit: TurnFit, twist: Array) -> tuple[float, float]:
    """Plate position of the centre of rotation."""
    motion = fit.motion
    heading = motion.start[2] / motion.length_mm
    if twist[2] == 0:
        return NAN, NAN
    body = np.array([-twist[1], twist[0]]) / twist[2] - fit.offset_mm  # from the quiet point to the centre of rotation
    cos, sin = np.cos(heading), np.sin(heading)
    return (
        float(motion.start[0] + cos * body[0] - sin * body[1]),
        float(motion.start[1] + sin * body[0] + cos * body[1]),
    )
