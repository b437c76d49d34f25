"""Image files as the sensor saw them: orientation tags are notes for viewers, and turn nothing here.

A camera is calibrated in the pixels of its sensor. A phone that looks straight down writes any of the eight
orientations of EXIF (tag 274), and another for the next image: obeyed, they would turn the plate under a camera that
never moved.
"""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

ORIENTATION, UPRIGHT = 274, 1  # TIFF 6.0, p. 36
SHORT = 3  # type of the tag's value: 16 bits


def read_pixels(path: Path) -> NDArray[np.generic] | None:
    """Decode an image file: (height, width), or (height, width, channels) BGR, of 8 bits, 16 bits or floats.

    None for what is no image, or a damaged one. Raises OSError where the file cannot be read.
    """
    raw = np.fromfile(path, dtype=np.uint8)
    if raw.size == 0:
        return None
    # OpenCV obeys the tag of a TIFF whatever it is told, and of no other format where it is told not to.
    _set_upright(raw.data)
    image: NDArray[np.generic] | None = cv2.imdecode(raw, cv2.IMREAD_UNCHANGED)
    return image


def _set_upright(raw: memoryview) -> None:
    """Overwrite the orientation of a TIFF's first image, in place; anything else stays as it is."""
    order = {b"II": "<", b"MM": ">"}.get(bytes(raw[:2]), "")
    if not order or len(raw) < 16:
        return
    version = struct.unpack_from(order + "H", raw, 2)[0]
    if version not in {42, 43}:  # 43: BigTIFF, whose addresses have 8 bytes
        return
    address, count, entry, value = ("I", "H", 12, 8) if version == 42 else ("Q", "Q", 20, 12)
    place = struct.unpack_from(order + address, raw, 4 if version == 42 else 8)[0]
    first = place + struct.calcsize(count)
    if first > len(raw):
        return
    entries = struct.unpack_from(order + count, raw, place)[0]
    for at in range(first, min(first + entry * entries, len(raw) - entry + 1), entry):
        if struct.unpack_from(order + "HH", raw, at) == (ORIENTATION, SHORT):
            struct.pack_into(order + "H", raw, at + value, UPRIGHT)
