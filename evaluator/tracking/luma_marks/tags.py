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
AROUND = 1.5  # sides of a tag: range around its last position that is searched before the whole frame
# Families in the order in which they are tried, most used first, until one shows a tag that is sought. A dictionary
# contains the first tags of its family: the smallest one with the number is read most reliably.
FAMILIES = {
    "aruco": ("4X4", "5X5", "6X6", "7X7", "ARUCO_ORIGINAL", "ARUCO_MIP_36H12"),
    "apriltag": ("APRILTAG_36H11", "APRILTAG_25H9", "APRILTAG_16H5", "APRILTAG_36H10"),
}
SIZES = (50, 100, 250, 1000)  # tags in the dictionaries of an ArUco family
# px: least side. The smallest tag has six cells across, and a cell needs two samples. The side of a followed tag stays
# above half of its length from one frame to the next.
LEAST_SIDE_PX, SHRUNK = 12.0, 0.5
SLANTING = 2.0**0.5  # largest ratio of the length of a side to its number of outline pixels, which OpenCV counts


def tag_names(name: str) -> list[str]:
    """Names of the measured points of a tag: its centre and its corners, in the order of OpenCV."""
    return [name, *(f"{name}_corner{k}" for k in range(1, CORNERS + 1))]


class TagFinder:
    """Finds the tags of a recording frame by frame."""

    def __init__(self, marks: dict[str, MarkSettings]) -> None:
        """marks: those of kind aruco and apriltag, by name. Raises InputError for one without a number."""
        self._numbers = {name: number_of(name, mark) for name, mark in marks.items()}
        self._ways = {
            name: tuple(_detector(one) for one in dictionaries(name, mark, self._numbers[name]))
            for name, mark in marks.items()
        }
        self._last: dict[str, Array] = {}
        self.names = [part for name in marks for part in tag_names(name)]

    def look(self, frame: Frame) -> dict[str, Sighting]:
        """Measure every tag in the next frame; px of the full frame."""
        luma = luma_of_8_bits(frame)
        found: dict[str, Sighting] = {}
        seen: dict[int, dict[int, Array]] = {}  # tags of the whole frame, by detector
        for name in self._ways:
            corners = self._near(name, luma)
            if corners is None:
                corners = self._anywhere(name, luma, seen)
            found |= self._measured(name, corners, luma, frame)
        return found

    def _near(self, name: str, luma: Image) -> Array | None:
        """Corners near the last position of the tag; None if it is not there."""
        last = self._last.get(name)
        if last is None:
            return None
        side = float(np.hypot(*(last[0] - last[2])))
        low = np.maximum(np.floor(last.min(axis=0) - AROUND * side), 0).astype(int)
        high = np.ceil(last.max(axis=0) + AROUND * side).astype(int) + 1
        part = luma[low[1] : high[1], low[0] : high[0]]
        least = max(SHRUNK * side / SLANTING, LEAST_SIDE_PX)  # side: length of the diagonal
        numbers = _detected(self._ways[name][0], part, least) if min(part.shape) > 8 else {}
        corners = numbers.get(self._numbers[name])
        return None if corners is None else corners + low

    def _anywhere(self, name: str, luma: Image, seen: dict[int, dict[int, Array]]) -> Array | None:
        """Corners in the whole frame; the family with which the tag is first read becomes that of the tag."""
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


def luma_of_8_bits(frame: Frame) -> Image:
    """Luma as 8-bit image for OpenCV's detectors."""
    luma: Image = frame.luma if frame.depth == 8 else np.asarray(frame.luma >> (frame.depth - 8))
    return np.ascontiguousarray(luma, np.uint8)


def number_of(name: str, mark: MarkSettings) -> int:
    """Return the number of a tag. Raises InputError for a tag without one."""
    if mark.id is not None:
        return mark.id
    found = re.search(r"\d+$", name)
    if found is None:
        raise InputError(f"mark {name} is a tag without a number; say id, or end its name in the number")
    return int(found[0])


def dictionaries(name: str, mark: MarkSettings, number: int) -> tuple[str, ...]:
    """Dictionaries that may contain a tag, most probable first. Raises InputError for an unknown dictionary."""
    if mark.dictionary is not None:
        wanted = f"DICT_{mark.dictionary.upper().removeprefix('DICT_')}"
        known = [item for item in dir(cv2.aruco) if item.startswith("DICT_")]
        exact = next((item for item in known if item.upper() == wanted), None)
        if exact is None:
            raise InputError(f"mark {name}: dictionary {mark.dictionary} is none of OpenCV's: {_listed(known)}")
        return (exact,)
    chosen = []
    for family in FAMILIES[mark.kind]:
        size = next((size for size in SIZES if number < size), None)
        dictionary = f"DICT_{family}_{size}" if "X" in family else f"DICT_{family}"
        exact = next((item for item in dir(cv2.aruco) if item.upper() == dictionary), None)
        if exact is not None and number < len(_dictionary(exact).bytesList):
            chosen.append(exact)
    if not chosen:
        raise InputError(f"mark {name}: no dictionary holds a tag {number}; is its id right?")
    return tuple(chosen)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(item.removeprefix("DICT_").lower() for item in names)


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def _detector(name: str) -> cv2.aruco.ArucoDetector:
    return cv2.aruco.ArucoDetector(_dictionary(name), cv2.aruco.DetectorParameters())


def outlines(
    dictionary: str, luma: Image, least_side_px: float = LEAST_SIDE_PX
) -> tuple[list[tuple[int, Array]], list[Array]]:
    """Tags of a dictionary in an image, as numbers and corners (4, 2), and corners of other squares."""
    return _outlines(_detector(dictionary), luma, least_side_px)


def _outlines(
    detector: cv2.aruco.ArucoDetector, luma: Image, least_side_px: float
) -> tuple[list[tuple[int, Array]], list[Array]]:
    # Every outline is read as a tag: without a limit in px, the grain of a floor would cost more than everything else.
    parameters = detector.getDetectorParameters()
    parameters.minMarkerPerimeterRate = 4 * least_side_px / SLANTING / max(luma.shape)
    detector.setDetectorParameters(parameters)
    corners, numbers, refused = detector.detectMarkers(np.ascontiguousarray(luma))
    placed = [points.reshape(CORNERS, 2).astype(float) for points in corners]
    found = list(zip([] if numbers is None else [int(one) for one in numbers.ravel()], placed, strict=True))
    return found, [points.reshape(CORNERS, 2).astype(float) for points in refused]


def _detected(detector: cv2.aruco.ArucoDetector, luma: Image, least_side_px: float = LEAST_SIDE_PX) -> dict[int, Array]:
    """Corners (4, 2) of the tags in an image by number; of several with one number, the largest."""
    found: dict[int, Array] = {}
    for number, place in _outlines(detector, luma, least_side_px)[0]:
        if number not in found or _size(place) > _size(found[number]):
            found[number] = place
    return found


def _size(corners: Array) -> float:
    return float(np.hypot(*(corners[0] - corners[2])))
