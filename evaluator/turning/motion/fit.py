"""Steady motion of an interval of poses with its uncertainty: outliers rejected, noise estimated from residuals.

The geometry is in steady_motion.py: another model of a turn replaces `fit_steady_motion` and returns a SteadyMotion.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from evaluator.turning.motion.curvature import Curvature
from evaluator.turning.motion.least_squares import (
    Averaged,
    Block,
    averaged_least_squares,
    averaged_over_blocks,
    responses,
)
from evaluator.turning.motion.steady_motion import SteadyMotion, bend_design, fit_steady_motion, moved

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Squared Mahalanobis distance (two channels) that Gaussian noise exceeds in one frame of a million: exp(-m²/2) = 1e-6.
OUTLIER_SQUARED = 27.6
MEDIAN_SQUARED = 1.386  # median of chi-squared with two degrees of freedom
# Frames are compared with their neighbours, not with the circle: slow deviations are motion, jumps are errors.
NEIGHBOURS = 31
FEWEST_FRAMES = 8  # two channels each: after the four parameters, twelve values remain for the noise
COVERED = (0.025, 0.975)  # quantiles of a 95 % interval
HALF_TURN = np.pi / 2
MOTION = 4  # parameters of a steady motion: start across it and twist across it


@dataclass(frozen=True)
class TurnFit:
    """A steady motion fitted to an interval of poses.

    offset_mm: (2,) position, in the body frame, of the point whose position and heading noise are uncorrelated (between
    the marks); the motion is that of this point. used: (n,) frames that took part. averaged: steps of the four
    parameters about `motion` with their uncertainty; systematic: (4, k) their shifts by independent errors of the
    camera. ahead: 1 if the path parameter grows with time, else -1. change_rad: (2,) turn due to the change of
    curvature along the path, as coefficients of the first and second Legendre polynomial; zeros if no change was
    fitted. place_shifts: (k, 3) of MarkGeometry.pose_shifts.
    """

    motion: SteadyMotion
    offset_mm: Array
    used: Flags
    averaged: Averaged
    ahead: float
    systematic: Array
    change_rad: Array
    place_shifts: Array

    def body_twists(self, steps: Array, place_mm: Array) -> Array:
        """Velocity (v_x, v_y) and yaw rate of a body point per path parameter: (m, 3) for steps (m, 4)."""
        motion = self.motion
        twist = motion.twist + np.asarray(steps)[:, 2:] @ motion.across.T
        twist = self.ahead * twist / np.linalg.norm(twist, axis=1)[:, None]
        yaw = twist[:, 2] / motion.length_mm
        arm = np.asarray(place_mm) - self.offset_mm
        return np.stack([twist[:, 0] - yaw * arm[1], twist[:, 1] + yaw * arm[0], yaw], axis=1)

    def body_twist(self, place_mm: Array) -> Array:
        """Velocity (v_x, v_y) and yaw rate of a body point per path parameter, (3,), at the estimated motion."""
        return np.asarray(self.body_twists(self.averaged.mean()[None], place_mm)[0])

    def centers_mm(self, steps: Array) -> Array:
        """Plate position of the centre of rotation, (m, 2) for steps (m, 4); not finite where straight."""
        motion = self.motion
        places = []
        for step, twist in zip(np.asarray(steps), self.body_twists(steps, self.offset_mm), strict=True):
            start, _ = moved(motion, step)
            heading = start[2] / motion.length_mm
            with np.errstate(divide="ignore", invalid="ignore"):
                arm = np.array([-twist[1], twist[0]]) / twist[2]
            cos, sin = np.cos(heading), np.sin(heading)
            places.append([start[0] + cos * arm[0] - sin * arm[1], start[1] + sin * arm[0] + cos * arm[1]])
        return np.array(places)

    def center_mm(self) -> tuple[Array, Array]:
        """Plate position of the centre of rotation, (2,), and its covariance by noise, (2, 2)."""
        delta = 1e-5
        gradient = (self.centers_mm(delta * np.eye(4)) - self.centers_mm(-delta * np.eye(4))).T / (2 * delta)
        return self.centers_mm(self.averaged.mean()[None])[0], gradient @ self.averaged.spread() @ gradient.T

    def bend_rad(self, steps: Array) -> Array:
        """Angle with tangent length × curvature of the centre's path; finite for straight motion and on the spot."""
        twist = self.body_twists(steps, np.zeros(2))
        return np.asarray(np.arctan2(self.motion.length_mm * twist[:, 2], np.hypot(twist[:, 0], twist[:, 1])))

    def bend_gradient(self) -> Array:
        """Derivative of `bend_rad` by the four parameters (central difference)."""
        delta = 1e-5
        return np.asarray((self.bend_rad(delta * np.eye(4)) - self.bend_rad(-delta * np.eye(4))) / (2 * delta))

    def displaced(self, twist: Array) -> Array:
        """Twists (k, 3) of the centre that would be measured with each mark elsewhere, for its measured twist (3,)."""
        along, across, turn = self.place_shifts.T
        cos, sin, yaw = np.cos(turn), np.sin(turn), twist[2]
        x, y = twist[0] - yaw * across, twist[1] + yaw * along
        return np.stack([cos * x + sin * y, cos * y - sin * x, np.full_like(x, yaw)], axis=1)

    def radius_by_places_mm(self) -> float:
        """Standard uncertainty of the radius from the places of the marks, the same for all turns to this side."""
        twist = self.body_twist(np.zeros(2))
        arms = np.hypot(*self.displaced(twist)[:, :2].T) - np.hypot(*twist[:2])
        return float(np.linalg.norm(arms) / abs(twist[2])) if twist[2] else 0.0

    def curvature(self) -> Curvature:
        """Curvature of the centre's path with its interval, for marks that are where they are taken to be."""
        length, gradient = self.motion.length_mm, self.bend_gradient()
        base = float(self.bend_rad(np.zeros((1, 4)))[0])
        best = base + float(self.averaged.mean() @ gradient)
        low, high = base + self.averaged.quantiles(gradient, COVERED)
        value, below, above = (float(np.tan(np.clip(a, -HALF_TURN, HALF_TURN)) / length) for a in (best, low, high))
        per_bend = (1 + (value * length) ** 2) / length
        sigma = float(np.sqrt(gradient @ self.averaged.spread() @ gradient) * per_bend)
        systematic = float(np.linalg.norm(gradient @ self.systematic) * per_bend)
        return Curvature(value, below, above, sigma).with_systematic(systematic)


def _body_from_plate(heading_rad: Array) -> Array:
    """Rotations (n, 3, 3) that take plate-frame changes of (x, y, heading) into the body frame."""
    rotation = np.zeros((len(heading_rad), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(heading_rad)
    rotation[:, 0, 1] = np.sin(heading_rad)
    rotation[:, 1, 0] = -rotation[:, 0, 1]
    rotation[:, 2, 2] = 1.0
    return rotation


@dataclass(frozen=True)
class Scaled:
    """Poses of the point whose position and heading noise are uncorrelated; see TurnFit.offset_mm.

    length_mm: factor on headings, so that all three coordinates have equal noise.
    """

    pose: Array  # (n, 3): x, y mm, heading rad, of that point
    covariance: Array  # (n, 3, 3) body frame, mm², heading times length
    offset_mm: Array
    length_mm: float
    sigma_mm: float
    systematic: Array | None = None  # (n, 3, k) body frame, mm: shifts by independent errors common to all frames
    place_shifts: Array = field(default_factory=lambda: np.zeros((0, 3)))  # of MarkGeometry.pose_shifts, mm and rad

    @property
    def stretched_mm(self) -> Array:
        """Poses (n, 3) with headings times length_mm: three coordinates in mm."""
        return np.asarray(self.pose * np.array([1.0, 1.0, self.length_mm]))


def scaled_poses(pose: Array, covariance: Array, systematic: Array | None = None) -> Scaled:
    """Move poses (n, 3) to the point whose position noise is uncorrelated with the heading's, and find the length."""
    rotation = _body_from_plate(pose[:, 2])
    in_body = rotation @ covariance @ np.swapaxes(rotation, 1, 2)
    mean = np.median(in_body, axis=0)
    offset = np.array([-mean[1, 2], mean[0, 2]]) / mean[2, 2]
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    place = pose[:, :2] + np.stack([cos * offset[0] - sin * offset[1], sin * offset[0] + cos * offset[1]], axis=1)
    shift = np.eye(3)
    shift[0, 2], shift[1, 2] = -offset[1], offset[0]
    at_point = shift @ in_body @ shift.T
    position = float(np.median(np.trace(at_point[:, :2, :2], axis1=1, axis2=2)) / 2)
    length = float(np.sqrt(position / np.median(at_point[:, 2, 2])))
    stretch = np.diag([1.0, 1.0, length])
    return Scaled(
        pose=np.column_stack([place, pose[:, 2]]),
        covariance=stretch @ at_point @ stretch,
        offset_mm=offset,
        length_mm=length,
        sigma_mm=float(np.sqrt(position)),
        systematic=None if systematic is None else stretch @ shift @ rotation @ systematic,
    )


def part(scaled: Scaled, where: Flags) -> Scaled:
    """Some frames of scaled poses."""
    systematic = None if scaled.systematic is None else scaled.systematic[where]
    return replace(scaled, pose=scaled.pose[where], covariance=scaled.covariance[where], systematic=systematic)


def fit_turn(time_s: Array, scaled: Scaled) -> TurnFit:
    """Fit a steady motion to all given frames; frames that jump relative to their neighbours are rejected and counted.

    The relative size of the errors comes from the covariances; their scale, their correlation between the two
    channels and in time come from the residuals.
    """
    motion, used = _robust_motion(scaled)
    channel = _channel_factor([_standard(motion, scaled)[used]])
    block = _block(time_s, scaled, motion, used, channel)
    return _turn_fit(motion, scaled, used, averaged_least_squares(block), block, channel)


def fit_turns(time_s: Array, scaled: Scaled, stretches: list[Flags], *, bending: bool = False) -> list[TurnFit]:
    """Fit a steady motion to each of several intervals with common noise.

    bending: the curvature may change within an interval; its mean over the path is estimated.
    """
    parts = [part(scaled, where) for where in stretches]
    fits = [_robust_motion(one) for one in parts]
    channel = _channel_factor([_standard(m, one)[used] for one, (m, used) in zip(parts, fits, strict=True)])
    blocks = tuple(
        _block(time_s[where], one, motion, used, channel, bending=bending)
        for where, one, (motion, used) in zip(stretches, parts, fits, strict=True)
    )
    return [
        _turn_fit(motion, one, used, averaged, block, channel)
        for one, (motion, used), averaged, block in zip(parts, fits, averaged_over_blocks(blocks), blocks, strict=True)
    ]


def _turn_fit(
    motion: SteadyMotion, scaled: Scaled, used: Flags, averaged: Averaged, block: Block, channel: Array
) -> TurnFit:
    along = motion.along_mm[used]
    ahead = 1.0 if np.median(np.sign(np.diff(along))) >= 0 else -1.0
    shift = np.zeros((MOTION, 0))
    if scaled.systematic is not None:
        across = channel @ _whitening(motion, scaled.covariance) @ motion.across.T @ scaled.systematic
        shift = responses(averaged, block, across[used])[:MOTION]
    change = averaged.mean()[MOTION:] * float(np.ptp(along)) if averaged.estimate.shape[1] > MOTION else np.zeros(2)
    averaged = replace(
        averaged, estimate=averaged.estimate[:, :MOTION], covariance=averaged.covariance[:, :MOTION, :MOTION]
    )
    return TurnFit(motion, scaled.offset_mm, used, averaged, ahead, shift, change, scaled.place_shifts)


def _robust_motion(scaled: Scaled) -> tuple[SteadyMotion, Flags]:
    """Least-squares motion of the frames that do not jump, weighted by their own covariances."""
    n = len(scaled.pose)
    used = np.ones(n, dtype=bool)
    motion = fit_steady_motion(scaled.pose, scaled.length_mm, np.broadcast_to(np.eye(2), (n, 2, 2)).copy())
    for attempt in range(6):
        whitening = _whitening(motion, scaled.covariance)
        standard = np.einsum("nij,nj->ni", whitening, motion.residual_mm)
        kept = _not_jumping(standard)
        settled, used = bool(np.all(kept == used)), kept
        channel = _channel_factor([standard[used]])
        whitening = channel @ whitening
        weight = np.swapaxes(whitening, 1, 2) @ whitening * used[:, None, None]
        weight = weight / np.mean(np.trace(weight[used], axis1=1, axis2=2))
        motion = fit_steady_motion(scaled.pose, scaled.length_mm, weight, near=motion)
        if settled and attempt > 0:
            break
    return motion, used


def _not_jumping(standard: Array) -> Flags:
    size = min(NEIGHBOURS, 2 * (len(standard) // 4) + 1)
    squared = ((standard - median_filter(standard, size=(size, 1), mode="nearest")) ** 2).sum(axis=1)
    return np.asarray(squared <= OUTLIER_SQUARED * np.median(squared) / MEDIAN_SQUARED)


def _block(
    time_s: Array, scaled: Scaled, motion: SteadyMotion, used: Flags, channel: Array, *, bending: bool = False
) -> Block:
    whitening = channel @ _whitening(motion, scaled.covariance)
    design = (
        np.concatenate([motion.design, bend_design(motion, scaled.offset_mm)], axis=2) if bending else motion.design
    )
    return Block(
        time=time_s[used] / float(np.median(np.diff(time_s))),
        heading_rad=scaled.pose[used, 2],
        residual=np.einsum("nij,nj->ni", whitening, motion.residual_mm)[used],
        design=(whitening @ design)[used],
    )


def _whitening(motion: SteadyMotion, covariance: Array) -> Array:
    """Inverse Cholesky factors of the covariance across the motion, (n, 2, 2)."""
    across = motion.across.T @ covariance @ motion.across
    return np.asarray(np.linalg.inv(np.linalg.cholesky(across)))


def _standard(motion: SteadyMotion, scaled: Scaled) -> Array:
    return np.asarray(np.einsum("nij,nj->ni", _whitening(motion, scaled.covariance), motion.residual_mm))


def _channel_factor(standard: list[Array]) -> Array:
    """Factor (2, 2) that brings standardised residuals (k, 2) of each stretch to unit variance and no correlation."""
    values = np.concatenate(standard)
    moment = values.T @ values / max(len(values) - 2 * len(standard), 1)
    floor = 1e-6 * max(float(np.trace(moment)), 1e-24)  # a channel without noise keeps a finite weight
    return np.asarray(np.linalg.inv(np.linalg.cholesky(moment + floor * np.eye(2))))
