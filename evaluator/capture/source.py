"""Cameras and other live sources of FFmpeg: packets with their time of arrival."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av

from evaluator.errors import InputError

# FFmpeg's formats for the cameras of a system, and options that select one.
SYSTEM = {"linux": ("v4l2", "/dev/video{}"), "darwin": ("avfoundation", "{}"), "win32": ("dshow", "video={}")}


@dataclass(frozen=True)
class Arrival:
    """A packet, the frames that it completed, and when it arrived (time.perf_counter, s)."""

    packet: Any
    frames: tuple[Any, ...]
    arrived_s: float


class Camera:
    """An opened source; iterate once."""

    def __init__(
        self,
        name: str,
        *,
        size: str | None = None,
        rate: float | None = None,
        pixels: str | None = None,
        paced: bool = False,
    ) -> None:
        """Open a source.

        name: number of a camera of this system, a device, an address or a file. size ("640x480"), rate (frames/s),
        pixels ("mjpeg", "yuyv422"): requested mode. paced: a file delivers its frames at their times, as a camera does,
        and not as fast as it can be read. Raises InputError if it cannot be opened or has no video.
        """
        self.name = name
        place, form = _place(name)
        asked = {"video_size": size, "framerate": None if rate is None else f"{rate:g}"}
        options = {key: value for key, value in asked.items() if value} if form else {}
        if form and pixels:
            options["input_format" if form == "v4l2" else "pixel_format"] = pixels
        try:
            self._container = av.open(place, format=form, options=options)
        except (av.error.FFmpegError, OSError, ValueError) as error:
            reason = str(getattr(error, "strerror", None) or error).lower()
            raise InputError(
                f"{name}: cannot be opened as a camera or a stream ({reason}); is it plugged in, free, and able to "
                "give this size, rate and pixel format?"
            ) from error
        if not self._container.streams.video:
            self._container.close()
            raise InputError(f"{name}: gives no video")
        self.stream: Any = self._container.streams.video[0]
        self.stream.thread_type = "SLICE"  # frame threads would delay frames
        self._paced = paced and Path(name).is_file()
        self._begun: tuple[float, float] | None = None  # time of the first packet, by the computer and by its stamp

    def __iter__(self) -> Iterator[Arrival]:
        """Packets until the source ends or cannot be read."""
        packets = self._container.demux(self.stream)
        while True:
            try:
                packet = next(packets)
                if self._paced and packet.dts is not None:
                    self._wait(float(packet.dts * packet.time_base))
                arrived = time.perf_counter()
                yield Arrival(packet, tuple(packet.decode()), arrived)
            except StopIteration:
                return
            except av.error.InvalidDataError:
                continue  # a damaged packet is a lost frame, which is visible as a gap of times
            except (av.error.FFmpegError, OSError):
                return  # unplugged: the recording up to now is complete

    def _wait(self, stamp_s: float) -> None:
        """Wait until a packet is due that has this time stamp."""
        if self._begun is None:
            self._begun = time.perf_counter(), stamp_s
        since_s, first_s = self._begun
        time.sleep(max(since_s + stamp_s - first_s - time.perf_counter(), 0.0))

    def close(self) -> None:
        """Release the camera."""
        self._container.close()


def _place(name: str) -> tuple[str, str | None]:
    """Name and format of a source for FFmpeg."""
    form, pattern = SYSTEM.get(sys.platform, SYSTEM["linux"])
    if name.isdecimal():
        return pattern.format(name), form
    if name.startswith("/dev/") and not Path(name).exists():
        raise InputError(f"{name}: no such camera; is it connected?")
    return name, form if name.startswith("/dev/video") or Path(name).is_char_device() else None
