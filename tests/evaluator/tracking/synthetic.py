"""Synthetic clips with exact truth: blurred fluorescent discs on a black top on a grey plate, supersampled."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame

Array = NDArray[np.float64]
GREEN, YELLOW, BLACK, PLATE = (60, 225, 80), (235, 230, 50), (25, 25, 27), (130, 128, 125)


LUMA = np.array([0.299, 0.587, 0.114])


def frame_of(luma: np.ndarray, *, depth: int = 8, origin: int = 0, step: int = 1) -> Frame:
    """A grey frame, or a field of one."""
    return Frame(
        0, 0, Fraction(1, 60), luma, None, None, depth, full_range=True, matrix="bt601", row_origin=origin,
        row_step=step, kind="", repeated=False, owner=None,
    )  # fmt: skip


def frames_in_memory(images: list[Array]) -> Iterator[Frame]:
    """Luma and full-resolution colour planes without any codec."""
    for index, image in enumerate(images):
        luma = image @ LUMA
        u, v = 128 + (image[..., 2] - luma) / 1.772, 128 + (image[..., 0] - luma) / 1.402
        planes = [np.clip(np.rint(plane), 0, 255).astype(np.uint8) for plane in (luma, u, v)]
        yield Frame(
            index, index, Fraction(1, 60), *planes, 8, full_range=True, matrix="bt601", row_origin=0, row_step=1,
            kind="", repeated=False, owner=None,
        )  # fmt: skip


def coverage(size: tuple[int, int], center: tuple[float, float], radius: float, blur: float, fine: int = 8) -> Array:
    """Share of each pixel that a blurred disc covers; (height, width)."""
    whole = np.zeros((size[1], size[0]))
    part, share = _covered(size, center, radius, blur, fine)
    whole[part] = share
    return whole


def _covered(
    size: tuple[int, int], center: tuple[float, float], radius: float, blur: float, fine: int = 8
) -> tuple[tuple[slice, slice], Array]:
    """The part of an image, rows and columns, that a blurred disc covers, and its share of each pixel there."""
    width, height = size
    reach = int(np.ceil(radius + 6 * blur + 2))
    left, top = int(center[0]) - reach, int(center[1]) - reach
    side = 2 * reach + 1
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + side, width), min(top + side, height)
    if x0 >= x1 or y0 >= y1:
        return (slice(0), slice(0)), np.zeros((0, 0))
    k = (np.arange(side * fine, dtype=np.float32) + 0.5) / fine - 0.5
    x, y = k + np.float32(left - center[0]), k + np.float32(top - center[1])
    inside = np.clip((radius - np.sqrt(x[None, :] ** 2 + y[:, None] ** 2)) * fine + 0.5, 0, 1)
    soft = cv2.GaussianBlur(inside, (0, 0), blur * fine)
    small = cv2.resize(soft, (side, side), interpolation=cv2.INTER_AREA).astype(float)  # means of fine² samples
    return (slice(y0, y1), slice(x0, x1)), small[y0 - top : y1 - top, x0 - left : x1 - left]


def turning_marks(frames: int, center: tuple[float, float], turn: float, scale: float, step: float) -> dict[str, Array]:
    """Truth of a robot on a circle: px of both marks, (frames, 2). scale px/mm; step: heading per frame, rad."""
    heading = step * np.arange(frames) + 0.3
    x = center[0] + turn * np.sin(heading)
    y = center[1] + turn * np.cos(heading)
    marks = {}
    for name, (bx, by) in {"green": (-1.55, 1.83), "yellow": (-1.55, -1.83)}.items():
        cos, sin = np.cos(heading), np.sin(heading)
        marks[name] = np.stack([x + scale * (cos * bx - sin * by), y - scale * (sin * bx + cos * by)], axis=-1)
    return marks


def draw(
    rng: np.random.Generator,
    size: tuple[int, int],
    marks: dict[str, tuple[float, float]],
    radius: float,
    blur: float,
    noise: float,
) -> NDArray[np.uint8]:
    """One RGB frame."""
    image = np.empty((size[1], size[0], 3))
    image[:] = PLATE
    if marks:
        middle = np.mean(list(marks.values()), axis=0)
        y, x = np.ogrid[: size[1], : size[0]]
        image[(x - middle[0]) ** 2 + (y - middle[1]) ** 2 < (10 * radius) ** 2] = BLACK
    for name, center in marks.items():
        part, share = _covered(size, center, radius, blur)
        image[part] += share[..., None] * (np.array(GREEN if name.startswith("green") else YELLOW) - image[part])
    image += rng.normal(0, noise, image.shape)
    return np.clip(np.rint(image, out=image), 0, 255, out=image).astype(np.uint8)


def noise_images(count: int, size: tuple[int, int] = (64, 48)) -> list[NDArray[np.uint8]]:
    """Frames in which nothing repeats."""
    rng = np.random.default_rng(1)
    return [rng.integers(0, 255, (size[1], size[0], 3)).astype(np.uint8) for _ in range(count)]


def write_video(
    path: Path,
    images: list[NDArray[np.uint8]],
    *,
    codec: str = "ffv1",
    pixels: str = "bgr0",
    rate: Fraction = Fraction(60),
    pts: list[int] | None = None,
    options: dict[str, str] | None = None,
) -> Path:
    """Encode RGB (or grey) frames; pts in units of 1/rate."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate, options=options or {})
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = pixels
        stream.codec_context.time_base = 1 / rate
        for index, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24" if image.ndim == 3 else "gray")
            frame.pts = pts[index] if pts else index
            frame.time_base = 1 / rate
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path
