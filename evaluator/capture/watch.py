"""Which marks are visible in a frame, as text and image."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from evaluator.files import read_with, write_image
from evaluator.recording import Frame
from evaluator.tracking.detection.find import find_marks
from evaluator.tracking.settings import TrackingSettings, load_settings

CIRCLE = (255, 64, 160)  # different from the colours of plates, wires and marks


def watch_marks(settings: Path | None = None, image: Path | None = None) -> Callable[[Frame], str]:
    """A function that describes which marks a frame shows, and writes an image of it with circles around them.

    settings: tracking.toml. image: overwritten by every call. Raises InputError for settings that cannot be read.
    """
    used = TrackingSettings() if settings is None else read_with(load_settings, settings)
    names = list(used.mark)

    def look(frame: Frame) -> str:
        if frame.u is None:
            return "grey frames: coloured marks cannot be found"
        seen = find_marks(frame, used, names).chosen
        if image is not None:
            shown = np.ascontiguousarray(frame.to_rgb())
            for mark in seen.values():
                center = (round(mark.center_px[0]), round(mark.center_px[1]))
                cv2.circle(shown, center, round(2 * mark.radius_px + 3), CIRCLE, 2, cv2.LINE_AA)
            write_image(shown, image)
        missing = [name for name in names if name not in seen]
        return f"no {' and no '.join(missing)} mark" if missing else f"{' and '.join(names)} seen"

    return look
