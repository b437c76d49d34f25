"""Record from a camera: frames, their times, and the start of the motors."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evaluator.capture.clock import MICRO, CaptureClock, ClockReport
from evaluator.capture.light import LightRegion, light_on
from evaluator.capture.source import Arrival, Camera
from evaluator.capture.start import Ready, Signal
from evaluator.capture.writer import TICK, Writer
from evaluator.errors import InputError
from evaluator.files import write_text
from evaluator.progress import Cancelled, Progress, no_progress
from evaluator.recording import Frame
from evaluator.recording.layout import Layout
from evaluator.wording import counted, verb

LOOK_EVERY_S = 1.0  # for a person who moves a lamp or a mask
REST_S = 0.5  # recorded before the start of the motors, because the report needs the robot at rest


@dataclass(frozen=True)
class CaptureStart:
    """Start signal of the motors: a light in view, or another signal. exposure_s: of a frame, if known."""

    light: LightRegion | None = None
    exposure_s: float | None = None
    signal: Signal | None = None
    rest_s: float = REST_S


@dataclass(frozen=True)
class Captured:
    """A finished recording: its file (None if nothing was written), its times, and the start, s in the recording.

    start_s, start_sigma_s: NaN if none was requested or received; start_note is then the reason.
    """

    path: Path | None
    clock: ClockReport
    start_s: float = math.nan
    start_sigma_s: float = math.nan
    start_note: str = ""

    def sentences(self) -> tuple[str, ...]:
        """Notes on the recording."""
        clock = self.clock
        rate = 1 / clock.interval_s if clock.interval_s else math.nan
        whose = "of the camera; they arrived" if clock.source == "camera" else "of arrival, which scatter"
        lost = f"{counted(clock.dropped, 'frame')} {verb(clock.dropped, 'was', 'were')} dropped"
        said = [f"{counted(clock.frames, 'frame')} at {rate:.4g}/s; {lost if clock.dropped else 'none was dropped'}"]
        if math.isfinite(clock.jitter_s):
            scatter = "with a scatter of" if clock.source == "camera" else "by"
            said.append(f"times are those {whose} {scatter} {1000 * clock.jitter_s:.2g} ms (1 sigma)")
        if math.isfinite(self.start_s):
            said.append(f"start_s = {self.start_s:.4f}, known to {1000 * self.start_sigma_s:.2g} ms (1 sigma)")
        elif self.start_note:
            said.append(f"start not known: {self.start_note}")
        return tuple(said)


@dataclass
class _Under:
    """A recording in progress."""

    start: CaptureStart
    clock: CaptureClock = field(default_factory=CaptureClock)
    brightness: list[float] = field(default_factory=list)
    layout: Layout | None = None
    latest: Frame | None = None

    def take(self, arrival: Arrival) -> tuple[int | None, ...]:
        """Add the frames of an arrival; return their times in microseconds."""
        times = []
        for image in arrival.frames:
            stamp = None if image.pts is None or image.time_base is None else float(image.pts * image.time_base)
            time_us = self.clock.add(stamp, arrival.arrived_s)
            times.append(time_us)
            if time_us is not None:
                self._look(image, time_us)
        return tuple(times)

    def _look(self, image: Any, time_us: int) -> None:
        if self.layout is None or not self.layout.fits(image):
            self.layout = Layout.of(image)
        self.latest = self.layout.frame(image, len(self.clock.times_s) - 1, time_us, TICK, None)
        if self.start.light is not None:
            self.brightness.append(self.start.light.brightness(self.latest))


def record_camera(
    source: str | Path,
    out: Path | str | None,
    *,
    seconds: float | None = None,
    size: str | None = None,
    rate: float | None = None,
    pixels: str | None = None,
    start: CaptureStart | None = None,
    watch: Callable[[Frame], str] | None = None,
    progress: Progress = no_progress,
) -> Captured:
    """Record until `seconds` have passed, the source ends, or the progress cancels; the file is complete in all cases.

    source: number or device of a camera, an address, or a file in place of one. out: a new .mp4; None records nothing,
    to inspect the camera. Streams compressed by the camera (MJPEG, H.264) are stored unchanged, others without loss.
    NAME.capture.json beside the file contains the quality of its times and its start.
    watch: called with a frame about once a second; returns a short description of it for the progress.
    Raises InputError if the source has no frames or the file cannot be written.
    """
    wanted = start or CaptureStart()
    path = None if out is None else Path(out)
    signal = Ready() if wanted.signal is None else wanted.signal()
    under = _Under(wanted)
    paced = wanted.signal is not None  # the time of a signal means nothing in a file that is read at once
    with closing(Camera(str(source), size=size, rate=rate, pixels=pixels, paced=paced)) as camera:
        opened = nullcontext() if path is None else Writer(path, camera.stream)
        with opened as writer, closing(_Observer(watch)) as observer:
            try:
                _run(camera, writer, under, seconds, signal.send, observer, progress)
            except (Cancelled, KeyboardInterrupt):
                if not under.clock.times_s:
                    raise
    if not under.clock.times_s:
        raise InputError(f"{source}: delivered no frames")
    result = _captured(path, under, signal)
    if path is not None:
        clock = {"times_from": result.clock.source, **asdict(result.clock)}
        content = {"format": 1, "video": path.name, **clock, "source": str(source)}
        if math.isfinite(result.start_s):
            content |= {"start_s": result.start_s, "start_sigma_s": result.start_sigma_s}
        write_text(path.with_suffix(".capture.json"), json.dumps(content, indent=1) + "\n")
    return result


def _run(
    camera: Camera,
    writer: Writer | None,
    under: _Under,
    seconds: float | None,
    send: Callable[[], None],
    observer: _Observer,
    progress: Progress,
) -> None:
    """Add frames until the time has passed or the source ends."""
    shown = -math.inf
    for arrival in camera:
        times_us = under.take(arrival)
        if writer is not None:
            first_s = under.clock.arrivals_s[0] if under.clock.arrivals_s else arrival.arrived_s
            writer.write(arrival.packet, arrival.frames, times_us, round((arrival.arrived_s - first_s) * MICRO))
        if not under.clock.times_s:
            continue
        passed = under.clock.times_s[-1] - under.clock.times_s[0]
        if passed >= under.start.rest_s:
            send()
        if arrival.arrived_s - shown > LOOK_EVERY_S:
            shown = arrival.arrived_s
            dropped = f"{under.clock.report().dropped} dropped"
            progress(
                "; ".join(filter(None, ["recording", observer.look(under.latest), dropped])), passed, seconds or 0.0
            )
        if seconds is not None and passed >= seconds:
            return


class _Observer:
    """Observes frames in a thread from time to time, so that the recording need not wait."""

    def __init__(self, watch: Callable[[Frame], str] | None) -> None:
        self._watch = watch
        self._thread = ThreadPoolExecutor(1)
        self._looking: Future[str] | None = None
        self._saw = ""

    def look(self, frame: Frame | None) -> str:
        """The last description; starts the next observation unless one is in progress."""
        if self._looking is not None and self._looking.done():
            self._saw, self._looking = self._looking.result(), None
        if self._watch is not None and frame is not None and self._looking is None:
            self._looking = self._thread.submit(self._watch, frame)
        return self._saw

    def close(self) -> None:
        """End, without an observation that has not begun."""
        self._thread.shutdown(wait=True, cancel_futures=True)


def _captured(path: Path | None, under: _Under, signal: Ready) -> Captured:
    """The finished recording, with the requested start."""
    clock = under.clock.report()
    if under.start.light is not None:
        times = np.array(under.clock.times_s) - under.clock.times_s[0]
        try:
            found = light_on(times, np.array(under.brightness), under.start.exposure_s)
        except InputError as error:
            return Captured(path, clock, start_note=str(error))
        return Captured(path, clock, *found)
    fault, moment_s = signal.fault(), signal.moment()
    if moment_s is not None and not fault:
        return Captured(path, clock, *under.clock.in_recording(moment_s))
    return Captured(path, clock, start_note=fault or ("no start signal" if under.start.signal else ""))
