"""Steady motion of a stretch of poses with its uncertainty: outliers out, noise estimated from what is left over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.turning.noise import Averaged, averaged_least_squares
from evaluator.turning.steady_motion import SteadyMotion, fit_steady_motion

Array = NDArray[np.float64]

# Mahalanobis distance squared (two channels) beyond which a Gaussian frame lies once in a million: exp(-m²/2) = 1e-6.
OUTLIER_SQUARED = 27.6
MEDIAN_SQUARED = 1.386  # median of chi-squared with two degrees of freedom
FEWEST_FRAMES = 6


@dataclass(frozen=True)
class TurnFit:
    """A steady motion fitted to a stretch of poses.

    offset_mm: (2,) body-frame place of the point whose position and heading noise are uncorrelated (between the marks);
    the motion is that of this point. used: (n,) frames that took part. channel: (n, 2, 2) factor that brings residuals
    to unit variance; averaged: steps of the four parameters about `motion` with their uncertainty.
    """

    motion: SteadyMotion
    offset_mm: Array
    used: NDArray[np.bool_]
    channel: Array
    averaged: Averaged

    def body_twist(self, step: Array, place_mm: Array) -> Array:
        """Velocity (v_x, v_y) and yaw rate per unit of path parameter, of a body point: (m, 3) for steps (m, 4)."""
        motion = self.motion
        twist = motion.twist + np.asarray(step)[:, 2:] @ motion.across.T
        twist = twist / np.linalg.norm(twist, axis=1)[:, None]
        yaw = twist[:, 2] / motion.length_mm
        arm = np.asarray(place_mm) - self.offset_mm
        return np.stack([twist[:, 0] - yaw * arm[1], twist[:, 1] + yaw * arm[0], yaw], axis=1)


def body_covariance(covariance: Array, heading_rad: Array) -> Array:
    """Turn plate-frame covariances (n, 3, 3) of (x, y, heading) into the body frame."""
    rotation = np.zeros((len(heading_rad), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(heading_rad)
    rotation[:, 0, 1] = np.sin(heading_rad)
    rotation[:, 1, 0] = -rotation[:, 0, 1]
    rotation[:, 2, 2] = 1.0
    return np.asarray(rotation @ covariance @ np.swapaxes(rotation, 1, 2))


@dataclass(frozen=True)
class Scaled:
    """Poses of the quiet point of the body, heading in units of length: noise of all three coordinates is alike."""

    pose: Array  # (n, 3): x, y mm, heading rad, of the quiet point
    covariance: Array  # (n, 3, 3) body frame, mm², heading times length
    offset_mm: Array
    length_mm: float
    sigma_mm: float


def scaled_poses(pose: Array, covariance: Array) -> Scaled:
    """Move poses (n, 3) to the point whose position noise is uncorrelated with the heading's, and find the length."""
    in_body = body_covariance(covariance, pose[:, 2])
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
        np.column_stack([place, pose[:, 2]]), stretch @ at_point @ stretch, offset, length, float(np.sqrt(position))
    )


def fit_turn(time_s: Array, scaled: Scaled) -> TurnFit:
    """Fit a steady motion to all given frames; frames that stand out are set aside and counted.

    The relative size of the errors comes from the covariances; their scale, their correlation between the two
    channels and in time come from the residuals.
    """
    n = len(time_s)
    used = np.ones(n, dtype=bool)
    weight = np.broadcast_to(np.eye(2), (n, 2, 2)).copy()
    motion = fit_steady_motion(scaled.pose, scaled.length_mm, weight)
    for attempt in range(8):
        whitening = _whitening(motion, scaled.covariance)
        if attempt > 0:  # wild frames must be out before the channels' own scatter is taken
            whitening = _channel_factor(whitening, motion, used) @ whitening
        squared = (np.einsum("nij,nj->ni", whitening, motion.residual_mm) ** 2).sum(axis=1)
        scale = np.median(squared[used]) / MEDIAN_SQUARED
        kept = squared <= OUTLIER_SQUARED * max(scale, 1e-300)
        settled = bool(np.all(kept == used))
        used = kept
        weight = np.swapaxes(whitening, 1, 2) @ whitening * used[:, None, None]
        weight = weight / np.mean(np.trace(weight[used], axis1=1, axis2=2))
        motion = fit_steady_motion(scaled.pose, scaled.length_mm, weight, near=motion)
        if settled and attempt > 0:
            break
    whitening = _whitening(motion, scaled.covariance)
    whitening = _channel_factor(whitening, motion, used) @ whitening
    interval = float(np.median(np.diff(time_s)))
    residual = np.einsum("nij,nj->ni", whitening, motion.residual_mm)[used]
    design = (whitening @ motion.design)[used]
    averaged = averaged_least_squares(time_s[used] / interval, scaled.pose[used, 2], residual, design)
    return TurnFit(motion, scaled.offset_mm, used, whitening, averaged)


def _whitening(motion: SteadyMotion, covariance: Array) -> Array:
    """Inverse Cholesky factors of the covariance across the motion, (n, 2, 2)."""
    across = motion.across.T @ covariance @ motion.across
    return np.asarray(np.linalg.inv(np.linalg.cholesky(across)))


def _channel_factor(whitening: Array, motion: SteadyMotion, used: NDArray[np.bool_]) -> Array:
    """Factor (2, 2) that brings the two standardised channels to unit variance and no correlation."""
    standard = np.einsum("nij,nj->ni", whitening, motion.residual_mm)[used]
    moment = standard.T @ standard / max(len(standard) - 2, 1)
    floor = 1e-6 * max(float(np.trace(moment)), 1e-24)  # an exact channel keeps a finite weight
    return np.asarray(np.linalg.inv(np.linalg.cholesky(moment + floor * np.eye(2))))
