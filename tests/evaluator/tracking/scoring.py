"""How measured centres compare with the truth of a drawn clip, and the method that anybody writes first beside them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from tests.evaluator.tracking.plain_video import Clip

Array = NDArray[np.float64]


def threshold_and_centroid(path: Path, clip: Clip) -> dict[str, Array]:
    """Centroid of the largest blob within a range of hues, at least 20 px², (n, 2) by mark; NaN without one."""
    places: dict[str, list[tuple[float, float]]] = {name: [] for name in clip.truth}
    hues = np.arange(256) * 360 / 256
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            hsv = cv2.cvtColor(frame.to_ndarray(format="rgb24"), cv2.COLOR_RGB2HSV_FULL)
            vivid = (hsv[..., 1] > 80) & (hsv[..., 2] > 80)
            for name in clip.truth:
                low, high = clip.hues_deg[name]
                within = np.mod(hues - low, 360) < np.mod(high - low, 360)
                mask = (within[hsv[..., 0]] & vivid).astype(np.uint8)
                count, _, stats, centers = cv2.connectedComponentsWithStats(mask, connectivity=8)
                best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])) if count > 1 else 0
                good = best and stats[best, cv2.CC_STAT_AREA] >= 20
                places[name].append(tuple(centers[best]) if good else (np.nan, np.nan))
    return {name: np.array(points) for name, points in places.items()}


@dataclass(frozen=True)
class Score:
    """How measured centres compare with the truth.

    found: share of the marks in view that are measured and not wrong. wrong: measured marks that lie farther off than
    half the mark, or where there is none. scatter_px: root mean square of the rest's error per axis about its mean.
    normalised: of their errors over their sigmas; NaN without sigmas.
    """

    found: float
    wrong: int
    scatter_px: float
    normalised: float


def score(clip: Clip, measured: dict[str, Array], sigmas: dict[str, Array] | None = None) -> Score:
    """Compare centres with the truth, all marks together."""
    due = good = wrong = 0
    errors, normal = [np.empty((0, 2))], [np.empty((0, 2))]
    for name, truth in clip.truth.items():
        error = measured[name] - truth
        there = np.isfinite(measured[name][:, 0])
        right = there & (np.hypot(*error.T) <= clip.half_px)
        due += int(np.isfinite(truth[:, 0]).sum())
        good += int(right.sum())
        wrong += int((there & ~right).sum())
        if right.any():
            errors.append(error[right] - error[right].mean(axis=0))
            if sigmas is not None:
                normal.append(error[right] / sigmas[name][right])
    scatter, ratio = (
        float(np.sqrt(np.mean(np.concatenate(part) ** 2))) if sum(map(len, part)) else float("nan")
        for part in (errors, normal)
    )
    return Score(good / max(due, 1), wrong, scatter, ratio)
