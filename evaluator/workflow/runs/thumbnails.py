"""Thumbnails of a recording, saved during tracking for the report."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from evaluator.recording import Frame, ImageSequence, Recording

IMAGES = 12  # per run: about one every ten degrees of a typical turn
WIDTH_PX = 320  # half of VGA: marks are recognised
ASSUMED_FRAMES = 600  # if the container does not state their number: ten seconds at 60/s


class WithThumbnails:
    """A recording that collects thumbnails of some of its frames while it is read."""

    def __init__(self, recording: Recording | ImageSequence) -> None:
        """Wrap a recording; nothing is decoded before the first iteration."""
        self._recording = recording
        self._step = max(1, (recording.expected_frames or ASSUMED_FRAMES) // (IMAGES - 1))
        self._chosen: list[tuple[float, bytes]] = []

    def __getattr__(self, name: str) -> Any:
        """All other attributes are those of the recording."""
        return getattr(self._recording, name)

    def __iter__(self) -> Iterator[Frame]:
        """Frames of the recording."""
        self._chosen = []
        for frame in self._recording:
            if frame.index % self._step == 0:
                self._chosen.append((frame.time_s, small_jpeg(frame)))
            yield frame

    def to_json(self) -> str:
        """The thumbnails of the last iteration as JSON for the report."""
        thin = max(1, round(len(self._chosen) / IMAGES))
        chosen = self._chosen[::thin]
        return json.dumps([{"time_s": time, "jpeg": base64.b64encode(data).decode()} for time, data in chosen]) + "\n"


def small_jpeg(frame: Frame) -> bytes:
    """A frame as a JPEG of WIDTH_PX."""
    width, height = frame.size_px
    size = (WIDTH_PX, round(WIDTH_PX * height / width))
    planes = {name: _resized(getattr(frame, name), size) for name in ("luma", "u", "v")}
    rgb = replace(frame, **planes, row_origin=0, row_step=1).to_rgb()
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(rgb[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 72])
    assert done
    return data.tobytes()


def _resized(plane: Any, size: tuple[int, int]) -> Any:
    return None if plane is None else cv2.resize(np.ascontiguousarray(plane), size, interpolation=cv2.INTER_AREA)
