"""A decoder process and the door to it: media that nobody has checked may crash a decoder, and then only that."""

from __future__ import annotations

import multiprocessing
from collections import OrderedDict
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock
from typing import Any

from calibration.errors import CalibrationError
from evaluator.errors import InputError

ANSWER_S = 60.0  # the longest wait: a recording that is decoded from its beginning, to its end
OPEN_FILES = 3  # of one process: the recording that is looked at, the one before, another tab's
QUALITY = 88  # of JPEG: nothing to see at 100 %, a tenth of the bytes


@dataclass(frozen=True)
class Wanted:
    """Frames of a recording: first and how many, no wider than most_px; near: the key frame before it instead."""

    path: Path
    first: int
    count: int = 1
    near: bool = False
    most_px: int = 0
    rate_hz: float | None = None


class Decoder:
    """Frames from a process that is started when it is first needed, and anew after it ended."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._lock = Lock()
        self._process: Any = None
        self._pipe: Connection | None = None

    def start(self) -> None:
        """Start the process ahead of the first question."""
        with self._lock:
            self._running()

    def contents(self, path: Path, rate_hz: float | None = None) -> dict[str, Any]:
        """Times (s) of all frames, numbers of key frames, size in px. Raises InputError."""
        found: dict[str, Any] = self._ask(("contents", path, rate_hz))
        return found

    def frames(self, wanted: Wanted) -> list[tuple[int, bytes]]:
        """Number and JPEG of frames. Raises InputError."""
        found: list[tuple[int, bytes]] = self._ask(("frames", wanted))
        return found

    def marks(self, path: Path, numbers: list[int], settings: dict[str, Any], rate_hz: float | None) -> list[Any]:
        """What the search for marks sees in some frames, with settings as of tracking.toml. Raises InputError."""
        found: list[Any] = self._ask(("marks", path, rate_hz, numbers, settings))
        return found

    def image(self, path: Path) -> bytes:
        """An image file as JPEG. Raises InputError."""
        found: bytes = self._ask(("image", path))
        return found

    def dots(self, path: Path) -> dict[str, Any]:
        """The dots of a gauge image. Raises InputError."""
        found: dict[str, Any] = self._ask(("dots", path))
        return found

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._end()

    @property
    def process_id(self) -> int | None:
        """Of the running process."""
        return None if self._process is None else self._process.pid

    def _ask(self, question: tuple[Any, ...]) -> Any:
        with self._lock:
            pipe = self._running()
            try:
                pipe.send(question)
                if not pipe.poll(ANSWER_S):
                    self._end()
                    raise InputError("decoding this recording takes too long; convert it, for example to H.264")
                good, answer = pipe.recv()
            except (EOFError, OSError) as error:
                self._end()
                raise InputError(
                    "the decoder stopped at this recording: it is damaged; record or copy it again"
                ) from error
        if not good:
            raise InputError(answer)
        return answer

    def _running(self) -> Connection:
        if self._pipe is None or not self._process.is_alive():
            self._end()
            context = multiprocessing.get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(theirs,), daemon=True, name="turnscope decoder")
            self._process.start()
            theirs.close()
        return self._pipe

    def _end(self) -> None:
        if self._pipe is not None:
            self._pipe.close()
            self._process.kill()
            self._process.join()
        self._pipe = self._process = None


def _serve(pipe: Connection) -> None:
    """Answer questions until the other end is closed."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt from the terminal is for the studio
    opened: OrderedDict[tuple[Any, ...], Any] = OrderedDict()
    _preimport()
    while True:
        try:
            question = pipe.recv()
        except EOFError:
            return
        try:
            answer = True, _answer(opened, *question)
        except (InputError, CalibrationError) as error:
            answer = False, str(error)
        except Exception as error:  # noqa: BLE001 - any fault of a recording is told, and the next one is decoded
            answer = False, f"this recording cannot be decoded ({type(error).__name__}: {error})"
        pipe.send(answer)


def _preimport() -> None:
    import evaluator.recording.seek  # noqa: F401 - so that the first frame does not wait for it


def _answer(opened: OrderedDict[tuple[Any, ...], Any], kind: str, *rest: Any) -> Any:
    if kind == "contents":
        path, rate_hz = rest
        contents = _frames_of(opened, path, rate_hz).contents
        return {"time_s": contents.time_s, "key_frames": contents.key_frames, "size_px": contents.size_px}
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
    return [(number, _jpeg(frames.image(number), wanted.most_px)) for number in chosen]


def _frames_of(opened: OrderedDict[tuple[Any, ...], Any], path: Path, rate_hz: float | None) -> Any:
    """The frames of a recording, opened anew where the file is another by now."""
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


def _jpeg(image: Any, most_px: int) -> bytes:
    import cv2

    height, width = image.shape[:2]
    if 0 < most_px < width:
        image = cv2.resize(image, (most_px, max(1, round(height * most_px / width))), interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise InputError("a frame cannot be shown as JPEG")
    return bytes(data)
