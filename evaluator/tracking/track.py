"""Frames → a table of sub-pixel mark centres with their uncertainty."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.progress import Progress, no_progress
from evaluator.recording import Frame
from evaluator.tracking.following.same_color import exchanged
from evaluator.tracking.following.tracker import Tracker
from evaluator.tracking.luma_marks.lights import LightFinder
from evaluator.tracking.luma_marks.tags import TagFinder, tag_names
from evaluator.tracking.observation import AMBIGUOUS, MISTAKEN, Sighting
from evaluator.tracking.rolling_shutter import RollingShutter
from evaluator.tracking.settings import TrackingSettings
from evaluator.tracking.uncertainty.combine import refine, take_out

Array = NDArray[np.float64]
PARTS = ("x_px", "y_px", "x_sigma_px", "y_sigma_px", "xy_cov_px2", "status")


def track(
    recording: Iterable[Frame], settings: TrackingSettings | None = None, progress: Progress = no_progress
) -> pd.DataFrame:
    """Track the marks of a recording.

    Returns a row per frame: frame, time_s, and per mark of the settings NAME_x_px, NAME_y_px, NAME_x_sigma_px,
    NAME_y_sigma_px, NAME_xy_cov_px2 (standard uncertainties and covariance of this frame's centre) and NAME_status:
    "ok", or why the mark is absent (its numbers are then NaN). Image coordinates, px. A tag also has NAME_corner1 to 4.
    progress: called with the numbers of frames done and expected. Raises InputError for a recording without colour.
    """
    wanted = settings or TrackingSettings()
    watched = _Watched(recording, wanted)
    tracker = Tracker(wanted.model_copy(update={"mark": wanted.of_kind("color")}))
    expected = int(getattr(recording, "expected_frames", 0))
    times: list[float] = []
    frames: list[int] = []
    kinds: list[str] = []
    height_px = 0
    # Plain numbers: objects would be examined again and again by the garbage collector.
    names = [part for name in wanted.mark for part in (watched.parts.get(name) or [name])]
    measured = {name: array("d") for name in names}
    status: dict[str, list[str]] = {name: [] for name in names}
    for frame, sightings in tracker.run(watched) if tracker.names else ((frame, []) for frame in watched):
        times.append(frame.time_s)
        frames.append(frame.index)
        kinds.append(frame.kind)
        height_px = frame.size_px[1]
        for name, one in (*zip(tracker.names, sightings, strict=True), *watched.found.pop(frame.index, {}).items()):
            measured[name].extend(one[:5])
            status[name].append(one.status)
        if not len(times) & 63:
            progress("tracking", len(times), max(expected, len(times)))
    if not times:
        raise InputError("the recording holds no frames")
    progress("tracking", len(times), len(times))
    time_s = np.array(times)
    numbers = {name: np.array(values).reshape(-1, 5) for name, values in measured.items()}
    for name, first in tracker.began.items():
        take_out(numbers[name], status[name], np.isfinite(numbers[name][:, 0]) & (np.array(frames) < first), MISTAKEN)
    if wanted.twins:
        _put_in_order(time_s, [(numbers[name], status[name]) for name in wanted.twins])
    corners = {name: parts[1:] for name, parts in watched.parts.items()}
    moved = tracker.camera.path(time_s) if wanted.pair and not tracker.second_look.plausible else None
    shutter = RollingShutter(wanted.readout_ms / 1000.0, height_px) if wanted.readout_ms else None
    refine(
        time_s, kinds, numbers, status, tracker.followers, wanted.rigid, corners, background_px=moved, shutter=shutter
    )
    return to_table(frames, time_s, numbers, status)


def _put_in_order(time_s: Array, marks: list[tuple[Array, list[str]]]) -> None:
    """Correct exchanged names of two marks of one colour, in place."""
    (one, its), (other, their) = marks
    swapped, unknown = exchanged(time_s, one[:, :2], other[:, :2])
    one[swapped], other[swapped] = other[swapped], one[swapped].copy()
    for row in np.flatnonzero(swapped):
        its[row], their[row] = their[row], its[row]
    for values, status in marks:
        take_out(values, status, unknown & np.isfinite(values[:, 0]), AMBIGUOUS)


class _Watched:
    """A recording whose tags and lights are measured during iteration; found: results by frame number."""

    def __init__(self, recording: Iterable[Frame], settings: TrackingSettings) -> None:
        self._recording = recording
        self.name = getattr(recording, "name", "the recording")
        tags, lights = settings.of_kind("aruco", "apriltag"), settings.of_kind("light")
        self._finders: list[TagFinder | LightFinder] = []
        if tags:
            self._finders.append(TagFinder(tags))
        if lights:
            self._finders.append(LightFinder(lights, settings))
        self.parts = {name: tag_names(name) for name in tags}
        self.found: dict[int, dict[str, Sighting]] = {}

    def __iter__(self) -> Iterator[Frame]:
        if not self._finders:
            yield from self._recording
            return
        for frame in self._recording:
            self.found[frame.index] = {k: v for finder in self._finders for k, v in finder.look(frame).items()}
            yield frame


def to_table(frames: list[int], time_s: Array, numbers: dict[str, Array], status: dict[str, list[str]]) -> pd.DataFrame:
    """Columns of `track`; numbers: per mark x, y, their variances and covariance (n, 5)."""
    columns: dict[str, object] = {"frame": np.array(frames, int), "time_s": time_s}
    for name, values in numbers.items():
        parts = [values[:, 0], values[:, 1], np.sqrt(values[:, 2]), np.sqrt(values[:, 3]), values[:, 4], status[name]]
        for part, value in zip(PARTS, parts, strict=True):
            columns[f"{name}_{part}"] = value
    return pd.DataFrame(columns)
