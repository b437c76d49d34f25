"""Static parts of a scene: the brushed plate, the light on it, reflections and wires, all in image pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr

from simulator.rendering.plane import NOWHERE_MM, PlaneMap
from simulator.rendering.scene import SceneBase
from simulator.rendering.tables import Glare, Lighting, Optics, Plate, Wire

Image32 = NDArray[np.float32]
STEEL = np.array([0.98, 1.0, 1.01], dtype=np.float32)  # brushed steel is nearly grey, a little cool


@dataclass(frozen=True)
class Overlay:
    """Light on the way to the sensor: light = (scene · transmission) + veil, per pixel.

    transmission: (h, w), share of the scene's light that arrives (lighting, vignetting, occlusion by wires);
    veil: (h, w, 3), light added by reflections and wires.
    """

    transmission: Image32
    veil: Image32

    def applied(self, scene_light: Image32) -> Image32:
        """Light at the sensor for a whole image of the scene."""
        return np.asarray(scene_light * self.transmission[..., None] + self.veil, dtype=np.float32)


def overlay(scene: SceneBase, size_px: tuple[int, int]) -> Overlay:
    """Build the overlay of a scene."""
    covered, wires = _wires(scene.wire, scene.optics.blur_px, size_px)
    lit = _light_field(scene.optics, scene.lighting, size_px)
    veil = lit[..., None] * wires + _glare(scene.glare, size_px)[..., None]
    return Overlay((lit * (1 - covered)).astype(np.float32), veil.astype(np.float32))


def wire_cover(wires: Sequence[Wire], points_px: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which image points (..., 2) lie behind a wire."""
    covered = np.zeros(points_px.shape[:-1], dtype=bool)
    for wire in wires:
        covered |= _distance_px(wire, points_px) < wire.width_px / 2
    return covered


def brushed_plate(plate: Plate, optics: Optics, ground: PlaneMap, rng: np.random.Generator) -> Image32:
    """Light of the bare plate, (h, w, 3): brush marks of several lengths and a broad sheen, blurred by the lens."""
    inner = np.s_[ground.pad : -ground.pad, ground.pad : -ground.pad]
    x_mm, y_mm = ground.x_mm[inner], ground.y_mm[inner]
    seen = np.abs(x_mm) < NOWHERE_MM / 2
    angle = math.radians(plate.brush_direction_deg)
    along = np.where(seen, math.cos(angle) * x_mm + math.sin(angle) * y_mm, 0.0)
    across = np.where(seen, -math.sin(angle) * x_mm + math.cos(angle) * y_mm, 0.0)
    marks = np.zeros_like(along)
    layers = ((1.0, 50.0, 0.5), (2.5, 25.0, 0.35), (6.0, 30.0, 0.3))  # width by the grain, length by width, share
    for width, length, share in layers:
        texture = gaussian_filter(rng.standard_normal((512, 512)), 0.8, mode="wrap").astype(np.float32)
        step_mm = width * plate.grain_mm / 2
        column, row = ((part % 512.0).astype(np.float32) for part in (along / (length * step_mm), across / step_mm))
        marks += share / texture.std() * cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    spread = max(float(np.ptp(across)), 1e-6)
    sheen = np.exp(-(((across - across.mean()) / (0.35 * spread)) ** 2)) - 0.5
    light = plate.brightness * (1 + plate.contrast * marks) * (1 + plate.sheen * sheen) * seen
    light = np.clip(light, 0, None).astype(np.float32)
    if optics.blur_px > 0:
        light = cv2.GaussianBlur(light, (0, 0), optics.blur_px)
    return np.asarray(light[..., None] * STEEL, dtype=np.float32)


def _pixels(size_px: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    width, height = size_px
    column, row = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    return column, row


def _light_field(optics: Optics, lighting: Lighting, size_px: tuple[int, int]) -> NDArray[np.float64]:
    column, row = _pixels(size_px)
    half_width, half_height = (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
    reach = math.hypot(half_width, half_height)
    right, up = (column - half_width) / reach, (half_height - row) / reach
    angle = math.radians(lighting.gradient_direction_deg)
    slope = math.cos(angle) * right + math.sin(angle) * up
    return np.asarray((1 - optics.vignetting * (right**2 + up**2)) * (1 + lighting.gradient * slope))


def _glare(spots: Sequence[Glare], size_px: tuple[int, int]) -> NDArray[np.float64]:
    column, row = _pixels(size_px)
    light = np.zeros_like(column)
    for spot in spots:
        square = (column - spot.x_px) ** 2 + (row - spot.y_px) ** 2
        light += spot.strength * np.exp(-square / (2 * spot.radius_px**2))
    return light


def _wires(
    wires: Sequence[Wire], blur_px: float, size_px: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of each pixel covered by wires, (h, w), and the light that the wires send, (h, w, 3)."""
    points = np.stack(_pixels(size_px), axis=-1)
    covered, light = np.zeros(points.shape[:2]), np.zeros((*points.shape[:2], 3))
    soft = max(math.hypot(blur_px, math.sqrt(1 / 12)), 1e-3)
    for wire in wires:
        share = ndtr((wire.width_px / 2 - _distance_px(wire, points)) / soft)
        light = light * (1 - share[..., None]) + share[..., None] * np.asarray(wire.color)
        covered = 1 - (1 - covered) * (1 - share)
    return covered, light


def _distance_px(wire: Wire, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of image points (..., 2) to the middle line of a wire."""
    nearest = np.full(points_px.shape[:-1], np.inf)
    for start, end in zip(np.array(wire.points_px[:-1]), np.array(wire.points_px[1:]), strict=True):
        way = end - start
        along = np.clip(((points_px - start) @ way) / max(float(way @ way), 1e-12), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(points_px - start - along[..., None] * way, axis=-1))
    return nearest
