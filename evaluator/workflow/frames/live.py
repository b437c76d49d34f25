"""A live camera in a separate process: the current frame with the gauge found in it, and captured images."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evaluator.errors import InputError
from evaluator.workflow.frames.child import Child

ANSWER_S = 60.0  # cameras take seconds to open, and on a busy machine their process took 18 s to start
SOON_S = 1.0  # timeout of the detection of dots, which usually takes a tenth; the preview continues without them
FIRST_FRAME_S = 10.0  # cameras take seconds to open
IDLE_S = 10.0  # time without requests after which the camera is released for other programs
MOST_PX = 1280  # of the preview
NOTHING: dict[str, Any] = {
    "centers_px": [],
    "of_array": [],
    "light": "",
    **dict.fromkeys(("sigma_px", "blur_px", "diameter_px")),
}


@dataclass(frozen=True)
class LiveSource:
    """name: number or device of a camera, or a file in place of one; size ("640x480"), rate, pixels: requested mode."""

    name: str
    size: str | None = None
    rate: float | None = None
    pixels: str | None = None


def cameras_here() -> list[dict[str, str]]:
    """Cameras that the operating system lists: name for `LiveSource`, and a readable name."""
    if not sys.platform.startswith("linux"):
        return [{"name": str(number), "words": f"camera {number}"} for number in range(3)]
    found = []
    for device in sorted(Path("/sys/class/video4linux").glob("video*")):
        try:
            words = (device / "name").read_text(encoding="utf-8", errors="replace").strip()
        except OSError:
            words = "camera"
        found.append({"name": f"/dev/{device.name}", "words": f"{words} ({device.name})"})
    return found


class LiveCamera:
    """One camera at a time; it is released after a while without requests, and opened again by the next."""

    def __init__(self) -> None:
        """No camera is opened yet."""
        self._lock = threading.Lock()
        self._source: LiveSource | None = None
        self._child: Child | None = None

    def look(self, source: LiveSource) -> tuple[bytes, dict[str, Any]]:
        """The current frame of a camera as JPEG, and the gauge found in it, as from `gauge_in`. Raises InputError.

        late: the frame has no dots, because their detection takes longer than SOON_S.
        """
        with self._lock:
            child = self._of(source)
        shown: tuple[bytes, dict[str, Any]] = child.ask("look")
        return shown

    def take(self, source: LiveSource, path: Path) -> None:
        """Write the image that was shown last, without loss (.png). Raises InputError."""
        with self._lock:
            child = self._of(source)
        child.ask("take", path)

    def close(self) -> None:
        """Release the camera."""
        with self._lock:
            if self._child is not None:
                self._child.close()
            self._child = self._source = None

    def _of(self, source: LiveSource) -> Child:
        if self._child is None or source != self._source:
            if self._child is not None:
                self._child.close()
            slow = f"{source.name}: the camera does not respond; disconnect and reconnect it"
            died = f"{source.name}: the camera stopped; is it still connected?"
            self._child, self._source = Child(_answers, (source,), ANSWER_S, slow, died, IDLE_S), source
        return self._child


def _answers(source: LiveSource) -> Callable[..., Any]:
    """The function that answers requests, in the process."""
    return _Bench(source).answer


class _Bench:
    """The camera, its latest frame, and the frame that was shown last."""

    def __init__(self, source: LiveSource) -> None:
        self._source = source
        self._new = threading.Condition()
        self._latest: Any = None
        self._ended = False
        self._shown: Any = None
        self._thread: threading.Thread | None = None
        self._finder = ThreadPoolExecutor(1)
        self._finding: Future[dict[str, Any]] | None = None
        self._looked_at: Any = None

    def answer(self, kind: str, *rest: Any) -> Any:
        """Answer "look" or "take"."""
        if self._thread is None:
            self._open()
        if kind == "take":
            from evaluator.files import write_image

            write_image((self._shown or self._newest()).to_rgb(), *rest)
            return None
        return self._look()

    def _look(self) -> tuple[bytes, dict[str, Any]]:
        from evaluator.workflow.frames.decoder import jpeg

        if self._finding is None:
            self._looked_at = self._newest()
            self._finding = self._finder.submit(_gauge_of, self._looked_at)
        late = not wait([self._finding], SOON_S).done
        self._shown = self._newest() if late else self._looked_at
        found = NOTHING
        if not late:
            done, self._finding = self._finding, None
            found = done.result()
        image = _bgr(self._shown)
        return jpeg(image, MOST_PX), {**found, "size_px": [image.shape[1], image.shape[0]], "late": late}

    def _newest(self) -> Any:
        """A frame that was not shown yet; the last one if there are no more."""
        with self._new:
            self._new.wait_for(lambda: self._ended or self._latest is not self._shown, FIRST_FRAME_S)
            if self._latest is None:
                raise InputError(f"{self._source.name}: delivers no frames")
            return self._latest

    def _open(self) -> None:
        from evaluator.capture.source import Camera

        source = self._source
        camera = Camera(source.name, size=source.size, rate=source.rate, pixels=source.pixels)
        self._thread = threading.Thread(target=self._follow, args=(camera,), daemon=True)
        self._thread.start()

    def _follow(self, camera: Any) -> None:
        """Keep the latest frame. A file is read in real time, like a camera."""
        from evaluator.recording.layout import Layout

        layout, began, paced = None, None, Path(self._source.name).is_file()
        for arrival in camera:
            for image in arrival.frames:
                if layout is None or not layout.fits(image):
                    layout = Layout.of(image)
                if paced and image.time is not None:
                    began = time.perf_counter() - image.time if began is None else began
                    time.sleep(max(0.0, began + image.time - time.perf_counter()))
                with self._new:
                    self._latest = layout.frame(image, 0, image.pts or 0, image.time_base, None)
                    self._new.notify_all()
        with self._new:
            self._ended = True
            self._new.notify_all()


def _gauge_of(frame: Any) -> dict[str, Any]:
    from evaluator.workflow.viewing.cameras import gauge_in

    return gauge_in(_bgr(frame))


def _bgr(frame: Any) -> Any:
    return frame.to_rgb()[..., ::-1].copy()
