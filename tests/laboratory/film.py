"""Filmed laboratory: what a fixed camera above the plate records of a robot, drawn without any code of turnscope.

Everything is drawn as polygons, four times as fine as a pixel, in linear light; then lens blur, illumination, a Bayer
sensor with noise, demosaicing, gamma and H.264. The camera is a pinhole with radial distortion (Brown), tilted a
little. The gauge is drawn by the same camera. Units: mm, rad, px; the plate frame has z up, image rows run down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from tests.laboratory.reference import Array

FINE = 4  # fine pixels per pixel and axis
BITS = 5  # of a fraction of a fine pixel, in OpenCV's drawing
MARGIN_PX = 6
TOP_MM = 6.5  # height of the robot's top, on which the marks lie
POOL = 8  # frames of noise, shifted at random
STRAYS = 12  # scratches and specks of dust on the plate


@dataclass(frozen=True)
class Camera:
    """A pinhole above the plate. rotation: camera from plate (rows: right, down, ahead)."""

    size_px: tuple[int, int]
    focal_px: float
    middle_px: tuple[float, float]
    rotation: Array
    place_mm: Array
    k1: float
    k2: float

    def image_of(self, points_mm: Array) -> Array:
        """Pixels (n, 2) of points (n, 3) of the plate frame; pixel centres are whole numbers."""
        seen = (np.atleast_2d(points_mm) - self.place_mm) @ self.rotation.T
        x, y = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
        square = x * x + y * y
        stretched = self.focal_px * (1 + self.k1 * square + self.k2 * square**2)
        return np.stack([self.middle_px[0] + stretched * x, self.middle_px[1] + stretched * y], axis=1)


def camera_above(rng: np.random.Generator, field_mm: float, size_px: tuple[int, int]) -> Camera:
    """A camera 120 to 300 mm above the plate that sees field_mm of it along its rows, tilted by up to 5 degrees."""
    distance, tilt, way = rng.uniform(120, 300), np.radians(rng.uniform(0, 5)), rng.uniform(0, 2 * np.pi)
    ahead = np.array([np.sin(tilt) * np.cos(way), np.sin(tilt) * np.sin(way), -np.cos(tilt)])
    turn = np.radians(rng.uniform(-8, 8))
    right = np.array([np.cos(turn), np.sin(turn), 0.0])
    right -= ahead * (right @ ahead)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    middle = (np.array(size_px) - 1) / 2 + rng.uniform(-8, 8, 2)
    k1 = rng.uniform(-0.25, 0.08)
    focal = size_px[0] / field_mm * (distance - TOP_MM)
    return Camera(size_px, focal, (middle[0], middle[1]), rotation, -distance * ahead, k1, 0.3 * k1**2)


@dataclass(frozen=True)
class Look:
    """Light, lens and sensor of a session, colours as linear light (blue, green, red) of 0 to 1."""

    blur_px: float
    slope: tuple[float, float]  # of the light from edge to edge of the image
    shading: float  # of the light at the corners
    noise: tuple[float, float]  # standard deviation at black and at white
    mosaic: bool
    plate: tuple[float, float, float]
    green: tuple[float, float, float]
    yellow: tuple[float, float, float]
    top: tuple[float, float, float]
    crf: int


def random_look(rng: np.random.Generator) -> Look:
    """Ordinary light on a grey plate, an ordinary industrial camera."""
    grey = rng.uniform(0.25, 0.55)
    return Look(
        blur_px=rng.uniform(0.5, 1.1),
        slope=(rng.uniform(-0.15, 0.15), rng.uniform(-0.15, 0.15)),
        shading=rng.uniform(0, 0.25),
        noise=(rng.uniform(0.002, 0.006), rng.uniform(0.008, 0.02)),
        mosaic=bool(rng.random() < 0.5),
        plate=(grey, grey * rng.uniform(0.95, 1.05), grey * rng.uniform(0.95, 1.05)),
        green=(rng.uniform(0.05, 0.12), rng.uniform(0.4, 0.6), rng.uniform(0.04, 0.12)),
        yellow=(rng.uniform(0.03, 0.1), rng.uniform(0.55, 0.75), rng.uniform(0.65, 0.85)),
        top=(rng.uniform(0.01, 0.04),) * 3,
        crf=int(rng.integers(14, 21)),
    )


@dataclass(frozen=True)
class Shape:
    """A polygon (n, 3) mm in one colour."""

    rim_mm: Array
    colour: tuple[float, float, float]


@dataclass
class Studio:
    """Camera and light of a session, its empty plate and its noise."""

    camera: Camera
    look: Look
    rng: np.random.Generator
    empty: Array = field(init=False)
    light: Array = field(init=False)
    _pool: Array = field(init=False)

    def __post_init__(self) -> None:
        """Light the plate."""
        width, height = self.camera.size_px
        x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
        light = 1 + self.look.slope[0] * x / 2 + self.look.slope[1] * y / 2 - self.look.shading * (x * x + y * y) / 2
        self.light = light.astype(np.float32)[..., None]
        scene = np.empty((height, width, 3), np.float32)
        scene[:] = self.look.plate
        uneven = self.rng.normal(0, 0.02, (9, 12)).astype(np.float32)
        cloud = cv2.resize(uneven, (width, height), interpolation=cv2.INTER_CUBIC)
        scene *= (1 + cloud)[..., None]
        for _ in range(STRAYS):
            at = self.rng.uniform((0, 0), (width, height))
            end = at + self.rng.normal(0, 15, 2)
            tone = float(self.rng.uniform(0.6, 1.3) * self.look.plate[0])
            cv2.line(scene, *(tuple(map(int, p)) for p in (at, end)), (tone,) * 3, 1, cv2.LINE_AA)
        self.empty = cv2.GaussianBlur(scene, (0, 0), self.look.blur_px)
        self._pool = self.rng.normal(0, 1, (POOL, height, width, 1 if self.look.mosaic else 3)).astype(np.float32)

    def image(self, shapes: Sequence[Shape]) -> Array:
        """One frame (rows, columns, 3), blue, green, red of 8 bits, of shapes on the plate, the last on top."""
        scene = self.empty.copy()
        _draw(scene, self.camera, shapes, self.look.blur_px)
        return self._developed(scene * self.light)

    def _developed(self, scene: Array) -> Array:
        noise = self._pool[self.rng.integers(POOL)]
        noise = np.roll(noise, self.rng.integers(noise.shape[0]), axis=0)
        black, white = self.look.noise
        if self.look.mosaic:
            raw = np.empty(scene.shape[:2], np.float32)  # rows of blue, green; green, red
            raw[::2, ::2], raw[::2, 1::2] = scene[::2, ::2, 0], scene[::2, 1::2, 1]
            raw[1::2, ::2], raw[1::2, 1::2] = scene[1::2, ::2, 1], scene[1::2, 1::2, 2]
            raw += noise[..., 0] * np.sqrt(black**2 + white**2 * np.maximum(raw, 0))
            whole = cv2.demosaicing((np.clip(raw, 0, 1) * 65535).astype(np.uint16), cv2.COLOR_BayerRG2BGR)
            return GAMMA[whole >> 4]
        seen = scene + noise * np.sqrt(black**2 + white**2 * np.maximum(scene, 0))
        return GAMMA[(np.clip(seen, 0, 1) * 4095).astype(np.uint16)]


GAMMA = np.rint(255 * np.linspace(0, 1, 4096) ** (1 / 2.2)).astype(np.uint8)


def _draw(scene: Array, camera: Camera, shapes: Sequence[Shape], blur_px: float) -> None:
    """Draw shapes into a scene that is blurred already, in the part of it that they cover."""
    rims = [camera.image_of(shape.rim_mm) for shape in shapes]
    points = np.concatenate(rims)
    height, width = scene.shape[:2]
    margin = MARGIN_PX + int(4 * blur_px)
    left, top = np.maximum(np.floor(points.min(axis=0)).astype(int) - margin, 0)
    right, bottom = np.minimum(np.ceil(points.max(axis=0)).astype(int) + margin + 1, (width, height))
    if right <= left or bottom <= top:
        return
    part = scene[top:bottom, left:right]
    fine = cv2.resize(part, None, fx=FINE, fy=FINE, interpolation=cv2.INTER_LINEAR)
    levels = np.clip(fine * 255, 0, 255).astype(np.uint8)
    drawn = np.zeros(levels.shape[:2], np.uint8)
    for rim, shape in zip(rims, shapes, strict=True):
        place = (rim - (left, top) + 0.5) * FINE - 0.5  # centre of the fine pixel 0 lies at -3/8 px
        corners = np.rint(place * 2**BITS).astype(np.int32)
        cv2.fillPoly(levels, [corners], tuple(255 * c for c in shape.colour), cv2.LINE_AA, BITS)
        cv2.fillPoly(drawn, [corners], 255, cv2.LINE_AA, BITS)
    size = (right - left, bottom - top)
    coarse = cv2.resize(levels.astype(np.float32) / 255, size, interpolation=cv2.INTER_AREA)
    covered = cv2.resize(drawn.astype(np.float32) / 255, size, interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(coarse, (0, 0), blur_px)
    near = cv2.GaussianBlur(cv2.dilate(covered, np.ones((5, 5))), (0, 0), 2 * blur_px)[..., None]
    near = np.clip(near * 2, 0, 1)
    part[:] = near * soft + (1 - near) * part


def disc(x: float, y: float, z: float, radius: float, turn: float = 0.0, oval: float = 0.0) -> Array:
    """Rim (48, 3) of a disc, or of an ellipse that is longer by the share oval along turn."""
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    a, b = radius * (1 + oval / 2) * np.cos(angle), radius * (1 - oval / 2) * np.sin(angle)
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([x + c * a - s * b, y + s * a + c * b, np.full(48, z)], axis=1)


@dataclass(frozen=True)
class Body:
    """What a robot looks like: a dark box with pads, and two stickers that are not quite round."""

    length_mm: float
    width_mm: float
    pads: Array  # (n, 5): x, y, half sizes, tone
    ovals: tuple[float, float]

    def shapes(self, pose: Array, marks_mm: Array, look: Look) -> list[Shape]:
        """The robot at a pose (x, y, heading) with its marks at (green x, y, yellow x, y)."""
        x, y, heading = pose
        c, s = np.cos(heading), np.sin(heading)

        def placed(points: Array, z: float) -> Array:
            px, py = points[:, 0], points[:, 1]
            return np.stack([x + c * px - s * py, y + s * px + c * py, np.full(len(points), z)], axis=1)

        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [self.length_mm / 2, self.width_mm / 2]
        tone = look.plate
        found = [Shape(placed(corners * 1.15 + [0.4, 0.3], 0.0), (0.75 * tone[0], 0.75 * tone[1], 0.75 * tone[2]))]
        found += [Shape(placed(corners * 0.96, z), (0.03, 0.03, 0.035)) for z in (0.5, 2.5, 4.5)]
        found.append(Shape(placed(corners, TOP_MM), look.top))
        for px, py, half_x, half_y, bright in self.pads:
            rim = np.array([[px + i * half_x, py + j * half_y] for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))])
            found.append(Shape(placed(rim, TOP_MM), (bright, bright, bright)))
        for place, oval, colour in zip(marks_mm.reshape(2, 2), self.ovals, (look.green, look.yellow), strict=True):
            found.append(Shape(disc(*place, TOP_MM, 0.5, heading, oval), colour))
        return found


def random_body(rng: np.random.Generator, length_mm: float, width_mm: float) -> Body:
    """Pads on the front half, away from the stickers on the rear half."""
    low, high = [0.3, -3.5, 0.1, 0.1, 0.05], [2.0, 3.5, 0.4, 0.6, 0.5]
    pads = rng.uniform(low, high, (6, 5))
    ovals = rng.uniform(-0.06, 0.06, 2)
    return Body(length_mm, width_mm, pads, (ovals[0], ovals[1]))


@dataclass(frozen=True)
class Sheet:
    """A printed gauge: columns × rows of dots, true pitch and diameter, two larger dots as in its file."""

    columns: int
    rows: int
    pitch_mm: float
    diameter_mm: float
    large: tuple[tuple[int, int], ...]
    large_mm: float

    def shapes(self, rotation: Array, shift_mm: Array) -> list[Shape]:
        """The sheet, turned about its middle and shifted."""
        half = np.array([self.columns + 1.2, self.rows + 1.2]) * self.pitch_mm / 2
        paper = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * np.append(half, 1.0)
        found = [Shape(paper @ rotation.T + shift_mm, (0.8, 0.8, 0.8))]
        for row in range(self.rows):
            for column in range(self.columns):
                x = (column - (self.columns - 1) / 2) * self.pitch_mm
                y = (row - (self.rows - 1) / 2) * self.pitch_mm
                size = self.large_mm if (column, row) in self.large else self.diameter_mm
                found.append(Shape(disc(x, y, 0.0, size / 2) @ rotation.T + shift_mm, (0.03, 0.03, 0.03)))
        return found


def film(studio: Studio, body: Body, poses: Array, marks_mm: Array) -> Iterator[Array]:
    """Frames of a run; poses (3, k), marks_mm (4, k)."""
    for pose, marks in zip(poses.T, marks_mm.T, strict=True):
        yield studio.image(body.shapes(pose, marks, studio.look))


def write_video(path: Path, frames: Iterator[Array], size_px: tuple[int, int], frames_per_s: int, crf: int) -> None:
    """Write frames as H.264 in 4:2:0."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(frames_per_s))
        stream.width, stream.height = size_px
        stream.pix_fmt, stream.options = "yuv420p", {"crf": str(crf), "preset": "veryfast"}
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="bgr24")))
        container.mux(stream.encode())
