"""Clips that share no code with the product's renderer: marks of any shape drawn by sub-pixels.

What other laboratories record: stickers instead of discs, a ball that comes and goes, coloured things that lie about,
low bitrates with the residue that they leave, slanted cameras. Truth is exact: where the middle of the mark was drawn,
NaN where none of it is in view. Beside it the method that anybody writes first: threshold and centroid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.tracking import TrackingSettings

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Inside = Callable[[Array, Array], NDArray[np.bool_]]

SIZE = (320, 240)
FINE = 6  # sub-pixels a pixel, either way: a centre is then drawn to about 0.01 px
# Drawn once: new noise for every frame took more than half of the time in which clips are drawn.
NOISE = np.random.default_rng(27).standard_normal(1 << 21, dtype=np.float32)
GREEN, YELLOW, RED = (40, 200, 70), (225, 215, 40), (205, 40, 45)
RATE = Fraction(30)


@dataclass(frozen=True)
class Encoding:
    """How a clip is encoded; options as of FFmpeg."""

    codec: str = "libx264"
    pixels: str = "yuv420p"
    options: dict[str, str] = field(default_factory=lambda: {"crf": "18"})
    suffix: str = ".mp4"


GOOD = Encoding()
LOW = Encoding(options={"qp": "38", "preset": "veryfast"})
POOR = Encoding(options={"qp": "44", "preset": "ultrafast", "g": "250"})
OLD = Encoding("mpeg4", "yuv420p", {"qmin": "24", "qmax": "31", "b": "60k"}, ".avi")


@dataclass(frozen=True)
class Clip:
    """Frames with exact truth.

    frames: RGB. truth: by mark (n, 2) px, NaN while out of view. half_px: half the mark's shorter side: an error beyond
    it is no measurement of this mark. hues_deg: of the marks, for the threshold.
    """

    frames: list[Image]
    truth: dict[str, Array]
    half_px: float
    encoding: Encoding = GOOD
    settings: TrackingSettings | None = None
    hues_deg: dict[str, tuple[float, float]] = field(
        default_factory=lambda: {"green": (90.0, 165.0), "yellow": (42.0, 72.0)}
    )

    def write(self, folder: Path) -> Path:
        """Encode into a folder; gives the file."""
        path = folder / f"clip{self.encoding.suffix}"
        with av.open(str(path), "w") as container:
            stream = container.add_stream(self.encoding.codec, rate=RATE, options=self.encoding.options)
            stream.height, stream.width = self.frames[0].shape[:2]
            stream.pix_fmt = self.encoding.pixels
            for index, image in enumerate(self.frames):
                frame = av.VideoFrame.from_ndarray(image, format="rgb24")
                frame.pts = index
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        return path


@dataclass(frozen=True)
class Shape:
    """What is inside a mark, about its middle, and how far its farthest point is from there, px."""

    inside: Inside
    reach: float


def box(length: float, width: float) -> Shape:
    """A sticker."""
    return Shape(lambda x, y: (np.abs(x) < length / 2) & (np.abs(y) < width / 2), float(np.hypot(length, width)) / 2)


def ellipse(length: float, width: float) -> Shape:
    """An ellipse."""
    return Shape(lambda x, y: (2 * x / length) ** 2 + (2 * y / width) ** 2 < 1.0, max(length, width) / 2)


def paint(
    canvas: Array,
    shape: Shape,
    center: tuple[float, float],
    angle: float,
    color: tuple[int, int, int],
    blur: float = 0.7,
    path: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Paint a shape onto a canvas (rows, columns, 3), in place; path: px that it moves while the shutter is open."""
    rows, columns = canvas.shape[:2]
    far = shape.reach + np.hypot(*path) / 2 + 4 * blur + 1
    left, right = max(int(center[0] - far), 0), min(int(center[0] + far) + 1, columns)
    top, bottom = max(int(center[1] - far), 0), min(int(center[1] + far) + 1, rows)
    if left >= right or top >= bottom:
        return
    x = left + (np.arange((right - left) * FINE, dtype=np.float32)[None, :] + 0.5) / FINE - 0.5 - center[0]
    y = top + (np.arange((bottom - top) * FINE, dtype=np.float32)[:, None] + 0.5) / FINE - 0.5 - center[1]
    cos, sin = np.cos(angle), np.sin(angle)
    steps = np.linspace(-0.5, 0.5, 9) if np.hypot(*path) > 0.5 else np.zeros(1)
    share = np.zeros((len(y), x.shape[1]), np.float32)
    for step in steps:
        dx, dy = x - step * path[0], y - step * path[1]
        share += shape.inside(cos * dx + sin * dy, -sin * dx + cos * dy)
    share = cv2.GaussianBlur(share / len(steps), (0, 0), blur * FINE, borderType=cv2.BORDER_REPLICATE)
    share = cv2.resize(share, (right - left, bottom - top), interpolation=cv2.INTER_AREA)[..., None]  # means of FINE²
    part = canvas[top:bottom, left:right]
    part[:] = part * (1 - share) + share * np.array(color, float)


def texture(rng: np.random.Generator, size: tuple[int, int] = SIZE, strength: float = 12.0) -> Array:
    """Return a floor: neutral, with coarse and fine grain; (rows, columns, 3)."""
    grain = np.zeros((size[1], size[0]))
    for scale in (1.0, 4.0, 16.0):
        layer = cv2.GaussianBlur(rng.normal(size=(size[1], size[0])), (0, 0), scale)
        grain += layer / layer.std()
    return 105.0 + strength / 3**0.5 * grain[..., None] * np.array([1.0, 1.0, 0.97])


def colorful(rng: np.random.Generator) -> Array:
    """Return a floor of brown wood on which things of all colours lie; (rows, columns, 3)."""
    layers = [cv2.GaussianBlur(rng.normal(size=(SIZE[1], SIZE[0])), (0, 0), 8.0) for _ in range(3)]
    things = np.stack([layer / layer.std() for layer in layers], axis=-1)
    return np.clip(texture(rng) - 105.0 + np.array([150.0, 95.0, 55.0]) + 35.0 * things, 0.0, 255.0)


def finished(rng: np.random.Generator, canvas: Array, noise: float = 2.0) -> Image:
    """Add sensor noise and round: a part of NOISE from a random place on, which is white from frame to frame."""
    begin = int(rng.integers(len(NOISE) - canvas.size))
    light = noise * NOISE[begin : begin + canvas.size].reshape(canvas.shape) + canvas
    return np.clip(np.rint(light, out=light), 0, 255, out=light).astype(np.uint8)


def loop(frames: int, center: tuple[float, float], radius: tuple[float, float], step: float) -> tuple[Array, Array]:
    """Return a path around an ellipse, (n, 2) px, and the direction of motion, (n,) rad."""
    turn = 0.4 + step * np.arange(frames)
    path = np.stack([center[0] + radius[0] * np.cos(turn), center[1] + radius[1] * np.sin(turn)], axis=-1)
    return path, np.arctan2(radius[1] * np.cos(turn), -radius[0] * np.sin(turn))


def pair(
    rng: np.random.Generator, shape: Shape, half_px: float, apart_px: float, encoding: Encoding = GOOD,
    *, frames: int = 90, step: float = 0.05, light: float = 0.0, noise: float = 2.0, strength: float = 12.0,
    floor: Array | None = None, center: tuple[float, float] = (SIZE[0] / 2, SIZE[1] / 2),
) -> Clip:  # fmt: skip
    """Two marks of one shape on a black body that drives around; light: share by which the lamp swings."""
    floor = texture(rng, strength=strength) if floor is None else floor
    path, heading = loop(frames, center, (70.0, 55.0), step)
    across = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    truth = {"green": path - apart_px / 2 * across, "yellow": path + apart_px / 2 * across}
    images = []
    for k in range(frames):
        canvas = floor.copy()
        paint(
            canvas,
            box(apart_px + 4 * half_px + 8, 5 * half_px + 8),
            tuple(path[k]),
            heading[k] + np.pi / 2,
            (28, 28, 30),
        )
        for name, color in (("green", GREEN), ("yellow", YELLOW)):
            paint(canvas, shape, tuple(truth[name][k]), heading[k], color)
        canvas *= 1.0 + light * np.sin(0.2 * k)
        images.append(finished(rng, canvas, noise))
    return Clip(images, truth, half_px, encoding)


def sticker(
    rng: np.random.Generator, encoding: Encoding = GOOD, *, length: float = 30.0, width: float = 10.0,
    color: tuple[int, int, int] = YELLOW, name: str = "yellow", frames: int = 90, strength: float = 12.0,
    beside: tuple[tuple[int, int], ...] = (),
) -> Clip:  # fmt: skip
    """One oblong sticker on a car that drives around a textured floor; beside: places of things at rest of its hue."""
    floor = texture(rng, strength=strength)
    for place in beside:
        paint(floor, box(16, 12), place, 0.4, (200, 195, 70))
    path, heading = loop(frames, (SIZE[0] / 2, SIZE[1] / 2), (85.0, 60.0), 0.055)
    images = []
    for k in range(frames):
        canvas = floor.copy()
        paint(canvas, box(1.6 * length, 2.6 * width), tuple(path[k]), heading[k], (60, 60, 66))
        paint(canvas, box(length, width), tuple(path[k]), heading[k], color)
        images.append(finished(rng, canvas))
    settings = TrackingSettings.model_validate({"mark": {name: {}}})
    return Clip(images, {name: path}, width / 2, encoding, settings)


def slanted_car(rng: np.random.Generator, *, frames: int = 53) -> Clip:
    """A red roof seen from aside: it shrinks with distance, turns, is foreshortened; the settings say its colour."""
    floor = texture(rng)
    turn = 0.3 + 2 * np.pi * np.arange(frames) / frames
    depth = 1.0 / (1.6 - 0.6 * np.sin(turn))  # nearer at the bottom
    path = np.stack([SIZE[0] / 2 + 120 * depth * np.cos(turn), 40 + 150 * depth], axis=-1)
    images = []
    for k in range(frames):
        canvas, scale, heading = floor.copy(), 34.0 * depth[k], turn[k] + np.pi / 2
        cos, sin = np.cos(heading), np.sin(heading)

        def roof(x: Array, y: Array, scale: float = scale, cos: float = cos, sin: float = sin) -> NDArray[np.bool_]:
            flat_y = y / 0.5
            return (np.abs(cos * x + sin * flat_y) < scale / 2) & (np.abs(-sin * x + cos * flat_y) < scale / 4)

        paint(canvas, ellipse(2.4 * scale, 1.3 * scale), (path[k, 0], path[k, 1] + 3), 0.0, (45, 45, 48))
        paint(canvas, Shape(roof, 40.0), tuple(path[k]), 0.0, RED)
        images.append(finished(rng, canvas))
    settings = TrackingSettings.model_validate({"mark": {"roof": {"color": "#cd282d"}}})
    return Clip(images, {"roof": path}, 3.0, Encoding(options={"crf": "26"}), settings, {"roof": (340.0, 20.0)})


def ball(rng: np.random.Generator, encoding: Encoding = GOOD) -> Clip:
    """A pale green ball, in view in 12 of 60 frames, blurred by its motion; yellow things rest in view throughout."""
    floor = texture(rng, (480, 360), 8.0)
    for x, y, side in ((60, 60, 12), (100, 300, 20), (430, 90, 9)):
        paint(floor, ellipse(side, 0.8 * side), (x, y), 0.3, (205, 185, 60))
    path = np.full((60, 2), np.nan)
    lapse = np.arange(12.0)
    path[21:33] = np.stack([30 + 36 * lapse, 300 - 60 * lapse + 5 * lapse**2], axis=-1)
    images = []
    for k in range(60):
        canvas = floor.copy()
        if np.isfinite(path[k, 0]):
            paint(canvas, ellipse(40, 40), tuple(path[k]), 0.0, (150, 205, 130), 1.0, (18.0, -30.0 + 5 * (k - 21)))
        images.append(finished(rng, canvas, 3.0))
    return Clip(images, {"green": path, "yellow": np.full((60, 2), np.nan)}, 20.0, encoding)


def residue(rng: np.random.Generator) -> Clip:
    """Two discs whose codec skips: for some frames one stays, paler, where it was, and is not drawn where it is."""
    clip = pair(rng, ellipse(12, 12), 6.0, 44.0, LOW)
    frames, truth = list(clip.frames), {name: points.copy() for name, points in clip.truth.items()}
    for first, name, fade in ((22, "green", 0.0), (40, "yellow", 0.35), (60, "green", 0.5), (75, "yellow", 0.0)):
        x, y = truth[name][first]
        old = frames[first][_block(x, y)].astype(float)
        for k in range(first + 1, first + 7):
            image = frames[k].copy()
            now = _block(*truth[name][k])
            image[now] = 35  # the block of the body: what the mark lies on
            grey = old.mean(axis=-1, keepdims=True)
            image[_block(x, y)] = np.rint((1 - fade) * old + fade * grey).astype(np.uint8)
            frames[k] = image
            truth[name][k] = np.nan
    return Clip(frames, truth, clip.half_px, LOW)


def _block(x: float, y: float, half: int = 10) -> tuple[slice, slice]:
    return slice(int(y) - half, int(y) + half + 1), slice(int(x) - half, int(x) + half + 1)


KINDS: dict[str, Callable[[np.random.Generator], Clip]] = {
    "discs": lambda rng: pair(rng, ellipse(14, 14), 7.0, 51.0),
    "discs, varying light": lambda rng: pair(rng, ellipse(14, 14), 7.0, 51.0, light=0.3),
    "discs, slanted 60 deg": lambda rng: pair(rng, ellipse(18, 9), 4.5, 51.0),
    "discs, colourful floor": lambda rng: pair(rng, ellipse(14, 14), 7.0, 51.0, frames=40, floor=colorful(rng)),
    "squares": lambda rng: pair(rng, box(13, 13), 6.5, 48.0),
    "oblong stickers, two": lambda rng: pair(rng, box(20, 9), 4.5, 48.0),
    "oblong sticker 3:1": sticker,
    "oblong sticker 4:1": lambda rng: sticker(rng, length=36.0, width=9.0),
    "oblong sticker, large": lambda rng: sticker(rng, length=60.0, width=22.0),
    "oblong, rough floor": lambda rng: sticker(rng, strength=30.0),
    "oblong, things at rest": lambda rng: sticker(rng, beside=((40, 40), (280, 200))),
    "oblong, low bitrate": lambda rng: sticker(rng, LOW),
    "green oblong, MPEG-4": lambda rng: sticker(rng, OLD, color=GREEN, name="green"),
    "discs, low bitrate": lambda rng: pair(rng, ellipse(12, 12), 6.0, 44.0, LOW),
    "discs, poor bitrate": lambda rng: pair(rng, ellipse(12, 12), 6.0, 44.0, POOR),
    "discs, MPEG-4 60k": lambda rng: pair(rng, ellipse(12, 12), 6.0, 44.0, OLD, noise=4.0),
    "residue": residue,
    "ball, yellow at rest": ball,
    "ball, low bitrate": lambda rng: ball(rng, LOW),
    "red roof, slanted": slanted_car,
}
