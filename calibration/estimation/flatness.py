"""Shape of a bent gauge: height of low polynomial order over the array, common to all images of a set.

z(u, v) = Σ cₖ Pᵢ(u) Pⱼ(v) with Legendre polynomials over the array's box, u and v from -1 to 1: three terms of second
order, four of third. Orders zero and one are the pose's. Gauge frame, mm; coefficients in mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.gauge.geometry import Gauge

Array = NDArray[np.float64]
TERMS = 7  # Legendre products of second and third order; tilt and height belong to the pose
QUADRATIC = 3  # of these, the ones of second order
# 95 % quantile of the peak to valley of random faces, in sigmas of their seven independent normal coefficients
# (simulated: 9.97 to 9.99 on arrays of 11 by 8 to 41 by 31 dots).
PEAK_TO_VALLEY_SIGMAS = 10.0
WIDEST = 0.05  # of the array's half length: no plate bends more; a coefficient's sigma if flatness is not stated
DRAWS = 1000  # of the face, which determine the limits of its peak to valley to a few percent
# Sigmas over the peak to valley. A rigid face touches the plate between its mean plane and its farthest point, which
# for a dome is 2/3 of the peak to valley away: two sigmas. A twisted face stands on three corners and leans by half of
# it.
REST, LEAN = 1 / 3, 1 / 4


def face_terms(gauge: Gauge) -> Array:
    """Values of the terms at the dots: (rows, columns, TERMS)."""
    place = gauge.positions_mm()
    low, high = place.min(axis=(0, 1)), place.max(axis=(0, 1))
    u, v = np.moveaxis((2 * place - low - high) / (high - low), -1, 0)
    second_u, second_v = (3 * u**2 - 1) / 2, (3 * v**2 - 1) / 2
    third_u, third_v = (5 * u**3 - 3 * u) / 2, (5 * v**3 - 3 * v) / 2
    return np.stack([second_u, u * v, second_v, third_u, second_u * v, u * second_v, third_v], axis=-1)


def coefficient_sigma(gauge: Gauge) -> float:
    """Prior standard deviation of each coefficient, mm: from the stated flatness, else WIDEST."""
    stated = gauge.tolerance.flatness_mm
    if stated is None:
        return WIDEST * float(np.ptp(gauge.positions_mm().reshape(-1, 2), axis=0).max()) / 2
    return stated / PEAK_TO_VALLEY_SIGMAS


@dataclass(frozen=True)
class Flatness:
    """Flatness of the gauge from the images: peak to valley over the array with its 95 % interval, mm.

    coefficients_mm: (k,), with their covariance_mm2 (k, k). used: whether the camera was solved with this face;
    otherwise it was assumed to be flat, because the images show no bend, and high_mm bounds a bend that they cannot
    exclude. mean_square_mm2: of the peak to valley, including its uncertainty. slope_square: mean square slope of the
    face, including its uncertainty.
    """

    coefficients_mm: Array
    covariance_mm2: Array
    peak_to_valley_mm: float
    low_mm: float
    high_mm: float
    mean_square_mm2: float
    slope_square: float
    used: bool = True


def flatness_of(gauge: Gauge, coefficients_mm: Array, covariance_mm2: Array, *, used: bool = True) -> Flatness:
    """Peak to valley of a face from its coefficients (k,) and their covariance (k, k)."""
    terms = face_terms(gauge)[..., : len(coefficients_mm)]
    value, vector = np.linalg.eigh(covariance_mm2)
    spread = vector * np.sqrt(np.maximum(value, 0.0))
    # fixed seed: an interval must not change from call to call
    normal = np.random.default_rng(0).standard_normal((DRAWS, len(coefficients_mm)))
    faces = np.tensordot(coefficients_mm + normal @ spread.T, terms, axes=(1, 2))
    drawn = np.ptp(faces, axis=(1, 2))
    return Flatness(
        coefficients_mm=coefficients_mm,
        covariance_mm2=covariance_mm2,
        peak_to_valley_mm=float(np.ptp(terms @ coefficients_mm)),
        low_mm=float(np.quantile(drawn, 0.025)),
        high_mm=float(np.quantile(drawn, 0.975)),
        mean_square_mm2=float(np.mean(drawn**2)),
        slope_square=_slope_square(gauge, faces),
        used=used,
    )


def _slope_square(gauge: Gauge, faces: Array) -> float:
    """Mean square slope of faces (draws, rows, columns), along either axis."""
    along, down = gauge.pitch_mm
    by_row, by_column = np.diff(faces, axis=1) / down, np.diff(faces, axis=2) / along
    return float(np.mean(by_row**2) + np.mean(by_column**2)) / 2


def bend_scale(flatness: Flatness) -> float:
    """Relative uncertainty of lengths due to a bent gauge.

    A sheet bent after printing keeps its lengths along the face, and seen from above is shorter by half the mean square
    slope; a sheet printed while bent is not. Half of this difference is the uncertainty.
    """
    return flatness.slope_square / 4


def rest_covariance(flatness: Flatness, gauge: Gauge, pose: Array) -> Array:
    """Covariance (6, 6) of the plate's pose due to the unknown contact points of a bent gauge on the plate.

    Pose parameters as in camera.py. The plane's height and its two tilts about the middle of the array are uncertain.
    """
    bend = np.sqrt(flatness.mean_square_mm2)
    place = gauge.positions_mm().reshape(-1, 2)
    low, high = place.min(axis=0), place.max(axis=0)
    rotation = cv2.Rodrigues(np.ascontiguousarray(pose[:3]))[0]
    middle = np.array([*(low + high) / 2, gauge.dots.height_mm])
    raised = np.concatenate([np.zeros(3), REST * bend * rotation[:, 2]])
    changes = [raised]
    for axis in (0, 1):
        step = 1e-4
        lean = LEAN * bend / ((high - low)[1 - axis] / 2)
        turned = rotation @ cv2.Rodrigues(step * np.eye(3)[axis])[0]
        by_vector = (_vector_beside(turned, pose[:3]) - pose[:3]) / step
        by_shift = (rotation - turned) @ middle / step
        changes.append(lean * np.concatenate([by_vector, by_shift]))
    return np.asarray(sum(np.outer(change, change) for change in changes))


def _vector_beside(rotation: Array, vector: Array) -> Array:
    """The rotation vector (3,) of a rotation that is closest to another vector; near half a turn there are two.

    This matters because a camera that looks straight down is half a turn from the plate's frame.
    """
    found = cv2.Rodrigues(rotation)[0][:, 0]
    other = found * (1 - 2 * np.pi / max(float(np.linalg.norm(found)), 1e-9))
    return np.asarray(min((found, other), key=lambda each: float(np.linalg.norm(each - vector))))
