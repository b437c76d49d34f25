"""Frames of recordings and images, decoded in a separate process."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from evaluator.errors import InputError
from evaluator.workflow.frames.child import Child

ANSWER_S = 60.0  # timeout, sufficient to decode a whole recording
OPEN_FILES = 3  # of one process: the recording that is shown, the one before, and that of another tab
QUALITY = 88  # of JPEG: no visible difference from 100 %, a tenth of the bytes


@dataclass(frozen=True)
class Wanted:
    """Frames of a recording: first and number, no wider than most_px; near: the preceding key frame instead."""

    path: Path
    first: int
    count: int = 1
    near: bool = False
    most_px: int = 0
    rate_hz: float | None = None


class Decoder:
    """Frames from a child process that is started by the first request, and again after it ended."""

    def __init__(self) -> None:
        """No process is started yet."""
        self._child = Child(
            _answers,
            (),
            ANSWER_S,
            slow="decoding this recording takes too long; convert it, for example to H.264",
            died="the decoder crashed: the recording is damaged; record or copy it again",
        )

    def start(self) -> None:
        """Start the process before the first request."""
        self._child.start()

    def prepare(self) -> None:
        """Load the detection of dots, so that it does not delay the first image of a gauge. Raises InputError."""
        self._child.ask("prepare")

    def contents(self, path: Path, rate_hz: float | None = None) -> dict[str, Any]:
        """Times (s) of all frames, numbers of key frames, size in px. Raises InputError."""
        found: dict[str, Any] = self._child.ask("contents", path, rate_hz)
        return found

    def frames(self, wanted: Wanted) -> list[tuple[int, bytes]]:
        """Number and JPEG of frames. Raises InputError."""
        found: list[tuple[int, bytes]] = self._child.ask("frames", wanted)
        return found

    def marks(self, path: Path, numbers: list[int], settings: dict[str, Any], rate_hz: float | None) -> list[Any]:
        """Candidates for marks in some frames, with settings as of tracking.toml. Raises InputError."""
        found: list[Any] = self._child.ask("marks", path, rate_hz, numbers, settings)
        return found

    def image(self, path: Path) -> bytes:
        """An image file as JPEG. Raises InputError."""
        found: bytes = self._child.ask("image", path)
        return found

    def dots(self, path: Path) -> dict[str, Any]:
        """The dots of a gauge image. Raises InputError."""
        found: dict[str, Any] = self._child.ask("dots", path)
        return found

    def close(self) -> None:
        """End the process."""
        self._child.close()

    @property
    def process_id(self) -> int | None:
        """Id of the running process."""
        return self._child.process_id


def _answers() -> Callable[..., Any]:
    """The function that answers requests, in the process."""
    import evaluator.recording.seek  # noqa: F401 - so that it does not delay the first frame

    return partial(_answer, OrderedDict())


def _answer(opened: OrderedDict[tuple[Any, ...], Any], kind: str, *rest: Any) -> Any:
    if kind == "contents":
        path, rate_hz = rest
        contents = _frames_of(opened, path, rate_hz).contents
        return {"time_s": contents.time_s, "key_frames": contents.key_frames, "size_px": contents.size_px}
    if kind == "prepare":
        return _prepare()
    if kind in ("image", "dots"):
        from evaluator.workflow.viewing.cameras import dots_of_image, image_jpeg

        return image_jpeg(*rest) if kind == "image" else dots_of_image(*rest)
    if kind == "marks":
        from evaluator.workflow.viewing.marks import look_at, settings_of

        path, rate_hz, asked, said = rest
        settings, source = settings_of(said), _frames_of(opened, path, rate_hz)
        return [look_at(source.frame(number), settings) for number in asked]
    (wanted,) = rest
    frames = _frames_of(opened, wanted.path, wanted.rate_hz)
    last = len(frames.contents.time_s)
    numbers = range(wanted.first, max(min(wanted.first + wanted.count, last), wanted.first + 1))
    chosen = [frames.key_frame(wanted.first)] if wanted.near else numbers
    return [(number, jpeg(frames.image(number), wanted.most_px)) for number in chosen]


def _prepare() -> None:
    """Find the dots of a small gauge."""
    import cv2
    import numpy as np

    from evaluator.workflow.viewing.cameras import gauge_in

    image = np.full((160, 200), 230, np.uint8)
    for row, column in np.ndindex(6, 8):
        cv2.circle(image, (20 + 22 * column, 20 + 22 * row), 6, (20,), cv2.FILLED, cv2.LINE_AA)
    gauge_in(image)


def _frames_of(opened: OrderedDict[tuple[Any, ...], Any], path: Path, rate_hz: float | None) -> Any:
    """The frames of a recording, opened again if the file has changed."""
    from evaluator.recording.seek import Frames

    try:
        state = path.stat()
    except OSError as error:
        raise InputError(f"{path.name}: no such file") from error
    key = (path, rate_hz, state.st_size, state.st_mtime_ns)
    if key not in opened:
        while len(opened) >= OPEN_FILES:
            opened.popitem(last=False)[1].close()
        opened[key] = Frames(path, rate_hz)
    opened.move_to_end(key)
    return opened[key]


def jpeg(image: Any, most_px: int) -> bytes:
    """An image (h, w, 3) BGR as JPEG, no wider than most_px; 0: no limit."""
    import cv2

    height, width = image.shape[:2]
    if 0 < most_px < width:
        image = cv2.resize(image, (most_px, max(1, round(height * most_px / width))), interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise InputError("a frame cannot be shown as JPEG")
    return bytes(data)
