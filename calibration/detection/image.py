"""Preparation of images for the detector: one plane, float32, dark dots.

A colour image is projected on the colour axis that separates dots and background best, so that coloured dots need no
further code: the axis given by the gauge file, or else the principal axis of the image's fine detail.
"""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.image_file import read_pixels

Plane = NDArray[np.float32]
SMALLEST_PX = 12  # along either side: four dots of three pixels
HEIF = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"mif1", b"msf1")  # brands of ISO/IEC 23008-12 files
# The names gauge.toml may use beside "#rrggbb"; sRGB, as browsers define them.
COLORS = {
    "black": "#000000", "white": "#ffffff", "gray": "#808080", "grey": "#808080", "red": "#ff0000",
    "green": "#008000", "lime": "#00ff00", "blue": "#0000ff", "yellow": "#ffff00", "cyan": "#00ffff",
    "magenta": "#ff00ff", "orange": "#ffa500", "pink": "#ffc0cb", "purple": "#800080", "brown": "#a52a2a",
}  # fmt: skip


def read_image(path: Path) -> NDArray[np.generic]:
    """Read an image file as the sensor saw it: (height, width) or (height, width, 3) BGR, 8 or 16 bit.

    Raises CalibrationError for a file that is missing or not an image.
    """
    path = Path(path)
    if not path.is_file():
        fault = "is not a file; give every image by its name" if path.exists() else "no such file"
        raise CalibrationError(f"{path}: {fault}")
    image = read_pixels(path)
    if image is None:
        with path.open("rb") as file:
            raise CalibrationError(f"{path}: {_why_unreadable(file.read(16))}")
    if min(image.shape[:2]) < SMALLEST_PX:
        raise CalibrationError(f"{path}: {image.shape[1]}×{image.shape[0]} pixels, too small to hold a dot array")
    if not np.isfinite(image).all():
        raise CalibrationError(f"{path}: contains NaN or infinite values; replace them first")
    if image.ndim == 3 and image.shape[2] == 2:
        image = image[:, :, 0]
    elif image.ndim == 3 and image.shape[2] == 4:
        image = image[:, :, :3]
    return np.ascontiguousarray(image)


def _why_unreadable(start: bytes) -> str:
    """Message for a file that is not a readable image, from its first 16 bytes, with what to do."""
    if start[4:8] == b"ftyp" and start[8:12] in HEIF:
        return "HEIC photographs cannot be read; save it as JPEG or PNG, or set the phone to JPEG"
    if start[:3] == b"\xff\xd8\xff" or start[:8] == b"\x89PNG\r\n\x1a\n":
        return "an image that is damaged or cut off; copy it again"
    return "not a readable image; use PNG, TIFF or JPEG"


def color_bgr(name: str) -> NDArray[np.float64]:
    """Colour of a name or "#rrggbb" as (3,) BGR from 0 to 1. Raises CalibrationError for an unknown name."""
    code = COLORS.get(name.strip().lower(), name.strip())
    if re.fullmatch("#[0-9a-fA-F]{6}", code) is None:
        raise CalibrationError(f'color = "{name}" is not known; say "#rrggbb" or one of {", ".join(COLORS)}')
    return np.array([int(code[i : i + 2], 16) for i in (5, 3, 1)]) / 255


def dark_dots(image: NDArray[np.generic], color: str | None = None, background: str | None = None) -> Plane:
    """Turn an image into one plane in which dots are darker than their background.

    image: (h, w) or (h, w, 3) BGR of any number type. color, background: as in gauge.toml; without them the plane
    is the principal axis of the fine detail, brighter toward white, and dots may turn out bright. Raises
    CalibrationError if both colours are equal.
    """
    array = np.asarray(image)
    if array.ndim == 2 or array.shape[2] == 1:
        plane = array.reshape(array.shape[:2]).astype(np.float32)
        bright = color is not None and background is not None and color_bgr(color).sum() > color_bgr(background).sum()
        return -plane if bright else plane
    if color is not None and background is not None:
        axis = color_bgr(background) - color_bgr(color)
        if np.abs(axis).max() == 0:
            raise CalibrationError(f'dots of color "{color}" on a background of the same color cannot be seen')
    else:
        axis = _detail_axis(array)
    axis = axis / np.abs(axis).sum()
    return np.asarray(cv2.transform(array.astype(np.float32), axis[None].astype(np.float32)), dtype=np.float32)


def _detail_axis(image: NDArray[np.generic]) -> NDArray[np.float64]:
    """Unit BGR axis along which neighbouring pixels differ most."""
    step = max(1, min(image.shape[:2]) // 500)  # an axis needs no more samples than that
    small = image[::step, ::step].astype(np.float32)
    detail = (small - cv2.blur(small, (31, 31))).reshape(-1, 3).astype(float)
    axis = np.linalg.eigh(detail.T @ detail)[1][:, -1]
    return np.asarray(axis if axis.sum() >= 0 else -axis)
