"""Recordings decoded by FFmpeg (PyAV): files, and whatever else it opens."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import av
import numpy as np

from evaluator.errors import InputError
from evaluator.recording.frame import Frame, Plane
from evaluator.recording.timing import TimingReport, summarise

# Planar formats whose planes are used as they are: name without depth suffix.
PLANAR = ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "yuv440p", "yuv411p", "yuv410p")
STREAMED = ("mpegts", "mpeg")  # containers whose clock starts anywhere: their times count from the first picture


class Recording:
    """Pictures in presentation order with exact times; iterate as often as needed, `report` afterwards.

    Raises InputError when iterated where not a single picture can be decoded. A file that ends early or is damaged
    gives its good pictures, and `report().notes` says so.
    """

    def __init__(self, name: str, *, options: dict[str, str] | None = None, format_name: str | None = None) -> None:
        """Open once to see that there is a video in it. name: a path, or an address FFmpeg understands."""
        self.name = name
        self._options, self._format = options or {}, format_name
        with self._open() as container:
            stream = container.streams.video[0]
            self.nominal_rate: Fraction | None = stream.average_rate or stream.guessed_rate
            self.expected_frames: int = stream.frames  # 0 where the container does not say
            self.tick: Fraction = stream.time_base
        self._reset()

    def _reset(self) -> None:
        self._times: list[Fraction] = []
        self._duplicates: list[int] = []
        self._notes: list[str] = []

    def _open(self) -> Any:
        try:
            container = av.open(self.name, format=self._format, options=self._options)
        except (FileNotFoundError, IsADirectoryError, PermissionError) as error:
            raise InputError(f"{self.name}: {str(error.strerror).lower()}") from error
        except (av.error.FFmpegError, ValueError, OSError) as error:
            raise InputError(
                f"{self.name}: not a video that FFmpeg can open ({_reason(error)}); is it whole and of a known format?"
            ) from error
        if not container.streams.video:
            container.close()
            raise InputError(f"{self.name}: holds no video, only {_kinds(container)}; give a video file")
        return container

    def __iter__(self) -> Iterator[Frame]:
        """Decode with all threads; each frame's planes are views that live as long as the frame."""
        self._reset()
        with self._open() as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            origin: Fraction | None = None if container.format.name in STREAMED else Fraction(0)
            sample: bytes = b""
            for picture in self._decoded(container, stream):
                time = self._time(picture)
                origin = time if origin is None else origin
                frame = frame_of(picture, len(self._times), time - origin)
                # Every 37th row tells repeated pictures from new ones: sensor noise differs in each row, and 37 is
                # prime to block and field sizes, so that no codec skips just these rows.
                seen = frame.luma[18::37].tobytes()
                if seen == sample:
                    self._duplicates.append(frame.index)
                sample = seen
                self._times.append(frame.time)
                yield frame
        self._finish()

    def _decoded(self, container: Any, stream: Any) -> Iterator[Any]:
        """Every picture that decodes; stops, with a note, where nothing more can be read."""
        packets = container.demux(stream)
        while True:
            try:
                packet = next(packets)
            except StopIteration:
                return
            except (av.error.FFmpegError, OSError) as error:
                self._notes.append(f"the recording cannot be read beyond picture {len(self._times)} ({_reason(error)})")
                return
            try:
                pictures = packet.decode()
            except (av.error.FFmpegError, OSError) as error:
                note = f"damaged data near picture {len(self._times)} ({_reason(error)})"
                if not self._notes:
                    self._notes.append(note)
                continue
            for picture in pictures:
                if not picture.is_corrupt:
                    yield picture
                elif not self._notes:
                    self._notes.append(f"damaged pictures are left out, the first near picture {len(self._times)}")

    def _time(self, picture: Any) -> Fraction:
        if picture.pts is not None:
            return Fraction(picture.pts * picture.time_base.numerator, picture.time_base.denominator)
        if not self.nominal_rate:
            raise InputError(f"{self.name}: has neither presentation times nor a frame rate; put it into a container")
        if not self._times:
            self._notes.append(f"no presentation times in the file: taken from its rate {float(self.nominal_rate):g}/s")
        return len(self._times) / Fraction(self.nominal_rate)

    def _finish(self) -> None:
        count = len(self._times)
        if count == 0:
            raise InputError(f"{self.name}: not a single picture can be decoded; the file is damaged or cut off")
        if self.expected_frames > count:
            self._notes.append(f"the file promises {self.expected_frames} pictures but only {count} could be decoded")

    def report(self) -> TimingReport:
        """Sum up the times of the pictures decoded in the last iteration."""
        return summarise(self._times, self._duplicates, self.tick, self._notes)


def frame_of(picture: Any, index: int, time: Fraction) -> Frame:
    """Take the planes of a decoded picture, turned upright, without copying where the format allows."""
    depth = picture.format.components[0].bits
    base = picture.format.name.split("p1")[0] + "p" if depth > 8 else picture.format.name
    grey = picture.format.name.startswith(("gray", "mono"))
    if not (base in PLANAR or (grey and depth in (8, 10, 12, 16))) or picture.format.name.endswith("be"):
        # RGB, palettes, packed and big-endian formats: full range, no subsampling, so that nothing is lost.
        target = ("gray16le" if depth > 8 else "gray") if grey else ("yuv444p16le" if depth > 8 else "yuvj444p")
        picture = picture.reformat(format=target, dst_color_range="JPEG")
        depth = 16 if depth > 8 else 8
    turns = round(picture.rotation / 90) % 4
    planes = [_plane(plane, 2 if depth > 8 else 1, turns) for plane in picture.planes]
    full = grey or picture.format.name.startswith("yuvj") or picture.color_range == 2
    matrix = "bt709" if picture.colorspace == 1 else "bt601"
    u, v = (planes[1], planes[2]) if len(planes) >= 3 else (None, None)
    return Frame(index, time, planes[0], u, v, depth, full, matrix, 0, 1, picture)


def _plane(plane: Any, item: int, turns: int) -> Plane:
    height, width, line = plane.height, plane.width, plane.line_size // item
    flat = np.frombuffer(plane, np.uint8 if item == 1 else np.uint16)
    view = np.lib.stride_tricks.as_strided(flat, (height, width), (line * item, item), writeable=False)
    return np.rot90(view, turns) if turns else view


def _reason(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error).split(":")[0].strip().lower()


def _kinds(container: Any) -> str:
    return ", ".join(sorted({stream.type for stream in container.streams})) or "no stream at all"
