"""Draws robot, marks and distractors over the backdrop, averaged over an exposure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.camera import Camera
from calibration.frames import plate_from_body
from simulator.effects.view import View
from simulator.mark_layout import TAGS
from simulator.rendering.coverage import Kernel, add_disc, add_polygon
from simulator.rendering.plane import PlaneMap
from simulator.rendering.tables import Distractor, Light
from simulator.rendering.tag import tag_squares
from simulator.robot import Robot

Array = NDArray[np.float64]
Box = tuple[int, int, int, int]
SIDE = np.array([0.012, 0.012, 0.014])  # anodised black in its own shadow
TOP = np.array([0.045, 0.045, 0.048])  # black top face, lit from above
SHEET, PRINT = np.full(3, 0.85), np.full(3, 0.04)  # white paper and black ink
CLEARANCE_MM = 0.2  # the body hangs a little above the plate, on its wheels


@dataclass(frozen=True)
class Disc:
    """A flat disc at one moment: centre on its plane, mm; colour of its light."""

    plane: PlaneMap
    center_mm: tuple[float, float]
    diameter_mm: float
    rim_loss: float
    color: Array

    def box(self, margin: int) -> Box | None:
        """Box of pixels that the blurred disc may cover, within the image; None if there are none."""
        angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = np.array(self.center_mm) + 0.55 * self.diameter_mm * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return box_about(self.plane.image_from_plane(ring), margin, self.plane.camera.size_px)


@dataclass(frozen=True)
class Tag:
    """An ArUco or AprilTag marker at one moment: its centre on its plane, mm, and its corners in the body frame."""

    plane: PlaneMap
    center_mm: tuple[float, float]
    heading_rad: float
    sheet_mm: Array
    square_mm: Array
    cells_mm: Array
    gain: float

    def sheet_px(self) -> Array:
        """Corners of the white sheet, (4, 2), clockwise as seen."""
        return self._in_image(self.sheet_mm)

    def square_px(self) -> Array:
        """Corners of the black square, (4, 2)."""
        return self._in_image(self.square_mm)

    def cells_px(self) -> Array:
        """Corners of the white cells, (n, 4, 2)."""
        return np.array([self._in_image(cell) for cell in self.cells_mm])

    def _in_image(self, corners_mm: Array) -> Array:
        return clockwise_hull(
            self.plane.image_from_plane(plate_from_body(corners_mm, *self.center_mm, self.heading_rad))
        )


def box_about(points_px: Array, margin: int, size_px: tuple[int, int]) -> Box | None:
    """Pixel box (left, top, right, bottom; right and bottom excluded) about points (n, 2), cut to the image."""
    if not np.isfinite(points_px).all():
        return None
    left, top = np.floor(points_px.min(axis=0)).astype(int) - margin
    right, bottom = np.ceil(points_px.max(axis=0)).astype(int) + margin + 1
    box = max(int(left), 0), max(int(top), 0), min(int(right), size_px[0]), min(int(bottom), size_px[1])
    return box if box[2] > box[0] and box[3] > box[1] else None


def clockwise_hull(points_px: Array) -> Array:
    """Convex hull (k, 2) of image points (n, 2), clockwise as seen (y down)."""
    hull = cv2.convexHull(points_px.astype(np.float32))[:, 0].astype(float)
    x, y = hull.T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return np.ascontiguousarray(hull if area > 0 else hull[::-1])


def disc_cover(disc: Disc, kernel: Kernel, box: Box, share: float, out: Array) -> None:
    """Add a disc's coverage times share to out, which spans box."""
    geometry = (*disc.center_mm, disc.diameter_mm / 2, disc.rim_loss)
    plane = disc.plane
    add_disc(plane.x_mm, plane.y_mm, plane.pad, box, geometry, kernel.parts, kernel.weights, share, out)


@dataclass(frozen=True)
class RobotLook:
    """The drawn parts of a robot: its body as a box, and its marks on their planes."""

    robot: Robot
    view: View  # with observation effects, so that the measured positions have these errors
    lights: Sequence[Light]
    rim_loss: float
    planes: Sequence[PlaneMap]  # of each mark
    gain: float

    @cached_property
    def squares(self) -> dict[str, tuple[Array, Array, Array]]:
        """White sheet, black square and white cells of every tag, by its name, as large as they are seen."""
        tags = [mark for mark in self.robot.layout if mark.kind in TAGS]
        scale = self.view.scale
        found = {mark.name: tag_squares(mark) for mark in tags}
        return {name: (scale * sheet, scale * square, scale * cells) for name, (sheet, square, cells) in found.items()}

    def faces_px(self, camera: Camera, pose: Array) -> tuple[Array, Array] | None:
        """Outline of the whole body and of its top face for a pose (x_mm, y_mm, heading_rad); None behind it."""
        body = self.robot.body
        half = np.array([body.length_mm, body.width_mm]) / 2
        corners = self.view.place(plate_from_body(np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * half, *pose))
        edge = np.concatenate(
            [corners + share * (np.roll(corners, -1, axis=0) - corners) for share in (0, 0.25, 0.5, 0.75)]
        )
        top, bottom = (
            camera.image_from_plate(np.column_stack([edge, np.full(len(edge), height)]))
            for height in (body.height_mm, CLEARANCE_MM)
        )
        if not np.isfinite([top, bottom]).all():
            return None
        return clockwise_hull(np.concatenate([top, bottom])), clockwise_hull(top)

    def marks_at(self, pose: Array) -> list[Disc | Tag]:
        """The marks for a pose (3,)."""
        layout = self.robot.layout
        found: list[Disc | Tag] = []
        places = self.view.marks(*pose)
        for k, (mark, at) in enumerate(zip(layout, places, strict=True)):
            place, plane = (float(at[0]), float(at[1])), self.planes[k]
            if mark.kind in TAGS:
                found.append(Tag(plane, place, float(pose[2]), *self.squares[mark.name], self.gain))
            else:
                light = self.gain * np.array(self.lights[k])
                found.append(Disc(plane, place, self.view.scale * mark.diameter_mm, self.rim_loss, light))
        return found


def paint_robot(
    look: RobotLook, camera: Camera, kernel: Kernel, poses: Array, light: NDArray[np.float32]
) -> Box | None:
    """Draw the robot into the scene's light (h, w, 3), averaged over poses (k, 3); returns the box that changed."""
    outlines = [faces for pose in poses if (faces := look.faces_px(camera, pose)) is not None]
    if not outlines:
        return None
    reach = kernel.margin + 3
    box = box_about(np.concatenate([hull for hull, _ in outlines]), reach, camera.size_px)
    if box is None:
        return None
    left, top, right, bottom = box
    share = 1 / len(poses)
    body, face = (np.zeros((bottom - top, right - left)) for _ in range(2))
    for hull, top_hull in outlines:
        add_polygon(hull, kernel.blur_px, box, share, body)
        add_polygon(top_hull, kernel.blur_px, box, share, face)
    face = np.minimum(face, body)
    region = light[top:bottom, left:right]
    region *= (1 - body)[..., None].astype(np.float32)
    region += (look.gain * ((body - face)[..., None] * SIDE + face[..., None] * TOP)).astype(np.float32)
    for moments in zip(*(look.marks_at(pose) for pose in poses), strict=True):
        discs = [one for one in moments if isinstance(one, Disc)]
        if discs:
            paint_disc(discs, kernel, light, look.gain * TOP)
        else:
            paint_tag([one for one in moments if isinstance(one, Tag)], kernel, light)
    return box


def paint_tag(moments: Sequence[Tag], kernel: Kernel, light: NDArray[np.float32]) -> None:
    """Draw a tag over the scene's light, averaged over its moments: white sheet, black square, white cells."""
    box = box_about(
        np.concatenate([tag.sheet_px() for tag in moments]), kernel.margin + 3, moments[0].plane.camera.size_px
    )
    if box is None:
        return
    left, top, right, bottom = box
    sheet, square, cells = (np.zeros((bottom - top, right - left)) for _ in range(3))
    share = 1 / len(moments)
    for tag in moments:
        add_polygon(tag.sheet_px(), kernel.blur_px, box, share, sheet)
        add_polygon(tag.square_px(), kernel.blur_px, box, share, square)
        for cell in tag.cells_px():
            add_polygon(cell, kernel.blur_px, box, share, cells)
    gain, region = moments[0].gain, light[top:bottom, left:right]
    for cover, shade in ((sheet, SHEET), (square, PRINT), (cells, SHEET)):
        region += (np.minimum(cover, 1)[..., None] * (gain * shade - region)).astype(np.float32)


def paint_disc(
    moments: Sequence[Disc], kernel: Kernel, light: NDArray[np.float32], under: Array | None = None
) -> Box | None:
    """Draw one disc over the scene's light, averaged over its moments; returns the box that changed.

    under: light, (3,), of the surface that carries the disc; default: the light of the scene below it.
    """
    boxes = [box for disc in moments if (box := disc.box(kernel.margin + 1)) is not None]
    if not boxes:
        return None
    left, top = min(box[0] for box in boxes), min(box[1] for box in boxes)
    right, bottom = max(box[2] for box in boxes), max(box[3] for box in boxes)
    cover = np.zeros((bottom - top, right - left))
    for disc in moments:
        disc_cover(disc, kernel, (left, top, right, bottom), 1 / len(moments), cover)
    region = light[top:bottom, left:right]
    region += (cover[..., None] * (moments[0].color - (region if under is None else under))).astype(np.float32)
    return left, top, right, bottom


def distractor_disc(distractor: Distractor, plane: PlaneMap, time_s: float, gain: float = 1.0) -> Disc:
    """Place a distractor at a time."""
    x, y = (
        at + speed * time_s
        for at, speed in zip((distractor.x_mm, distractor.y_mm), distractor.velocity_mm_s, strict=True)
    )
    return Disc(plane, (x, y), distractor.diameter_mm, 0.0, gain * np.array(distractor.color))


def moments_of_exposure(times_s: tuple[float, float], way_px: float) -> Array:
    """Midpoints of equal parts of an exposure, in each of which the image moves by at most a quarter pixel."""
    count = math.ceil(min(max(4 * way_px, 1), 256))
    return times_s[0] + (np.arange(count) + 0.5) / count * (times_s[1] - times_s[0])
