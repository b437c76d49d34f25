"""Image → sub-pixel centres of dots with a standard uncertainty each. Image frame, px.

The centre is that of the ellipse fitted to the dot's blurred edge; for its offset from the projected centre of the disc
see calibration.estimation.disc_projection.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibration.assignment.neighbours import nearest
from calibration.detection.candidates import (
    NO_CANDIDATES,
    WINDOWS,
    Candidates,
    all_candidates,
    candidates_by_window,
    noise_of,
)
from calibration.detection.disturbed import doubted, fit_again
from calibration.detection.ellipse_fit import fit_dots
from calibration.detection.image import Plane, dark_dots
from calibration.detection.initial_ellipses import start_values
from calibration.detection.noise_correlation import correlation_factors

Array = NDArray[np.float64]

# Largest residual of a blurred disc, without the image's white noise, over its contrast. Letters and corners have 0.15
# and more, dots at SNR 10 in JPEG images 0.12 including their noise.
LARGEST_MISFIT = 0.14
TRIALS = 50  # blobs fitted to evaluate a window, which determine its share of dots to 7 %
# The search stops at a window with so many dots, so large a share of the blobs, and no dot wider than half the window.
PLENTY = (25, 0.8)
SAME = 0.15  # of the radius: blobs of two thresholds that are closer are one


@dataclass(frozen=True, repr=False)
class Dots:
    """Dots found in one image, in no order.

    size_px: (width, height) of the image. centers_px: (n, 2). covariance_px2: (n, 2, 2). diameter_px: (n,) geometric
    mean of the ellipse's axes. contrast: (n,) background minus dot, in image units, positive.
    background: (n,) level around it. blur_px: (n,) standard deviation of the edge. noise: (n,) standard
    deviation of the residual. shape: (n, 3) ellipse matrix A. color: (n, channels) mean inside the dot, in image
    units. plane: (h, w) the image as it was searched, dots dark.
    """

    size_px: tuple[int, int]
    centers_px: Array
    covariance_px2: Array
    diameter_px: Array
    contrast: Array
    background: Array
    blur_px: Array
    noise: Array
    shape: Array
    color: Array
    plane: Plane

    def __repr__(self) -> str:
        """One line: count of dots, and size of the image."""
        return f"Dots({len(self)} in an image of {self.size_px[0]} × {self.size_px[1]} px)"

    def __len__(self) -> int:
        """Count of dots."""
        return len(self.centers_px)

    def take(self, index: NDArray[np.bool_] | NDArray[np.int64]) -> Dots:
        """Some of the dots."""
        whole = {"size_px", "plane"}
        return replace(self, **{f.name: getattr(self, f.name)[index] for f in fields(self) if f.name not in whole})


def detect_dots(image: NDArray[np.generic], color: str | None = None, background: str | None = None) -> Dots:
    """Find all dots of an image.

    image: (h, w) or (h, w, 3) BGR, any number type. color, background: of dots and sheet, as in gauge.toml; without
    them the sign of contrast that gives more dots is used. No dots is a result, not an error.
    """
    plane = dark_dots(image, color, background)
    signs = (1.0,) if color is not None and background is not None else (1.0, -1.0)
    noise = noise_of(plane)
    votes = [_Vote(_signed(plane, sign), sign) for sign in signs]
    for window, candidates in candidates_by_window(plane, noise):
        for vote in votes:
            if vote.open:
                vote.try_window(window, candidates(vote.sign), noise)
        if not any(vote.open for vote in votes):
            break
    best = max(votes, key=lambda vote: vote.votes)
    return _dots(image, best.plane, *_fit(best.plane, best.candidates, noise, correlated=True))


def every_dot(image: NDArray[np.generic], color: str | None = None, background: str | None = None) -> list[Dots]:
    """Find all possible dots of all sizes: one set of dots for each possible sign of contrast.

    Arguments as for `detect_dots`, which is much faster because it uses only the best window; that window may miss some
    dots of a grid of few large dots in front of a cluttered background.
    """
    plane = dark_dots(image, color, background)
    noise = noise_of(plane)
    signs = (1.0,) if color is not None and background is not None else (1.0, -1.0)
    found = []
    for sign, candidates in zip(signs, all_candidates(plane, noise, signs), strict=True):
        signed = _signed(plane, sign)
        fitted, covariance, rest = _fit(signed, _distinct(candidates), noise, correlated=True)
        keep = _without_doubles(fitted, rest)
        found.append(_dots(image, signed, fitted[keep], covariance[keep], rest[keep]))
    return found


def _signed(plane: Plane, sign: float) -> Plane:
    return plane if sign > 0 else -plane


def _distinct(candidates: Candidates) -> Candidates:
    """Remove blobs found again by another threshold, whose fits would end at the same dot."""
    radius = np.sqrt(candidates.area_px / np.pi)
    keys = np.column_stack([candidates.center_px / (SAME * radius[:, None]), np.log(radius) / SAME])
    first = np.unique(np.floor(keys).astype(np.int64), axis=0, return_index=True)[1]
    return candidates.take(first)


def _without_doubles(fitted: Array, noise: Array) -> NDArray[np.intp]:
    """Indices of fits of distinct dots; of several fits at one place, the one with the smallest residual."""
    if len(fitted) == 0:
        return np.empty(0, dtype=np.intp)
    radius = np.sqrt(_area(fitted) / np.pi)
    tree = cKDTree(fitted[:, :2])
    misfit = noise / np.maximum(-fitted[:, 7], 1e-12)
    left_out = np.zeros(len(fitted), dtype=bool)
    chosen = []
    for k in np.argsort(misfit, kind="stable"):
        if left_out[k]:
            continue
        chosen.append(k)
        left_out[tree.query_ball_point(fitted[k, :2], 0.5 * radius[k])] = True
    return np.array(chosen, dtype=np.intp)


@dataclass
class _Vote:
    """Search for the window with the most dots of one sign of contrast, weighted so that a dot outweighs many specks.

    plane: the image times the sign. votes: sum of the diameters. open: whether a wider window may be better.
    """

    plane: Plane
    sign: float
    votes: float = 0.0
    candidates: Candidates = NO_CANDIDATES
    open: bool = True

    def try_window(self, window: int, candidates: Candidates, noise: float) -> None:
        """Count the dots among some of a window's blobs."""
        every = max(1, len(candidates) // TRIALS)
        tried = candidates.take(np.arange(0, len(candidates), every))
        area = _area(_fit(self.plane, tried, noise)[0])
        vote = every * float(np.sqrt(area).sum())
        if vote > self.votes:
            self.votes, self.candidates = vote, candidates
        plenty = len(area) >= max(PLENTY[0], PLENTY[1] * len(tried))
        self.open = not (plenty and 2 * np.sqrt(np.median(area) / np.pi) < 0.5 * window)
        if vote < 0.5 * self.votes and window > WINDOWS[0]:  # wider windows lose dots in uneven light
            self.open = False


def _fit(
    plane: Plane, candidates: Candidates, white_noise: float, *, correlated: bool = False
) -> tuple[Array, Array, Array]:
    """Parameters (n, 10), covariance (n, 2, 2) and noise (n,) of the candidates that are dots.

    correlated: whether to estimate the correlation of noise between pixels.
    """
    if len(candidates) == 0:
        return np.empty((0, 10)), np.empty((0, 2, 2)), np.empty(0)
    gap = np.full(len(candidates), np.inf)
    if len(candidates) > 1:
        gap = np.ascontiguousarray(nearest(candidates.center_px, 1)[0][:, 0])
    starts, reach, possible = start_values(plane, candidates.center_px, candidates.moments_px2, gap)
    starts, reach = starts[possible], reach[possible]
    fitted, covariance, noise = found = fit_dots(plane, starts, reach)
    fit_again(plane, reach, found)
    with np.errstate(invalid="ignore", divide="ignore"):
        good = (noise**2 < (LARGEST_MISFIT * fitted[:, 7]) ** 2 + white_noise**2) & (fitted[:, 7] < 0)
        # blur wider than the dot's radius: a smudge without an edge
        good &= fitted[:, 5] < np.sqrt(_area(fitted) / np.pi)
        good &= _whole(fitted, plane.shape)
    fitted, covariance, noise, reach = fitted[good], covariance[good], noise[good], reach[good]
    if correlated:
        factors = correlation_factors(plane, fitted, reach, noise)
        covariance = covariance * np.outer(factors, factors)
    return fitted, doubted(fitted, covariance, noise), noise


def _whole(fitted: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Whether a dot's blurred edge lies within the image: a dot cut by the rim has a biased centre."""
    determinant = np.maximum(fitted[:, 2] * fitted[:, 4] - fitted[:, 3] ** 2, 1e-12)
    reach_x = np.sqrt(fitted[:, 4] / determinant) + 2.5 * fitted[:, 5]
    reach_y = np.sqrt(fitted[:, 2] / determinant) + 2.5 * fitted[:, 5]
    inside = (fitted[:, 0] > reach_x - 0.5) & (fitted[:, 0] < shape[1] - 0.5 - reach_x)
    return np.asarray(inside & (fitted[:, 1] > reach_y - 0.5) & (fitted[:, 1] < shape[0] - 0.5 - reach_y))


def _area(fitted: Array) -> Array:
    return np.asarray(np.pi / np.sqrt(np.maximum(fitted[:, 2] * fitted[:, 4] - fitted[:, 3] ** 2, 1e-12)))


def _dots(image: NDArray[np.generic], plane: Plane, fitted: Array, covariance: Array, noise: Array) -> Dots:
    height, width = image.shape[:2]
    column = np.clip(fitted[:, 0].round().astype(int), 1, width - 2)
    row = np.clip(fitted[:, 1].round().astype(int), 1, height - 2)
    channels = image.reshape(height, width, -1)
    color = np.mean([channels[row + i, column + j] for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=0, dtype=float)
    return Dots(
        size_px=(width, height),
        centers_px=fitted[:, :2],
        covariance_px2=covariance,
        diameter_px=2 * np.sqrt(_area(fitted) / np.pi),
        contrast=-fitted[:, 7],
        background=fitted[:, 6],
        blur_px=fitted[:, 5],
        noise=noise,
        shape=fitted[:, 2:5],
        color=color,
        plane=plane,
    )
