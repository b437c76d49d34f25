"""Search for a known mark in the whole image."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.detection import color_kernels
from evaluator.tracking.detection.color_map import allowed_cells
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.following.follow_blob import BlobFollower
from evaluator.tracking.settings import TrackingSettings

Array = NDArray[np.float64]


# Largest aspect ratio of a bounding box: for discs, which blur enlarges at the threshold; for oblong stickers.
ROUND, OBLONG = 3.0, 8.0
WEAKER = 0.5  # of the usual minimum chroma: a blurred mark is paler at its rim


class Search:
    """Finds blobs of a learnt colour and size; reuses its masks from frame to frame."""

    def __init__(self, frame: Frame, settings: TrackingSettings, cell: Array) -> None:
        """frame: any frame of the recording, for its size."""
        assert frame.u is not None
        self._cell = cell
        self._allowed = {name: allowed_cells(frame, settings, mark) for name, mark in settings.mark.items()}
        self._mask = np.zeros(frame.u.shape, np.uint8)

    def places(
        self, name: str, frame: Frame, follower: Follower | BlobFollower, light: float
    ) -> list[tuple[float, float]]:
        """Centres of the blobs that may be the mark, most probable size first; light: over that when it was learnt."""
        color, area, cell = follower.color, follower.look.area_px2, self._cell
        longest = OBLONG if isinstance(follower, BlobFollower) else ROUND
        count, top, bottom, left, right = color_kernels.color_scan(
            frame.u, frame.v, self._allowed[name], color, min(WEAKER, light) * color[4], self._mask
        )
        cell_area = cell[0] * cell[1]
        if count * cell_area < 0.35 * area:
            return []
        part = np.ascontiguousarray(self._mask[top : bottom + 1, left : right + 1])
        number, _, stats, centers = cv2.connectedComponentsWithStats(part, connectivity=8)
        found = []
        for label in range(1, number):
            size = stats[label, cv2.CC_STAT_AREA] * cell_area / area
            wide, high = stats[label, cv2.CC_STAT_WIDTH] * cell[0], stats[label, cv2.CC_STAT_HEIGHT] * cell[1]
            if 0.35 < size < 3.0 and max(wide, high) < longest * min(wide, high):
                x, y = centers[label]
                place = float(cell[2] + cell[0] * (left + x)), float(cell[3] + cell[1] * (top + y))
                found.append((abs(np.log(size)), place))
        return [place for _, place in sorted(found)]


def mean_light(frame: Frame) -> float:
    """Mean luma of the frame above black, from a few hundred of its pixels."""
    return max(float(frame.luma[::37, ::23].mean()) - frame.black, 1e-9)
