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
from evaluator.turning.fit import FEWEST_FRAMES, TurnFit, fit_turn, part, scaled_poses
from evaluator.turning.noise import Block, averaged_least_squares
from evaluator.turning.phases import find_phases
from evaluator.turning.sustained import Sustained, sustained_turn

Array = NDArray[np.float64]
NAN = float("nan")


@dataclass(frozen=True)
class Turning:
    """One run's row of turning.csv; NaN where a quantity is unknown, with the reason in `radius_status`.

    radius_mm: smallest turning radius of the centre that is sustained for a quarter turn (sustained.py), with 95 %
    bounds; steady_radius_mm: of the steady turn as a whole. Both are NaN where the interval of the curvature reaches
    straight: the curvature itself then says how straight. The two are equal unless radius_varies; radius_variation is
    then the relative standard deviation of the curvature from quarter turn to quarter turn, noise taken off.
    radius_random_mm and radius_systematic_mm are standard uncertainties: by noise, which more frames would reduce, and
    by the camera, which only a better calibration would; the bounds hold both. Speeds are positive forward.
    """

    radius_mm: float = NAN
    radius_low_mm: float = NAN
    radius_high_mm: float = NAN
    radius_status: str = "ok"
    radius_random_mm: float = NAN
    radius_systematic_mm: float = NAN
    steady_radius_mm: float = NAN
    steady_radius_low_mm: float = NAN
    steady_radius_high_mm: float = NAN
    radius_varies: bool = False
    radius_variation: float = NAN
    sustained_from_s: float = NAN
    sustained_to_s: float = NAN
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

    def to_row(self) -> dict[str, float | str | bool]:
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
    systematic = None if poses.systematic is None else poses.systematic[there]
    scaled = scaled_poses(pose, poses.covariance[there], systematic)
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
    names = phases.names(time)
    steady = names == "steady"
    if steady.sum() < FEWEST_FRAMES:
        return replace(seen, radius_status=f"steady turn of {int(steady.sum())} frames; {FEWEST_FRAMES} are needed")
    fit = fit_turn(time[steady], part(scaled, steady))
    regions = [names == name for name in ("transient", "steady", "stop")]
    sustained = sustained_turn(time, scaled, regions, fit)
    total = int(((poses.time_s >= phases.steady_start_s) & (poses.time_s <= phases.steady_stop_s)).sum())
    seen = replace(seen, share_used=float(fit.used.sum() / total))
    return _with_speeds(_with_radii(seen, fit, sustained), fit, time[steady], poses)


def _with_radii(seen: Turning, fit: TurnFit, sustained: Sustained) -> Turning:
    curvature = fit.curvature()
    center = fit.body_twist(np.zeros(2))
    status = "ok"
    if curvature.straight:
        status = (
            f"straight: curvature {curvature.value:.3g} 1/mm,"
            f" 95 % from {curvature.low:.3g} to {curvature.high:.3g} 1/mm"
        )
    radius = sustained.tightest.radius_mm() if status == "ok" else (NAN, NAN, NAN)
    steady = sustained.mean.radius_mm() if status == "ok" else (NAN, NAN, NAN)
    place = _circle_center(fit, center) if status == "ok" else (NAN, NAN)
    return replace(
        seen,
        radius_mm=radius[0],
        radius_low_mm=radius[1],
        radius_high_mm=radius[2],
        radius_status=status,
        radius_random_mm=radius[0] ** 2 * sustained.tightest.sigma,
        radius_systematic_mm=radius[0] ** 2 * sustained.tightest.systematic,
        steady_radius_mm=steady[0],
        steady_radius_low_mm=steady[1],
        steady_radius_high_mm=steady[2],
        radius_varies=sustained.varies,
        radius_variation=abs(sustained.spread_per_mm / sustained.mean.value) if sustained.varies else 0.0,
        sustained_from_s=sustained.from_s,
        sustained_to_s=sustained.to_s,
        curvature_per_mm=curvature.value,
        curvature_low_per_mm=curvature.low,
        curvature_high_per_mm=curvature.high,
        center_x_mm=place[0],
        center_y_mm=place[1],
        body_slip_angle_deg=_slip_angle_deg(center),
        turned_deg=float(np.degrees(fit.motion.turn_rad)),
        noise_correlation=fit.averaged.correlation(),
        residual_rms_mm=float(np.sqrt((fit.motion.residual_mm[fit.used] ** 2).mean())),
    )


def _with_speeds(seen: Turning, fit: TurnFit, time: Array, poses: Poses) -> Turning:
    interval = float(np.median(np.diff(time)))
    ticks = (time[fit.used] - time[fit.used].mean()) / interval
    along = fit.ahead * fit.motion.along_mm[fit.used, None]
    clock = averaged_least_squares(
        Block(ticks, np.zeros_like(ticks), along, np.stack([np.ones_like(ticks), ticks], axis=1)[:, None])
    )
    rate = float(clock.mean()[1]) / interval  # path parameter per second
    marks = poses.geometry
    return replace(
        seen,
        speed_mm_s=_speed(fit, np.zeros(2), rate),
        green_speed_mm_s=_speed(fit, np.array(marks.green_mm), rate) if marks else NAN,
        yellow_speed_mm_s=_speed(fit, np.array(marks.yellow_mm), rate) if marks else NAN,
        yaw_rate_deg_s=float(np.degrees(fit.body_twist(np.zeros(2))[2] * rate)),
    )


def _speed(fit: TurnFit, place: Array, rate: float) -> float:
    """Speed of a body point, positive where it moves forward in the body frame."""
    twist = fit.body_twist(place) * rate
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
