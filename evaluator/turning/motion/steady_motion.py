"""Steady planar motion: circle, straight line and turn on the spot as one model, fitted to poses without a singularity.

A body in a steady turn has a constant velocity in its own frame, so that its poses lie on a one-parameter subgroup of
the planar motions: pose(t) = start · exp(t · twist), twist = (v_x, v_y, yaw rate). The speed along it is free in every
frame; only the direction of the twist is estimated. Position and heading both contribute: the heading gained per path
length gives the curvature to first order in the angle turned, the bend of the path only to second order, so that short
arcs gain most over a circle fit. Headings are scaled by length_mm, which gives position and heading equal noise.

Coordinates: (x, y, length · heading), mm. Algebra of SE(2): Murray, Li and Sastry, Robotic Manipulation (1994), chapter
2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.turning.motion.subgroup import composed, linearise

Array = NDArray[np.float64]

CONVERGED = 1e-10  # squared step in units of its own variance: a hundred-thousandth of the standard error


@dataclass(frozen=True)
class SteadyMotion:
    """A fitted one-parameter motion and its linearisation.

    start: (3,) pose at parameter 0, (x, y, length · heading). twist: (3,) of unit length in the same units, body frame.
    along_mm: (n,) parameter of every frame. residual_mm: (n, 2) deviation across the motion, in the basis `across`, (3,
    2), the orthonormal complement of the twist. design: (n, 2, 4) derivative of the prediction by (start across, twist
    across).
    """

    length_mm: float
    start: Array
    twist: Array
    along_mm: Array
    residual_mm: Array
    design: Array
    across: Array

    @property
    def turn_rad(self) -> float:
        """Heading range covered."""
        return float(np.ptp(self.along_mm) * abs(self.twist[2]) / self.length_mm)


def fit_steady_motion(
    pose: Array, length_mm: float, weight: Array, near: SteadyMotion | None = None, iterations: int = 30
) -> SteadyMotion:
    """Fit the motion by Gauss-Newton least squares.

    pose: (n, 3) of x, y in mm and unwrapped heading in rad, no NaN. weight: (n, 2, 2) inverse covariance of the
    deviation across the motion (any scale); frames with weight zero are only predicted. near: initial value.
    """
    scaled = pose * np.array([1.0, 1.0, length_mm])
    if near is None:
        start, twist = _first_guess(scaled, length_mm, weight[:, 0, 0] > 0)
        along = _first_along(scaled, start, twist, length_mm)
    else:
        start, twist, along = near.start, near.twist, near.along_mm
    for _ in range(iterations):
        motion = linearised(scaled, start, twist, along, length_mm)
        design, residual = motion.design.reshape(-1, 4), motion.residual_mm.reshape(-1)
        weighted = (weight @ motion.design).reshape(-1, 4)
        normal, right = weighted.T @ design, weighted.T @ residual
        step = _solved(normal, right)
        start, twist = moved(motion, step)
        along = motion.along_mm
        misfit = residual @ (weight @ motion.residual_mm[:, :, None]).reshape(-1)
        if step @ normal @ step < CONVERGED * misfit / len(pose) or np.all(np.abs(step) < 1e-12):
            break
    return linearised(scaled, start, twist, along, length_mm)


def moved(motion: SteadyMotion, step: Array) -> tuple[Array, Array]:
    """Start pose and unit twist after a step (4,) in the coordinates of the design."""
    start = _composed(motion.start, motion.across @ step[:2], motion.length_mm)
    twist = motion.twist + motion.across @ step[2:]
    return start, twist / np.linalg.norm(twist)


def bend_design(motion: SteadyMotion, offset_mm: Array) -> Array:
    """Derivative (n, 2, 2) of the prediction by a change of curvature along the path, in rad per mm of parameter.

    offset_mm: position of the motion's point in the body frame; the curvature is that of the body's centre.

    The two columns are Legendre polynomials of first and second degree over the interval, which leave the mean
    curvature unchanged. An additional turn dφ at an earlier position moves a later pose sideways by dφ times the
    distance.
    """
    order = np.argsort(motion.along_mm, kind="stable")
    along = motion.along_mm[order]
    span = float(np.ptp(along)) or 1.0
    share = 2 * (along - along[0]) / span - 1
    length, turn = motion.length_mm, along * motion.twist[2] / motion.length_mm
    velocity = np.array([motion.twist[0] + 1j * motion.twist[1]])
    # Positions on the motion as complex numbers, relative to parameter 0; its start cancels in the body frame.
    rate = motion.twist[2] / length
    place = velocity * along * np.exp(0.5j * turn) * np.sinc(rate * along / 2 / np.pi)
    center = place - np.exp(1j * turn) * (offset_mm[0] + 1j * offset_mm[1])
    columns = []
    for primitive, bend in ((share**2 / 2, share), ((share**3 - share) / 2, (3 * share**2 - 1) / 2)):
        turned = (primitive - primitive[0]) * span / 2
        steps = np.diff(along, prepend=along[0])
        weighed = bend * center
        moment = np.cumsum(steps * (weighed + np.concatenate([weighed[:1], weighed[:-1]])) / 2)
        shift = 1j * (place * turned - moment) * np.exp(-1j * turn)
        columns.append(np.stack([shift.real, shift.imag, length * turned], axis=1) @ motion.across)
    design = np.empty((len(along), 2, 2))
    design[order] = np.stack(columns, axis=2)
    return design


def _solved(normal: Array, right: Array) -> Array:
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    return np.asarray(np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-13)[0] / scale)


def _first_guess(scaled: Array, length: float, used: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Start and twist from linear relations, as initial values of Gauss-Newton."""
    there = scaled[used]
    heading = there[:, 2] / length
    middle = len(there) // 2
    if np.ptp(heading) > 0.7:
        # Rotation about a fixed centre: p = c + R(heading) q is linear in c and q.
        cos, sin, one, zero = np.cos(heading), np.sin(heading), np.ones(len(there)), np.zeros(len(there))
        rows = np.concatenate([np.stack([one, zero, cos, -sin], 1), np.stack([zero, one, sin, cos], 1)])
        solution = np.linalg.lstsq(rows, np.concatenate([there[:, 0], there[:, 1]]), rcond=None)[0]
        arm = solution[2:]  # body-frame position relative to the centre: velocity = yaw rate × arm
        turn = np.sign(heading[-1] - heading[0]) or 1.0
        twist = turn * np.array([-arm[1], arm[0], length])
        cos0, sin0 = cos[middle], sin[middle]
        place = solution[:2] + np.array([cos0 * arm[0] - sin0 * arm[1], sin0 * arm[0] + cos0 * arm[1]])
        return np.array([*place, there[middle, 2]]), twist / np.linalg.norm(twist)
    quarter = max(len(there) // 4, 1)
    first, last = there[:quarter].mean(axis=0), there[-quarter:].mean(axis=0)
    center, step = there.mean(axis=0), last - first
    angle = center[2] / length
    cos0, sin0 = np.cos(angle), np.sin(angle)
    twist = np.array([cos0 * step[0] + sin0 * step[1], -sin0 * step[0] + cos0 * step[1], step[2]])
    norm = np.linalg.norm(twist)
    return center, twist / norm if norm > 0 else np.array([1.0, 0.0, 0.0])


def _first_along(scaled: Array, start: Array, twist: Array, length: float) -> Array:
    if twist[2] != 0 and np.ptp(scaled[:, 2]) > 0.3 * length:  # a turn by 0.3 rad: headings order the frames
        return np.asarray((scaled[:, 2] - start[2]) / twist[2])
    angle = start[2] / length
    direction = np.array(
        [np.cos(angle) * twist[0] - np.sin(angle) * twist[1], np.sin(angle) * twist[0] + np.cos(angle) * twist[1]]
    )
    return np.asarray((scaled[:, :2] - start[:2]) @ direction + (scaled[:, 2] - start[2]) * twist[2])


def linearised(scaled: Array, start: Array, twist: Array, along: Array, length: float) -> SteadyMotion:
    """Closest points on the motion, residuals across it, and their derivatives."""
    across = _complement(twist)
    along, residual, design = linearise(np.ascontiguousarray(scaled), start, twist, along, across, length)
    return SteadyMotion(length, start, twist, along, residual, design, across)


def _composed(start: Array, twist: Array, length: float) -> Array:
    """Pose start · exp(twist), both (3,)."""
    return np.asarray(composed(start, twist[0], twist[1], twist[2], length))


def _complement(twist: Array) -> Array:
    """Two orthonormal directions across a unit twist, (3, 2)."""
    left = np.array([-twist[1], twist[0], 0.0])
    norm = np.linalg.norm(left)
    left = left / norm if norm > 1e-9 else np.array([0.0, 1.0, 0.0])
    (x, y, turn), (a, b, _) = twist, left
    return np.array([[a, -turn * b], [b, turn * a], [0.0, x * b - y * a]])  # the second column is twist × left
