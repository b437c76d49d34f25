"""ArUco and AprilTag markers as squares on the robot: a black one on a white sheet, white cells in it.

The marker's columns run along the body's x axis, its rows along −y: seen from above, with the robot heading along +x
of the image, it stands upright.
"""

from __future__ import annotations

import re

import cv2
import numpy as np
from numpy.typing import NDArray

from simulator.errors import SimulationError
from simulator.mark_layout import Mark

Array = NDArray[np.float64]
DICTIONARIES = {"aruco": cv2.aruco.DICT_4X4_50, "apriltag": cv2.aruco.DICT_APRILTAG_36h11}
QUIET = 1.0  # cells of white around the black border


def tag_number(mark: Mark) -> int:
    """Number of a tag: its id, or the number at the end of its name. Raises SimulationError if there is neither."""
    if mark.id is not None:
        return mark.id
    found = re.search(r"\d+$", mark.name)
    if found is None:
        raise SimulationError(f"mark {mark.name} is a tag without a number; set id, or end its name with the number")
    return int(found[0])


def tag_squares(mark: Mark) -> tuple[Array, Array, Array]:
    """Corners of the white sheet (4, 2), of the black square on it (4, 2), and of the white cells in it (n, 4, 2).

    mm from the tag's centre in the body frame. Raises SimulationError for a number that is not in the dictionary.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[mark.kind])
    number, count = tag_number(mark), dictionary.markerSize + 2
    if number >= len(dictionary.bytesList):
        raise SimulationError(f"mark {mark.name}: there is no tag {number} among {len(dictionary.bytesList)}")
    white = cv2.aruco.generateImageMarker(dictionary, number, count) > 0
    cell = mark.diameter_mm / count
    rows, columns = np.nonzero(white)
    centers = np.stack([columns + 0.5 - count / 2, count / 2 - rows - 0.5], axis=1) * cell
    square = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])
    return square * (count + 2 * QUIET) * cell, square * mark.diameter_mm, centers[:, None] + square * cell
