"""A folder of images as a recording: PNG, JPEG, TIFF in the order of their names, at a rate the user knows."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.image_file import read_pixels
from evaluator.errors import InputError
from evaluator.recording.frame import Frame, Plane
from evaluator.recording.timing import TimingReport, summarise

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm")


def images_in(folder: Path) -> list[Path]:
    """Images of a folder, frame 2 before frame 10."""
    found = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file()]
    return sorted(found, key=lambda path: [int(part) if part.isdigit() else part for part in _parts(path.name)])


def _parts(name: str) -> list[str]:
    return re.split(r"(\d+)", name)


class ImageSequence:
    """Images of a folder at a constant rate; the same interface as `Recording`."""

    def __init__(self, folder: Path, rate_hz: Fraction) -> None:
        """folder: holds the images. Raises InputError where it holds none."""
        self.name = str(folder)
        self._paths = images_in(folder)
        if not self._paths:
            raise InputError(f"{folder}: holds no images ({', '.join(SUFFIXES)})")
        self.nominal_rate: Fraction | None = rate_hz
        self.tick = 1 / rate_hz
        self.expected_frames = len(self._paths)
        self.expected_s: float | None = None
        self.threads = 0  # as of `Recording`; nothing here decodes in threads
        self._duplicates: list[int] = []
        self._done = 0

    def __iter__(self) -> Iterator[Frame]:
        """Read the images one after the other. Raises InputError for one that cannot be read or differs in size."""
        self._duplicates, self._done = [], 0
        before: Plane | None = None
        for index, path in enumerate(self._paths):
            image = read_pixels(path)
            if image is None:
                raise InputError(f"{path}: not an image that can be read")
            luma, u, v, depth = _planes(image, path)
            if before is not None and luma.shape != before.shape:
                height, width = before.shape
                raise InputError(
                    f"{path}: is {luma.shape[1]}×{luma.shape[0]} but the images before are {width}×{height}"
                )
            repeated = before is not None and bool(np.array_equal(luma, before))
            if repeated:
                self._duplicates.append(index)
            before = luma
            self._done += 1
            yield Frame(index, index, self.tick, luma, u, v, depth, True, "bt601", 0, 1, "", repeated, None)

    def report(self) -> TimingReport:
        """Sum up what was read in the last iteration."""
        return summarise(range(self._done), self.tick, self._duplicates, [])


def _planes(image: NDArray[np.generic], path: Path) -> tuple[Plane, Plane | None, Plane | None, int]:
    """Luma and colour planes (BT.601, full range) of a grey, BGR or BGRA image of 8 or 16 bits."""
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"{path}: its samples are {image.dtype}, whose range is not known; save it with 8 or 16 bits a sample"
        )
    depth = 8 if image.dtype == np.uint8 else 16
    kind = np.uint8 if depth == 8 else np.uint16
    if image.ndim == 2:
        return image.astype(kind), None, None, depth
    blue, green, red = (image[..., k].astype(np.float32) for k in range(3))
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    middle, top = 2.0 ** (depth - 1), 2.0**depth - 1
    u, v = middle + (blue - luma) / 1.772, middle + (red - luma) / 1.402
    planes = [np.clip(np.rint(plane), 0, top).astype(kind) for plane in (luma, u, v)]
    return planes[0], planes[1], planes[2], depth
