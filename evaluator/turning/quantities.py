"""Quantities derived from a steady turn: radii of points of the robot, slip of its wheels, smoothness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator.mark_geometry import MarkGeometry
from evaluator.turning.motion.fit import TurnFit
from evaluator.turning.phases import local_rates
from evaluator.turning.status import straightness

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
NAN = float("nan")
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
# Columns of slips for robots with four wheels on two axles; slips of other wheels are in further columns.
USUAL_SLIPS = (
    "body_slip_angle_deg",
    *(f"{name}_slip_angle_deg" for name in WHEELS),
    *(f"{name}_slip_ratio" for name in WHEELS[:2]),
)
# Spectral arc length: published settings of the band and of the amplitude below which the spectrum is noise.
SMOOTHNESS_BAND_HZ = 10.0
SMOOTHNESS_AMPLITUDE = 0.05


@dataclass(frozen=True)
class RobotShape:
    """Outline and wheels in the body frame: wheel_positions_mm in the order of wheel_names, body of length by width.

    driven_by: "left", "right", "none" or "caster" of each wheel; wheel_radius_mm: of the driving
    wheels.
    """

    wheel_positions_mm: tuple[tuple[float, float], ...]
    wheel_radius_mm: float
    length_mm: float
    width_mm: float
    wheel_names: tuple[str, ...] = WHEELS
    driven_by: tuple[str, ...] = ("left", "right", "none", "none")

    def corners_mm(self) -> Array:
        """Corners of the body, (4, 2)."""
        x, y = self.length_mm / 2, self.width_mm / 2
        return np.array([[x, y], [x, -y], [-x, y], [-x, -y]])


@dataclass(frozen=True)
class Rate:
    """Growth of the path parameter in time, mm/s, and its standard uncertainty by noise along the path.

    gradient: derivative by the four parameters of the motion, along which the frames are projected. systematic: its
    shifts by the independent errors of the camera, (k,), at the estimated motion.
    """

    value: float
    sigma: float
    gradient: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    systematic: tuple[float, ...] = ()


def slip_angle_deg(velocity: Array) -> float:
    """Slip angle of a body-frame velocity (2,), atan2(v, |u|): the sign convention of the simulated wheels."""
    return float(np.degrees(np.arctan2(velocity[1], abs(velocity[0]))))


def body_quantities(
    fit: TurnFit,
    rate: Rate,
    marks: MarkGeometry | None,
    shape: RobotShape | None,
    rpm: tuple[float | None, float | None],
) -> dict[str, Any]:
    """Radii, speeds and slips of points of the body, by their names in Turning; unknown ones are omitted.

    rate: of the path parameter, which scales the motion. rpm: of the left and right driving wheel.
    """
    twist = fit.body_twist(np.zeros(2)) * rate.value
    rotation = np.array([-twist[1], twist[0]]) / twist[2] if twist[2] else np.full(2, NAN)
    turning = not straightness(fit)  # as the radius: without one, these are huge and arbitrary
    result: dict[str, Any] = {}
    if turning:
        result |= {"rotation_x_mm": float(rotation[0]), "rotation_y_mm": float(rotation[1])}
    speeds, radii = {}, {}
    for name, place in marks.shown().items() if marks else ():
        velocity = _velocity(twist, np.array(place))
        speeds[name] = float(np.copysign(np.hypot(*velocity), velocity[0]))
        radii[name] = float(np.linalg.norm(np.array(place) - rotation)) if turning else NAN
    result |= {"mark_speeds_mm_s": speeds, "mark_radii_mm": radii}
    if shape is not None and turning:
        wheels = np.array(shape.wheel_positions_mm)
        result["outer_wheel_radius_mm"] = float(np.linalg.norm(wheels - rotation, axis=1).max())
        result["wall_to_wall_radius_mm"] = float(np.linalg.norm(shape.corners_mm() - rotation, axis=1).max())
    names = list(_slips(twist, shape, rpm))
    slips, *parts = with_sigmas(lambda moved: np.array(list(_slips(moved, shape, rpm).values())), fit, rate)
    others: dict[str, float] = {}
    for name, slip, sigma in zip(names, slips, np.hypot(*parts), strict=True):
        stem = name.removesuffix("_deg")
        row = result if name in USUAL_SLIPS else others
        row |= {name: float(slip), f"{stem}_sigma{'_deg' if stem != name else ''}": float(sigma)}
    return result | {"other_wheels": others}


def with_sigmas(quantities: Callable[[Array], Array], fit: TurnFit, rate: Rate) -> tuple[Array, Array, Array]:
    """Values (k,) of quantities of the centre's velocity (v_x, v_y, yaw rate), (3,), with their standard uncertainties.

    The first of these is from noise, (k,), the second from camera and places of the marks, (k,). Noise along the path
    affects the rate, and noise across it the direction, independently. An error of the camera affects both at once: one
    of scale makes the speed wrong and the curvature inversely, but not the yaw rate.
    """
    delta, here = 1e-6, fit.averaged.mean()

    def at(step: Array, along: float) -> Array:
        return quantities(fit.body_twists(step[None], np.zeros(2))[0] * along)

    steps, along = delta * np.eye(4), delta * np.array(rate.gradient)
    ends = [
        (at(here + step, rate.value + change), at(here - step, rate.value - change))
        for step, change in zip(steps, along, strict=True)
    ]
    gradient = np.stack([after - before for after, before in ends]) / (2 * delta)
    by_rate = (at(here, rate.value + delta) - at(here, rate.value - delta)) / (2 * delta)
    noise = np.einsum("pi,pq,qi->i", gradient, fit.averaged.spread(), gradient)
    value, by_camera = at(here, rate.value), fit.systematic.T @ gradient + np.outer(rate.systematic, by_rate)
    twist = fit.body_twists(here[None], np.zeros(2))[0] * rate.value
    by_places = np.array([quantities(moved) - value for moved in fit.displaced(twist)]).reshape(-1, len(value))
    systematic = np.linalg.norm(np.concatenate([by_camera, by_places]), axis=0)
    return value, np.sqrt(noise + (by_rate * rate.sigma) ** 2), systematic


def _slips(twist: Array, shape: RobotShape | None, rpm: tuple[float | None, float | None]) -> dict[str, float]:
    """Slip angles of body and wheels and slip ratios of the driving wheels, for the velocity of the centre."""
    result = {"body_slip_angle_deg": slip_angle_deg(twist)}
    commanded = {"left": rpm[0], "right": rpm[1]}
    for name, place, side in (
        zip(shape.wheel_names, shape.wheel_positions_mm, shape.driven_by, strict=True) if shape else ()
    ):
        if side == "caster":
            continue
        assert shape is not None  # otherwise there are no wheels
        velocity = _velocity(twist, np.array(place))
        result[f"{name}_slip_angle_deg"] = slip_angle_deg(velocity)
        speed = commanded.get(side)  # the rotation of a free wheel is unknown
        if speed is not None:
            surface = speed * 2 * np.pi / 60 * shape.wheel_radius_mm
            larger = max(abs(velocity[0]), abs(surface))
            result[f"{name}_slip_ratio"] = float((velocity[0] - surface) / larger) if larger else NAN
    return result


def path_quantities(
    time_s: Array, scaled: Array, sigma_mm: float, steady: Flags, moving: Flags, speed_mm_s: float
) -> dict[str, float]:
    """Path efficiency, speed ripple and smoothness of a run; scaled: (n, 3) poses in mm.

    path_efficiency: length of the fitted path over that of the driven one, which includes lateral deviations;
    speed_ripple: relative standard deviation of the speed in the steady turn; noise is subtracted from both.
    smoothness: spectral arc length of the speed from start to stop, closer to zero is smoother (Balasubramanian et al.
    2015, doi:10.1186/s12984-015-0090-9).
    """
    rates = local_rates(time_s, scaled, sigma_mm, moving)
    squared = (rates.value[:, :2] ** 2).sum(axis=1)
    here = squared[steady]
    noise = rates.sigma**2
    driven = float(np.sqrt(np.maximum(here - noise, 0)).mean())  # only noise across the path lengthens it
    ripple = np.sqrt(max(float(np.var(np.sqrt(here))) - noise, 0.0))
    return {
        "path_efficiency": min(speed_mm_s / driven, 1.0) if driven else NAN,
        "speed_ripple": float(ripple / speed_mm_s) if speed_mm_s else NAN,
        "smoothness": _spectral_arc_length(np.sqrt(squared[moving]), float(np.median(np.diff(time_s)))),
    }


def _velocity(twist: Array, place: Array) -> Array:
    return np.array([twist[0] - twist[2] * place[1], twist[1] + twist[2] * place[0]])


def _spectral_arc_length(speed: Array, interval_s: float) -> float:
    """Minus the length of the normalised amplitude spectrum, up to where it stays below the amplitude limit."""
    padded = 2 ** (int(np.ceil(np.log2(len(speed)))) + 4)
    frequency = np.fft.rfftfreq(padded, interval_s)
    amplitude = np.abs(np.fft.rfft(speed, padded))
    band = frequency <= SMOOTHNESS_BAND_HZ
    if not amplitude[0] > 0:
        return NAN
    frequency, amplitude = frequency[band], amplitude[band] / amplitude[0]
    last = int(np.flatnonzero(amplitude >= SMOOTHNESS_AMPLITUDE)[-1])
    if last < 1:
        return NAN
    step_f, step_a = np.diff(frequency[: last + 1]) / frequency[last], np.diff(amplitude[: last + 1])
    return float(-np.hypot(step_f, step_a).sum())
