"""Scene → frames, truth and video file.

The presentation time of a frame is the middle of its exposure (of the first field's, in an interlaced recording).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.camera import Camera
from simulator.dynamics.terms import TIME
from simulator.effects.view import View
from simulator.errors import SimulationError
from simulator.mark_layout import Mark
from simulator.observation import view_of
from simulator.rendering.backdrop import Overlay, brushed_plate, overlay, wire_cover
from simulator.rendering.coverage import Kernel, blur_kernel
from simulator.rendering.motion import poses_at
from simulator.rendering.painter import Box, RobotLook, distractor_disc, moments_of_exposure, paint_disc, paint_robot
from simulator.rendering.plane import PlaneMap, plane_map
from simulator.rendering.scene import Scene
from simulator.rendering.sensor import digitised
from simulator.rendering.shots import Shot, clock_of, shots
from simulator.rendering.video import encode
from simulator.robot import Robot, load_robot

Array = NDArray[np.float64]
Numbers = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class RenderedFrame:
    """A frame as the sensor gives it.

    presentation_s: exact; image: (h, w, 3) red, green, blue or (h, w), uint8, or uint16 above 8 bits.
    """

    index: int
    presentation_s: Fraction
    image: Numbers


@dataclass(frozen=True)
class Stage:
    """What all frames of a scene share."""

    scene: Scene
    robot: Robot
    view: View
    camera: Camera
    kernel: Kernel
    plan: tuple[Shot, ...]
    poses: Array  # (shots, 3, 3): x_mm, y_mm, heading_rad at the begin, middle and end of each exposure


def set_stage(scene: Scene) -> Stage:
    """Load the files that the scene names and compute the robot's pose in every exposure."""
    robot, camera = load_robot(scene.robot), scene.camera.camera()
    robot = robot.model_copy(update={"effect": robot.effect + scene.effect})
    view = view_of(robot, [mark.place_mm for mark in robot.layout])
    if any(term.basis == TIME for term in view.errors):
        raise SimulationError(
            "a camera error that drifts with time cannot be rendered; leave that effect out of the scene"
        )
    if view.rolls:
        raise SimulationError(
            "a rendered camera exposes all rows of a frame at once; leave the effect rolling-shutter out of the scene"
        )
    plan = tuple(shots(scene, np.random.default_rng([scene.seed, 1]), Fraction(str(view.time_factor))))
    middle = np.array([float(shot.time_s) for shot in plan])
    times = middle[:, None] + np.array([-0.5, 0.0, 0.5]) * scene.exposure.time_s
    poses = poses_at(scene.motion, robot, times.ravel()).reshape(len(plan), 3, 3)
    return Stage(scene, robot, view, camera, blur_kernel(scene.optics.blur_px), plan, poses)


def render_frames(scene: Scene) -> Iterator[RenderedFrame]:
    """Draw the frames of a scene one by one, without encoding.

    Raises SimulationError, or what reading the robot, camera and pose files raises.
    """
    yield from frames_of(set_stage(scene))


def frames_of(stage: Stage) -> Iterator[RenderedFrame]:
    """Draw the frames of a stage."""
    easel = _Easel(stage)
    for index, fields in groupby(enumerate(stage.plan), key=lambda item: item[1].frame):
        image: Numbers | None = None
        shown = Fraction(0)
        for place, shot in fields:
            taken, shown = easel.image(place), shot.shown_s
            if image is None or shot.rows == "all":
                image = taken
            else:
                first = 0 if shot.rows == "even" else 1
                image[first::2] = taken[first::2]
        if image is not None:
            yield RenderedFrame(index, shown, image)


class _Easel:
    """Draws one exposure after another, repainting only what moved."""

    def __init__(self, stage: Stage) -> None:
        scene, camera = stage.scene, stage.camera
        pad = stage.kernel.margin + 2
        ground = plane_map(camera, 0.0, pad)
        rng = np.random.default_rng([scene.seed, 2])
        self.stage = stage
        self.over: Overlay = overlay(scene, camera.size_px)
        self.backdrop = brushed_plate(scene.plate, scene.optics, ground, rng) * np.float32(scene.exposure.gain)
        self.light = self.over.applied(self.backdrop)  # what reaches the sensor
        self.scenery = self.backdrop.copy()  # what leaves the scene
        self.clean = self.light.copy()
        self.planes: dict[float, PlaneMap] = {0.0: ground}
        layout = stage.robot.layout
        lights = scene.marks.lights(layout)
        planes = [self._plane(mark.height_mm) for mark in layout]
        self.look = RobotLook(stage.robot, stage.view, lights, scene.marks.rim_loss, planes, scene.exposure.gain)

    def _plane(self, height_mm: float) -> PlaneMap:
        if height_mm not in self.planes:
            self.planes[height_mm] = plane_map(self.stage.camera, height_mm, self.stage.kernel.margin + 2)
        return self.planes[height_mm]

    def image(self, place: int) -> Numbers:
        """The exposure at a place of the plan, as numbers."""
        scene, shot = self.stage.scene, self.stage.plan[place]
        changed = [box for box in self._paint(place) if box is not None]
        for left, top, right, bottom in changed:
            region = np.s_[top:bottom, left:right]
            self.light[region] = (
                self.scenery[region] * self.over.transmission[region][..., None] + self.over.veil[region]
            )
        lighting = scene.lighting
        dark = lighting.switched_at_s is not None and shot.time_s < lighting.switched_at_s
        level = lighting.level_before if dark else 1.0
        numbers = digitised(self.light, scene.sensor, level=level, key=(scene.seed << 24) + shot.seed)
        for left, top, right, bottom in changed:
            region = np.s_[top:bottom, left:right]
            self.scenery[region], self.light[region] = self.backdrop[region], self.clean[region]
        return numbers

    def _paint(self, place: int) -> Iterator[Box | None]:
        stage = self.stage
        poses = _through(stage, place)
        middle, half = float(stage.plan[place].time_s), stage.scene.exposure.time_s / 2
        for distractor in stage.scene.distractor:
            plane = self._plane(distractor.height_mm)
            ends = [distractor_disc(distractor, plane, middle + side * half) for side in (-1, 1)]
            way_px = np.linalg.norm(np.diff(plane.image_from_plane([end.center_mm for end in ends]), axis=0))
            moments = moments_of_exposure((middle - half, middle + half), float(way_px))
            discs = [distractor_disc(distractor, plane, time, stage.scene.exposure.gain) for time in moments]
            yield paint_disc(discs, stage.kernel, self.scenery)
        yield paint_robot(self.look, stage.camera, stage.kernel, poses, self.scenery)


def _through(stage: Stage, place: int) -> Array:
    """Poses at the parts of an exposure, (k, 3), by a parabola through its beginning, middle and end."""
    begin, middle, end = stage.poses[place]
    seen = zip(stage.robot.layout, stage.view.marks(*stage.poses[place].T), strict=True)
    marks_px = np.stack([_project(stage, center, mark) for mark, center in seen], axis=1)
    ways = np.linalg.norm(np.diff(marks_px, axis=0), axis=-1)
    way_px = float(np.nan_to_num(ways.max(axis=1).sum()))
    s = moments_of_exposure((-1.0, 1.0), way_px)[:, None]
    return np.asarray(middle + s * (end - begin) / 2 + s**2 * (end + begin - 2 * middle) / 2)


def render_clip(scene: Scene, video_path: Path, progress: Callable[[int, int], None] | None = None) -> pd.DataFrame:
    """Draw and encode a scene; returns its truth (see `truth_of`).

    video_path: written in place (the caller sees to a temporary name), its ending chooses the container; progress is
    called with frames done and frames in all. Raises SimulationError where the codec does not fit the container.
    """
    stage = set_stage(scene)
    total = stage.plan[-1].frame + 1

    def counted() -> Iterator[RenderedFrame]:
        for frame in frames_of(stage):
            yield frame
            if progress is not None:
                progress(frame.index + 1, total)

    images = ((frame.presentation_s, frame.image) for frame in counted())
    encode(images, scene, clock_of(stage.plan, scene.frame_rate), stage.camera.size_px, video_path)
    return truth_of(stage)


def truth_of(stage: Stage) -> pd.DataFrame:
    """Exact truth, a row per exposure.

    Columns: frame; field (only if interlaced: "top" or "bottom"); time_s, the middle of the exposure; presentation_s;
    x_mm, y_mm, heading_deg of the robot's centre; per mark x_mm, y_mm in the plate frame, on the plane of the marks,
    including observation effects of the scene; x_px, y_px, the image of the mark's centre; visible, the share of the
    mark that is in the image and not occluded.
    """
    scene = stage.scene
    x, y, heading = stage.poses[:, 1].T
    columns: dict[str, object] = {"frame": [shot.frame for shot in stage.plan]}
    if scene.timing.interlaced != "no":
        columns["field"] = ["top" if shot.rows == "even" else "bottom" for shot in stage.plan]
    columns["time_s"] = [float(shot.time_s) for shot in stage.plan]
    columns["presentation_s"] = [float(shot.shown_s) for shot in stage.plan]
    columns |= {"x_mm": x, "y_mm": y, "heading_deg": np.degrees(heading)}
    for mark, center in zip(stage.robot.layout, stage.view.marks(x, y, heading), strict=True):
        name, center_px = mark.name, _project(stage, center, mark)
        columns |= {f"{name}_x_mm": center[:, 0], f"{name}_y_mm": center[:, 1]}
        columns |= {f"{name}_x_px": center_px[:, 0], f"{name}_y_px": center_px[:, 1]}
        columns[f"{name}_visible"] = _visible(stage, center, mark)
    return pd.DataFrame(columns)


def _project(stage: Stage, points_mm: Array, mark: Mark) -> Array:
    height = np.full((*points_mm.shape[:-1], 1), mark.height_mm)
    return stage.camera.image_from_plate(np.concatenate([points_mm, height], axis=-1))


def _visible(stage: Stage, center_mm: Array, mark: Mark) -> Array:
    """Share of a mark's area that the camera sees, from 127 points spread evenly over it."""
    count = 127
    radius = mark.diameter_mm / 2 * np.sqrt((np.arange(count) + 0.5) / count)
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)  # sunflower: equal areas
    points = center_mm[:, None] + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    points_px = _project(stage, points, mark)
    size = np.array(stage.camera.size_px)
    inside = ((points_px > -0.5) & (points_px < size - 0.5)).all(axis=-1)
    return np.asarray((inside & ~wire_cover(stage.scene.wire, points_px)).mean(axis=-1))
