"""Images as a recording at a given rate: PNG, JPEG or TIFF files sorted by name, or one TIFF stack."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.image_file import count_images, read_pixels, read_stack
from evaluator.errors import InputError
from evaluator.recording.frame import Frame, Plane
from evaluator.recording.timing import TimingReport, summarise

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm")


def images_in(folder: Path) -> list[Path]:
    """Images of a folder, frame 2 before frame 10."""
    here = (path for path in folder.iterdir() if not path.name.startswith("."))  # macOS creates ._NAME beside NAME
    found = [path for path in here if path.suffix.lower() in SUFFIXES and path.is_file()]
    return sorted(found, key=lambda path: [int(part) if part.isdigit() else part for part in _parts(path.name)])


def _parts(name: str) -> list[str]:
    return re.split(r"(\d+)", name)


class ImageSequence:
    """Images of a folder or of a TIFF stack at a constant rate; the same interface as `Recording`."""

    def __init__(self, place: Path, rate_hz: Fraction) -> None:
        """place: a folder of images, or a TIFF. Raises InputError if there are none."""
        self.name = str(place)
        self._paths = images_in(place) if place.is_dir() else [place]
        if not self._paths:
            raise InputError(f"{place}: holds no images ({', '.join(SUFFIXES)})")
        self.nominal_rate: Fraction | None = rate_hz
        self.tick = 1 / rate_hz
        self._stacked = not place.is_dir()
        self.expected_frames = count_images(place) if self._stacked else len(self._paths)
        self.expected_s: float | None = None
        self.left_out_frames = 0  # as in `Recording`; all images are given
        self.threads = 0  # as in `Recording`; images are not decoded in threads
        self._duplicates: list[int] = []
        self._notes: list[str] = []
        self._done = 0

    def __repr__(self) -> str:
        """One line: the name, the number of images and the rate."""
        return f"ImageSequence({self.name}, {self.expected_frames} images, {float(1 / self.tick):g} frames/s)"

    def __iter__(self) -> Iterator[Frame]:
        """Read the images in order. Raises InputError for one that cannot be read or differs in size."""
        self._duplicates, self._notes, self._done = [], [], 0
        before: Plane | None = None
        for index, (path, image) in enumerate(self._images()):
            if image is None and index and self._stacked:
                self._notes.append(f"its image {index + 1} cannot be read; the file is damaged or truncated there")
                return
            if image is None:
                raise InputError(f"{path}: not a readable image")
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

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height) of the first image; (0, 0) if it cannot be read."""
        _, image = next(self._images())
        return (0, 0) if image is None else (image.shape[1], image.shape[0])

    def _images(self) -> Iterator[tuple[str, NDArray[np.generic] | None]]:
        """Every image with its name."""
        if self._stacked:
            yield from ((f"{self.name}: image {k}", image) for k, image in enumerate(read_stack(self._paths[0]), 1))
        else:
            yield from ((str(path), read_pixels(path)) for path in self._paths)

    def report(self) -> TimingReport:
        """Summary of the last iteration."""
        return summarise(range(self._done), self.tick, self._duplicates, self._notes)


def _planes(image: NDArray[np.generic], path: str) -> tuple[Plane, Plane | None, Plane | None, int]:
    """Luma and colour planes (BT.601, full range) of a grey, BGR or BGRA image of 8 or 16 bits."""
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: its samples are {image.dtype}, of unknown range; save it with 8 or 16 bits a sample")
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
