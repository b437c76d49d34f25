"""ArUco and AprilTag: OpenCV reads the number, straight lines through the four borders give corners and centre."""

from __future__ import annotations

import re
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.recording import Frame
from evaluator.tracking.luma_marks.tag_borders import measured_tag
from evaluator.tracking.observation import ABSENT, OK, Sighting
from evaluator.tracking.settings import MarkSettings

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
NOT_SEEN, NO_SHAPE = ABSENT["not seen"], ABSENT["disturbed"]
CORNERS = 4
AROUND = 1.5  # sides of a tag that are looked at around where it was, before the whole frame is
# Families that are tried, most used first, until one of them shows a tag that is sought. A dictionary is the first so
# many tags of its family: the smallest that holds the number is read most safely.
FAMILIES = {
    "aruco": ("4X4", "5X5", "6X6", "7X7", "ARUCO_ORIGINAL", "ARUCO_MIP_36H12"),
    "apriltag": ("APRILTAG_36H11", "APRILTAG_25H9", "APRILTAG_16H5", "APRILTAG_36H10"),
}
SIZES = (50, 100, 250, 1000)


def tag_names(name: str) -> list[str]:
    """Names of what is measured of a tag: its centre and its corners, in the order of OpenCV."""
    return [name, *(f"{name}_corner{k}" for k in range(1, CORNERS + 1))]


class TagFinder:
    """Finds the tags of a recording frame by frame."""

    def __init__(self, marks: dict[str, MarkSettings]) -> None:
        """marks: those of kind aruco and apriltag, by name. Raises InputError for one without a number."""
        self._numbers = {name: _number(name, mark) for name, mark in marks.items()}
        self._ways = {name: _detectors(name, mark, self._numbers[name]) for name, mark in marks.items()}
        self._last: dict[str, Array] = {}
        self.names = [part for name in marks for part in tag_names(name)]

    def look(self, frame: Frame) -> dict[str, Sighting]:
        """Measure every tag in the next frame; px of the full frame."""
        luma: Image = frame.luma if frame.depth == 8 else np.asarray(frame.luma >> (frame.depth - 8))
        luma = np.ascontiguousarray(luma, np.uint8)
        found: dict[str, Sighting] = {}
        seen: dict[int, dict[int, Array]] = {}  # tags of the whole frame, by detector
        for name in self._ways:
            corners = self._near(name, luma)
            if corners is None:
                corners = self._anywhere(name, luma, seen)
            found |= self._measured(name, corners, luma, frame)
        return found

    def _near(self, name: str, luma: Image) -> Array | None:
        """Corners where the tag was, or nothing."""
        last = self._last.get(name)
        if last is None:
            return None
        side = float(np.hypot(*(last[0] - last[2])))
        low = np.maximum(np.floor(last.min(axis=0) - AROUND * side), 0).astype(int)
        high = np.ceil(last.max(axis=0) + AROUND * side).astype(int) + 1
        part = luma[low[1] : high[1], low[0] : high[0]]
        corners = _detected(self._ways[name][0], part).get(self._numbers[name]) if min(part.shape) > 8 else None
        return None if corners is None else corners + low

    def _anywhere(self, name: str, luma: Image, seen: dict[int, dict[int, Array]]) -> Array | None:
        """Corners in the whole frame; the family that shows the tag first is the family of the tag."""
        for way in self._ways[name]:
            if id(way) not in seen:
                seen[id(way)] = _detected(way, luma)
            corners = seen[id(way)].get(self._numbers[name])
            if corners is not None:
                self._ways[name] = (way,)
                return corners
        return None

    def _measured(self, name: str, corners: Array | None, luma: Image, frame: Frame) -> dict[str, Sighting]:
        names = tag_names(name)
        self._last.pop(name, None)
        if corners is None:
            return dict.fromkeys(names, NOT_SEEN)
        self._last[name] = corners
        measured = measured_tag(luma, corners)
        if measured is None:
            return dict.fromkeys(names, NO_SHAPE)
        points, covariances = measured
        to_frame = np.array([1.0, float(frame.row_step)])
        points = points * to_frame + np.array([0.0, float(frame.row_origin)])
        covariances = covariances * np.outer(to_frame, to_frame)
        return {
            part: Sighting(float(point[0]), float(point[1]), float(cov[0, 0]), float(cov[1, 1]), float(cov[0, 1]), OK)
            for part, point, cov in zip(names, points, covariances, strict=True)
        }


def _number(name: str, mark: MarkSettings) -> int:
    if mark.id is not None:
        return mark.id
    found = re.search(r"\d+$", name)
    if found is None:
        raise InputError(f"mark {name} is a tag without a number; say id, or end its name in the number")
    return int(found[0])


def _detectors(name: str, mark: MarkSettings, number: int) -> tuple[cv2.aruco.ArucoDetector, ...]:
    """Ways to read a tag, the likeliest first. Raises InputError for a dictionary that there is not."""
    if mark.dictionary is not None:
        wanted = f"DICT_{mark.dictionary.upper().removeprefix('DICT_')}"
        known = [item for item in dir(cv2.aruco) if item.startswith("DICT_")]
        exact = next((item for item in known if item.upper() == wanted), None)
        if exact is None:
            raise InputError(f"mark {name}: dictionary {mark.dictionary} is none of OpenCV's: {_listed(known)}")
        return (_detector(exact),)
    chosen = []
    for family in FAMILIES[mark.kind]:
        size = next((size for size in SIZES if number < size), None)
        dictionary = f"DICT_{family}_{size}" if "X" in family else f"DICT_{family}"
        exact = next((item for item in dir(cv2.aruco) if item.upper() == dictionary), None)
        if exact is not None and number < len(_dictionary(exact).bytesList):
            chosen.append(_detector(exact))
    if not chosen:
        raise InputError(f"mark {name}: no dictionary holds a tag {number}; is its id right?")
    return tuple(chosen)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(item.removeprefix("DICT_").lower() for item in names)


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def _detector(name: str) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = 0.01  # a tag on a small robot is a few percent of the frame
    return cv2.aruco.ArucoDetector(_dictionary(name), parameters)


def _detected(detector: cv2.aruco.ArucoDetector, luma: Image) -> dict[int, Array]:
    """Corners (4, 2) of the tags in an image by their number; of one number the largest."""
    corners, numbers, _ = detector.detectMarkers(np.ascontiguousarray(luma))
    found: dict[int, Array] = {}
    for points, number in zip(corners, [] if numbers is None else numbers.ravel(), strict=False):
        place = points.reshape(CORNERS, 2).astype(float)
        if int(number) not in found or _size(place) > _size(found[int(number)]):
            found[int(number)] = place
    return found


def _size(corners: Array) -> float:
    return float(np.hypot(*(corners[0] - corners[2])))
