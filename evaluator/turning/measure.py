"""Measurement of a run: minimum and steady turning radius with 95 % intervals, speeds, centre of rotation, phases.

Radius and speed are those of the robot's centre, the middle between the axles. Curvature is the change of the direction
of travel per length of path, positive counter-clockwise. Speeds are positive forward, yaw rate is positive
counter-clockwise.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.pose import NO_HEADING, Poses
from evaluator.turning.motion.fit import FEWEST_FRAMES, Scaled, TurnFit, fit_turn, part, scaled_poses
from evaluator.turning.motion.least_squares import Block, averaged_least_squares
from evaluator.turning.motion.steady_motion import linearised, moved
from evaluator.turning.path import measure_path
from evaluator.turning.phase_table import phase_table, several_motions
from evaluator.turning.phases import find_phases
from evaluator.turning.quantities import Rate, RobotShape, body_quantities, path_quantities, with_sigmas
from evaluator.turning.result import Turning
from evaluator.turning.status import OK, spacing_fault, straightness, variation
from evaluator.turning.sustained import Sustained, sustained_turn

Array = NDArray[np.float64]
NAN = float("nan")


def measure_turning(
    poses: Poses,
    start_s: float | None = None,
    stop_s: float | None = None,
    *,
    shape: RobotShape | None = None,
    left_rpm: float | None = None,
    right_rpm: float | None = None,
) -> Turning:
    """Measure the turning radius and the speeds of one run from its poses.

    shape: for the radii of wheels and corners and the slip angles; with the commanded rpm also the slip ratios.
    start_s, stop_s: times at which the motors were commanded on and off; optional. For a run that does not turn, rests,
    or has too few poses, the radius of the Turning is NaN, with the reason in radius_status. Raises InputError if
    stop_s is not after start_s.
    """
    if start_s is not None and stop_s is not None and stop_s <= start_s:
        raise InputError(f"stop at {stop_s} s is not after start at {start_s} s")
    there = poses.measured
    marks = tuple(poses.geometry.shown()) if poses.geometry else ()
    ratio, ratio_sigma = poses.spacing_ratio()
    unknown = dict.fromkeys(marks, NAN)
    seen = Turning(mark_spacing_ratio=ratio, mark_spacing_ratio_sigma=ratio_sigma)
    seen = replace(seen, mark_speeds_mm_s=unknown, mark_radii_mm=unknown)
    if there.sum() < FEWEST_FRAMES:
        alone = (
            _one_mark(marks[0], poses, start_s, stop_s) if poses.geometry and len(poses.geometry.names) == 1 else None
        )
        return alone or replace(seen, radius_status=_too_few(poses))
    if fault := spacing_fault(poses):
        return replace(seen, radius_status=fault)
    time = poses.time_s[there]
    pose = np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad])[there]
    systematic = None if poses.systematic is None else poses.systematic[there]
    scaled = scaled_poses(pose, poses.covariance[there], systematic)
    if poses.geometry is not None:
        scaled = replace(scaled, place_shifts=poses.geometry.pose_shifts())
    stretched = scaled.stretched_mm
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
    seen = replace(seen, phases=phase_table(time, scaled, stretched, _commanded(time, start_s, stop_s)))
    if several := several_motions(seen.phases, start_s, stop_s):
        return replace(seen, radius_status=several)
    names = phases.names(time)
    if (steady := int((names == "steady").sum())) < FEWEST_FRAMES:
        return replace(seen, radius_status=f"steady turn of {steady} frames; {FEWEST_FRAMES} are needed")
    total = int(((poses.time_s >= phases.steady_start_s) & (poses.time_s <= phases.steady_stop_s)).sum())
    seen, fit, rate = _with_steady_turn(seen, time, scaled, names, total)
    body = body_quantities(fit, rate, poses.geometry, shape, (left_rpm, right_rpm))
    return _with(seen, body)


def _with_steady_turn(
    seen: Turning, time: Array, scaled: Scaled, names: NDArray[np.str_], total: int
) -> tuple[Turning, TurnFit, Rate]:
    """Fill in radii, speeds and the quantities of the path; returns the fit to the steady turn and its rate, too.

    names: (n,) phases of the frames. total: frames of the steady turn, including those without a pose.
    """
    steady = names == "steady"
    stretched = scaled.stretched_mm
    fit = fit_turn(time[steady], part(scaled, steady))
    regions = [names == name for name in ("transient", "steady", "stop")]
    sustained = sustained_turn(time, scaled, regions, fit)
    seen = replace(seen, share_used=float(fit.used.sum() / total))
    rate = _path_rate(fit, time[steady], part(scaled, steady))
    seen = _with_speeds(_with_radii(seen, fit, sustained), fit, rate)
    ratio = np.hypot(*fit.body_twist(scaled.offset_mm)[:2]) / max(np.hypot(*fit.body_twist(np.zeros(2))[:2]), 1e-300)
    point_speed = float(ratio) * abs(seen.speed_mm_s)  # of the point whose path is `stretched`
    path = path_quantities(time, stretched, scaled.sigma_mm, steady, names != "rest", point_speed)
    return _with(seen, path), fit, rate


def _one_mark(name: str, poses: Poses, start_s: float | None, stop_s: float | None) -> Turning:
    """Measurement from a single mark: its path radius and speed, without those of the robot's centre."""
    path = measure_path(poses.time_s, np.column_stack([poses.x_mm, poses.y_mm]), start_s, stop_s)
    return Turning(
        radius_status=f"{NO_HEADING}; {name} mark: {path.summary('mm')}",
        mark_speeds_mm_s={name: path.speed},
        mark_radii_mm={name: path.radius},
        paths={name: path},
    )


def _too_few(poses: Poses) -> str:
    """Number of frames with a pose, and the most common reason for the others, in words."""
    there = poses.measured
    reasons, counts = np.unique(poses.status[~there], return_counts=True)
    common = f" ({reasons[counts.argmax()]})" if len(reasons) else ""
    return f"{int(there.sum())} frames with a pose; {FEWEST_FRAMES} are needed{common}"


def _with(seen: Turning, values: dict[str, Any]) -> Turning:
    """Fill in quantities by their names."""
    return replace(seen, **values)


def _commanded(time: Array, start_s: float | None, stop_s: float | None) -> NDArray[np.bool_]:
    """Frames between the commands."""
    return (time >= (-np.inf if start_s is None else start_s)) & (time <= (np.inf if stop_s is None else stop_s))


def _with_radii(seen: Turning, fit: TurnFit, sustained: Sustained) -> Turning:
    straight, by_places_mm = straightness(fit), fit.radius_by_places_mm()
    curvature, tightest, mean = (
        item.with_radius_error(by_places_mm) for item in (fit.curvature(), sustained.tightest, sustained.mean)
    )
    radius = (NAN, NAN, NAN) if straight else tightest.radius_mm()
    steady = (NAN, NAN, NAN) if straight else mean.radius_mm()
    place = (NAN, NAN) if straight else fit.centers_mm(fit.averaged.mean()[None])[0]
    varies = variation(sustained)
    status = straight or varies or OK
    if not straight and not np.isfinite(radius[0]):
        status = f"{varies or 'varies'}; no stretch turns for certain"
    return replace(
        seen,
        radius_mm=radius[0],
        radius_low_mm=radius[1],
        radius_high_mm=radius[2],
        radius_status=status,
        radius_random_mm=radius[0] ** 2 * tightest.sigma,
        radius_systematic_mm=radius[0] ** 2 * tightest.systematic,
        radius_by_marks_mm=NAN if straight else by_places_mm,
        steady_radius_mm=steady[0],
        steady_radius_low_mm=steady[1],
        steady_radius_high_mm=steady[2],
        radius_varies=sustained.varies,
        radius_variation=abs(sustained.spread_per_mm / sustained.mean.value) if sustained.varies else 0.0,
        sustained_from_s=sustained.from_s if sustained.varies else seen.steady_start_s,
        sustained_to_s=sustained.to_s if sustained.varies else seen.steady_stop_s,
        curvature_per_mm=curvature.value,
        curvature_low_per_mm=curvature.low,
        curvature_high_per_mm=curvature.high,
        center_x_mm=float(place[0]),
        center_y_mm=float(place[1]),
        center_wander_mm=NAN if straight else sustained.wander_mm,
        turned_deg=float(np.degrees(fit.motion.turn_rad)),
        noise_correlation=fit.averaged.correlation(),
        residual_rms_mm=float(np.sqrt((fit.motion.residual_mm[fit.used] ** 2).mean())),
    )


def _path_rate(fit: TurnFit, time: Array, scaled: Scaled) -> Rate:
    """Rate of the path parameter, mm/s, its uncertainty by noise and camera, and its gradient by the fitted motion."""
    interval, stretched = float(np.median(np.diff(time))), scaled.stretched_mm
    ticks = (time[fit.used] - time[fit.used].mean()) / interval
    along = fit.ahead * fit.motion.along_mm[fit.used, None]
    clock = averaged_least_squares(
        Block(ticks, np.zeros_like(ticks), along, np.stack([np.ones_like(ticks), ticks], axis=1)[:, None])
    )
    delta = 1e-5
    gradient = []
    for step in delta * np.eye(4):
        ahead, behind = (
            linearised(stretched, *moved(fit.motion, way), fit.motion.along_mm, fit.motion.length_mm).along_mm[fit.used]
            for way in (step, -step)
        )
        gradient.append(fit.ahead * np.polyfit(ticks, ahead - behind, 1)[0] / (2 * delta * interval))
    value, sigma = float(clock.mean()[1]), float(np.sqrt(clock.spread()[1, 1]))
    shifts = np.zeros((len(ticks), 0)) if scaled.systematic is None else fit.motion.twist @ scaled.systematic[fit.used]
    systematic = fit.ahead * np.polyfit(ticks, shifts, 1)[0] / interval if shifts.size else ()
    return Rate(value / interval, sigma / interval, tuple(gradient), tuple(systematic))


def _with_speeds(seen: Turning, fit: TurnFit, rate: Rate) -> Turning:
    def speeds(twist: Array) -> Array:
        return np.array([np.copysign(np.hypot(twist[0], twist[1]), twist[0]), np.degrees(twist[2])])

    (speed, yaw), random, systematic = with_sigmas(speeds, fit, rate)
    speed_sigma, yaw_sigma = np.hypot(random, systematic)
    return replace(
        seen,
        speed_mm_s=float(speed),
        yaw_rate_deg_s=float(yaw),
        speed_sigma_mm_s=float(speed_sigma),
        yaw_rate_sigma_deg_s=float(yaw_sigma),
        speed_random_mm_s=float(random[0]),
        yaw_rate_random_deg_s=float(random[1]),
    )
