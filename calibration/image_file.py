"""Reading image files in sensor orientation: orientation tags are ignored.

A camera is calibrated in the pixels of its sensor. A phone that looks straight down writes any of the eight
orientations of EXIF (tag 274), and another for the next image. If applied, they would rotate the plate under a camera
that never moved.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

ORIENTATION, UPRIGHT = 274, 1  # TIFF 6.0, p. 36
TIFF, BIG = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), 43
SHORT = 3  # type of the tag's value: 16 bits


def read_pixels(path: Path) -> NDArray[np.generic] | None:
    """Decode an image file: (height, width), or (height, width, channels) BGR, of 8 bits, 16 bits or floats.

    None if the file is not an image, or damaged. The first image of a TIFF stack. Raises OSError if the file cannot be
    read.
    """
    raw = np.fromfile(path, dtype=np.uint8)
    if raw.size == 0 or _is_cut_png(raw.data):
        return None
    # OpenCV always applies the orientation tag of a TIFF; for other formats it can be disabled.
    _set_upright(raw.data)
    with _silent():
        image: NDArray[np.generic] | None = cv2.imdecode(raw, cv2.IMREAD_UNCHANGED)
    return image


def count_images(path: Path) -> int:
    """Number of images in a TIFF file; 1 for any other format. Raises OSError as `read_pixels`."""
    with path.open("rb") as file:
        if file.read(4) not in TIFF:
            return 1
    return max(len(_directories(np.memmap(path, np.uint8, "r").data)), 1)


def read_stack(path: Path) -> Iterator[NDArray[np.generic] | None]:
    """Decode the images of a TIFF stack one after the other, as `read_pixels`; None for one that is damaged."""
    raw = np.memmap(path, np.uint8, "c")  # written to in memory only
    _set_upright(raw.data)
    for k in range(count_images(path)):
        with _silent():
            _, images = cv2.imdecodemulti(raw, cv2.IMREAD_UNCHANGED, range=(k, k + 1))
        yield images[0] if len(images) == 1 else None


@contextmanager
def _silent() -> Iterator[None]:
    """Suppress messages of OpenCV on the terminal; the caller reports what is wrong with the file."""
    logging = cv2.utils.logging
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)


def _is_cut_png(raw: memoryview) -> bool:
    """Whether a PNG is truncated, on which its library would write to the terminal (PNG specification, 11.2.5)."""
    return bytes(raw[:8]) == b"\x89PNG\r\n\x1a\n" and bytes(raw).rfind(b"IEND") < 0


def _set_upright(raw: memoryview) -> None:
    """Set the orientation tag of every image of a TIFF to upright, in place; other files are not changed."""
    for order, entry, value, first, last in _directories(raw):
        for at in range(first, min(last, len(raw) - entry + 1), entry):
            if struct.unpack_from(order + "HH", raw, at) == (ORIENTATION, SHORT):
                struct.pack_into(order + "H", raw, at + value, UPRIGHT)


def _directories(raw: memoryview) -> list[tuple[str, int, int, int, int]]:
    """For every image of a TIFF: byte order, entry length, offset of the value in it, first entry, end of the last.

    A directory beyond the end of the file has no entries. Empty for a file that is not a TIFF.
    """
    if bytes(raw[:4]) not in TIFF or len(raw) < 16:
        return []
    order = "<" if raw[0] == ord("I") else ">"
    big = struct.unpack_from(order + "H", raw, 2)[0] == BIG  # whose addresses have 8 bytes
    address, count, entry, value = ("Q", "Q", 20, 12) if big else ("I", "H", 12, 8)
    place = struct.unpack_from(order + address, raw, 8 if big else 4)[0]
    found, known = list[tuple[str, int, int, int, int]](), set[int]()
    while place and place not in known:
        known.add(place)
        first = place + struct.calcsize(count)
        if first > len(raw):
            found.append((order, entry, value, first, first))
            break
        last = first + entry * struct.unpack_from(order + count, raw, place)[0]
        found.append((order, entry, value, first, last))
        if last + struct.calcsize(address) > len(raw):
            break
        place = struct.unpack_from(order + address, raw, last)[0]
    return found
