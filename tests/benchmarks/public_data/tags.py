"""Drawn AprilTags of ViSP's benchmark: corners by OpenCV, by OpenCV with its own refinement, and by turnscope."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.luma_marks.tag_borders import measured_tag
from evaluator.tracking.luma_marks.tags import outlines
from tests.benchmarks.public_data.sets import TAGS

Array = NDArray[np.float64]
FAMILIES = {"tag36_11": "DICT_APRILTAG_36h11", "tag25_09": "DICT_APRILTAG_25h9", "tag16_05": "DICT_APRILTAG_16h5"}
CENTER = 0.5  # ViSP's drawing counts from the corner of the first pixel, not from its centre


def tags(folder: Path) -> None:
    """Tags found and RMS error of a corner's coordinate, px."""
    print("\ndrawn AprilTags: found, error of a corner, px")
    place = TAGS.find(folder)
    if place is None:
        print(TAGS.reason)
        return
    for family, dictionary in FAMILIES.items():
        truth = _truth(place / f"corners_{family}.txt")
        image = cv2.imread(str(place / f"{family}_640x480.png"), cv2.IMREAD_GRAYSCALE)
        if image is None:
            print(f"{family}: left out, no image")
            continue
        luma = np.asarray(image, np.uint8)
        cells = []
        start = time.process_time()
        read = [(number, corners) for number, corners in outlines(dictionary, luma)[0] if number in truth]
        seconds = time.process_time() - start
        ours = {number: found[0][1:] for number, corners in read if (found := measured_tag(luma, corners)) is not None}
        for name, corners in (("turnscope", ours), ("OpenCV", dict(read)), ("OpenCV, sub-pixel", _refined(luma, read))):
            cells.append(f"{name} {len(corners)} of {len(truth)}, {_error(corners, truth):.3f}")
        print(f"{family}: {'; '.join(cells)}; {1000 * seconds:.0f} ms to read them")


def _truth(path: Path) -> dict[int, Array]:
    found: dict[int, list[list[float]]] = {}
    number = -1
    for line in path.read_text(encoding="utf-8").splitlines():
        parts = line.split()
        if len(parts) == 1:
            number = int(parts[0])
            found[number] = []
        elif parts:
            found[number].append([float(part) for part in parts])
    return {number: np.array(corners) - CENTER for number, corners in found.items()}


def _refined(luma: NDArray[np.uint8], read: list[tuple[int, Array]]) -> dict[int, Array]:
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)
    refined = {}
    for number, corners in read:
        points = corners.astype(np.float32).reshape(-1, 1, 2).copy()
        refined[number] = np.asarray(cv2.cornerSubPix(luma, points, (3, 3), (-1, -1), criteria), float).reshape(-1, 2)
    return refined


def _error(found: dict[int, Array], truth: dict[int, Array]) -> float:
    """RMS over all tags; the order of the corners is that which fits best: the drawing counts another way round."""
    squares = [
        min(float(np.mean((np.roll(truth[number][::way], turn, axis=0) - corners) ** 2))
            for turn in range(4) for way in (1, -1))
        for number, corners in found.items()
    ]  # fmt: skip
    return float(np.sqrt(np.mean(squares))) if squares else float("nan")
