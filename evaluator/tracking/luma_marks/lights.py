"""Light-emitting diodes: bright compact blobs of any colour, followed from frame to frame.

If there are as many blobs as lights, these are the lights; if there are more, those that move while the others (glare
on the plate) rest. Several lights look alike: they are named from left to right when they are first identified, unless
region_px assigns them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.robust import PER_MEDIAN
from evaluator.tracking.observation import ABSENT, OK, Sighting
from evaluator.tracking.settings import Box, MarkSettings, TrackingSettings

Array = NDArray[np.float64]
NOT_SEEN, AMBIGUOUS, OUTSIDE = ABSENT["not seen"], ABSENT["ambiguous"], ABSENT["outside the image"]
HALF = 0.4  # level of a light's core between the background (0) and the brightest pixel (1)
WEAKEST = 0.35  # of the light of the weakest light: blobs with less are rejected
NOISES = 8.0  # standard deviations of the background: least height of a light
LEAST_AREA, LARGEST_SHARE, STRIPE = 3, 0.02, 4.0  # px; share of the frame; length over width
WINDOW = 2.5  # radii of the core: size of the window in which a light with its halo is measured
MOVED, STEP = 1.5, 3.0  # radii: distance that shows motion; step between frames beyond the usual one
SATURATED_PX = 0.03  # least uncertainty per axis of a light with a clipped core
MOST = 24  # blobs that are followed until the lights are known
# Share of a light's height over the background below which a pixel has no weight, as in thresholded centroids of spots.
WINGS = 0.15
RING, FEW = 0.8, 8  # share of the window beyond which pixels show the surroundings; least number of such pixels


@dataclass
class _Blob:
    """A bright blob: centre, radius of its core, light above the background, variances; px of the luma."""

    place: tuple[float, float]
    radius: float
    light: float
    variance: tuple[float, float]
    cut: bool  # whether the border of the frame cuts it
    first: tuple[float, float] = (0.0, 0.0)
    velocity: tuple[float, float] = (0.0, 0.0)
    missed: int = 0

    def expected(self) -> tuple[float, float]:
        """Predicted position."""
        return tuple(p + (1 + self.missed) * v for p, v in zip(self.place, self.velocity, strict=True))  # type: ignore[return-value]


class LightFinder:
    """Finds the lights of a recording frame by frame."""

    def __init__(self, marks: dict[str, MarkSettings], settings: TrackingSettings) -> None:
        """marks: those of kind light, by name. settings: where to look."""
        self.names = list(marks)
        self._marks, self._settings = marks, settings
        self._rivals: list[_Blob] = []
        self._lights: dict[str, _Blob] = {}

    def look(self, frame: Frame) -> dict[str, Sighting]:
        """Measure every light in the next frame; px of the full frame."""
        blobs = [blob for blob in bright_blobs(frame).blobs if allowed(blob.place, frame, self._settings)]
        if not self._lights:
            self._decide(blobs, frame)
            if not self._lights:
                return dict.fromkeys(self.names, AMBIGUOUS if self._rivals else NOT_SEEN)
            return {name: _sighting(self._lights[name], frame) for name in self.names}
        found: dict[str, Sighting] = {}
        free = list(blobs)
        for name in sorted(self.names, key=lambda name: self._lights[name].missed):
            light = self._lights[name]
            blob = _nearest(light, free)
            if blob is None:
                light.missed += 1
                found[name] = NOT_SEEN
                continue
            free.remove(blob)
            self._lights[name] = _moved_on(light, blob)
            found[name] = OUTSIDE if blob.cut else _sighting(blob, frame)
        return {name: found[name] for name in self.names}

    def _decide(self, blobs: list[_Blob], frame: Frame) -> None:
        """Choose the lights among the blobs, or follow all candidates until some of them move."""
        if self._rivals:
            free = list(blobs)
            followed = []
            for rival in self._rivals:
                blob = _nearest(rival, free)
                if blob is not None:
                    free.remove(blob)
                    followed.append(_moved_on(rival, blob))
            self._rivals = followed
        strongest = sorted(blobs, key=lambda blob: -blob.light)
        if len(strongest) < len(self.names):
            return
        least = WEAKEST * strongest[len(self.names) - 1].light
        likely = [blob for blob in strongest if blob.light > least][:MOST]
        if not self._rivals:
            for blob in likely:
                blob.first = blob.place
            self._rivals = likely
        chosen = likely if len(likely) == len(self.names) else [one for one in self._rivals if _has_moved(one)]
        if len(chosen) == len(self.names):
            self._lights = _named(chosen, self._marks, frame)
            self._rivals = []


def _named(chosen: list[_Blob], marks: dict[str, MarkSettings], frame: Frame) -> dict[str, _Blob]:
    """Lights by name: those with a region first, the others from left to right."""
    free, found = sorted(chosen, key=lambda blob: blob.place), dict[str, _Blob]()
    for name, mark in marks.items():
        inside = [blob for blob in free if mark.region_px and _inside(blob.place, mark.region_px, frame)]
        if inside:
            found[name] = inside[0]
            free.remove(inside[0])
    for name in marks:
        if name not in found:
            found[name] = free.pop(0)
    return found


def _has_moved(blob: _Blob) -> bool:
    return math.dist(blob.place, blob.first) > MOVED * blob.radius


def _nearest(light: _Blob, blobs: list[_Blob]) -> _Blob | None:
    """The blob that continues a light: near its predicted position, of about its size."""
    expected = light.expected()
    reach = (STEP * light.radius + math.hypot(*light.velocity)) * (1 + light.missed)
    near = [b for b in blobs if math.dist(b.place, expected) < reach and 0.4 < b.radius / light.radius < 2.5]
    return min(near, key=lambda blob: math.dist(blob.place, expected), default=None)


def _moved_on(light: _Blob, blob: _Blob) -> _Blob:
    """The light updated with its blob."""
    step = np.subtract(blob.place, light.place) / (1 + light.missed)
    blob.velocity = float(step[0]), float(step[1])
    blob.first, blob.missed = light.first, 0
    return blob


@dataclass(frozen=True)
class BrightBlobs:
    """Bright compact blobs of a frame, in px of its luma.

    level: luma above which a pixel is bright; mask: bright pixels. refused: boxes (left, top, width, height) and areas
    of bright regions that `shape_fault` rejects.
    """

    blobs: list[_Blob]
    level: float
    mask: NDArray[np.uint8]
    refused: list[tuple[int, int, int, int, int]]


def shape_fault(box: tuple[int, int, int, int, int], size: int) -> str:
    """Why a bright blob is not a light, by its box and area; empty if it may be one. size: pixels of the frame."""
    _, _, wide, high, area = box
    if area < LEAST_AREA:
        return f"too small: {area} px, at least {LEAST_AREA} are needed"
    if area > LARGEST_SHARE * size:
        return f"too large: {100 * area / size:.0f} % of the frame"
    if max(wide, high) > STRIPE * min(wide, high):
        return f"a stripe: {wide} by {high} px"
    return ""


def bright_blobs(frame: Frame) -> BrightBlobs:
    """Blobs brighter than half-way to the brightest, and than the noise of the background."""
    luma = frame.luma
    sample = luma[::7, ::5].astype(float)
    base = float(np.median(sample))
    noise = max(PER_MEDIAN * float(np.median(np.abs(sample - base))), 1.0)
    level = base + max(NOISES * noise, HALF * (float(luma.max()) - base))
    mask = (luma > level).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    found, refused = [], []
    for label in range(1, count):
        left, top, wide, high, area = (int(value) for value in stats[label])
        if shape_fault((left, top, wide, high, area), luma.size):
            refused.append((left, top, wide, high, area))
            continue
        found.append(_weighed(luma, np.asarray(labels, np.int32), label, (left, top, wide, high), base, noise))
    return BrightBlobs(found, level, mask, refused)


def _weighed(
    luma: NDArray[np.unsignedinteger], labels: NDArray[np.int32], label: int, box: tuple[int, int, int, int],
    base: float, noise: float,
) -> _Blob:  # fmt: skip
    """Centre of a blob weighted by its light, including its halo, without that of its neighbours."""
    left, top, wide, high = box
    radius = max(wide, high) / 2
    x, y = left + (wide - 1) / 2, top + (high - 1) / 2
    reach = WINDOW * radius + 1
    rows = slice(max(math.floor(y - reach), 0), math.ceil(y + reach) + 1)
    columns = slice(max(math.floor(x - reach), 0), math.ceil(x + reach) + 1)
    part, owner = luma[rows, columns].astype(float), labels[rows, columns]
    around_y, around_x = np.mgrid[
        rows.start : rows.start + part.shape[0], columns.start : columns.start + part.shape[1]
    ]
    mine = ((owner == 0) | (owner == label)) & (np.hypot(around_x - x, around_y - y) <= reach)
    # The wings of a halo determine its centre poorly, and less of them is visible on a dark background: they are cut
    # off.
    wings = base + max(2 * noise, WINGS * (float(part[owner == label].max()) - base))
    weight = np.where(mine, np.maximum(part - wings, 0.0), 0.0)
    ring = mine & (owner == 0) & (np.hypot(around_x - x, around_y - y) > RING * reach)
    if ring.sum() >= FEW:  # the background beside the light, not that of the whole frame
        noise = max(float(np.std(weight[ring])), 1.0)
    total = float(weight.sum())
    cx, cy = float((weight * around_x).sum() / total), float((weight * around_y).sum() / total)
    spread = [float((mine * (axis - at) ** 2).sum()) for axis, at in ((around_x, cx), (around_y, cy))]
    variance = tuple((noise**2 + 1 / 12) * value / total**2 + SATURATED_PX**2 for value in spread)
    height, width = luma.shape
    cut = left == 0 or top == 0 or left + wide == width or top + high == height
    return _Blob((cx, cy), radius, total, (variance[0], variance[1]), cut)


def _sighting(blob: _Blob, frame: Frame) -> Sighting:
    (x, y), (var_x, var_y) = blob.place, blob.variance
    return Sighting(x, frame.row_origin + frame.row_step * y, var_x, frame.row_step**2 * var_y, 0.0, OK)


def allowed(place: tuple[float, float], frame: Frame, settings: TrackingSettings) -> bool:
    """Whether the settings allow a light at a position, px of the luma."""
    within = settings.region_px is None or _inside(place, settings.region_px, frame)
    return within and not any(_inside(place, box, frame) for box in settings.mask_px)


def _inside(place: tuple[float, float], box: Box, frame: Frame) -> bool:
    x, y = place[0], frame.row_origin + frame.row_step * place[1]
    return box[0] <= x <= box[2] and box[1] <= y <= box[3]
