"""Recordings decoded by FFmpeg (PyAV): files, and whatever else it opens."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import av

from evaluator.errors import InputError
from evaluator.recording.frame import Frame
from evaluator.recording.layout import Layout
from evaluator.recording.timing import TimingReport, summarise

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
        self.threads = 0  # of the decoder; 0: one per core
        self._reset()

    def _reset(self) -> None:
        self._ticks: list[int] = []
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
        """Decode; each frame's planes are views that live as long as the frame."""
        self._reset()
        with self._open() as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            stream.codec_context.thread_count = self.threads
            layout: Layout | None = None
            origin = None if container.format.name in STREAMED else 0
            sample: bytes = b""
            for picture in self._decoded(container, stream):
                ticks = self._ticks_of(picture)
                origin = ticks if origin is None else origin
                if layout is None or not layout.fits(picture):
                    layout = Layout.of(picture)
                frame = layout.frame(picture, len(self._ticks), ticks - origin, self.tick)
                # Every 37th row tells repeated pictures from new ones: sensor noise differs in each row, and 37 is
                # prime to block and field sizes, so that no codec skips just these rows.
                seen = frame.luma[18::37].tobytes()
                if seen == sample:
                    self._duplicates.append(frame.index)
                sample = seen
                self._ticks.append(frame.ticks)
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
                self._notes.append(f"the recording cannot be read beyond picture {len(self._ticks)} ({_reason(error)})")
                return
            try:
                pictures = packet.decode()
            except (av.error.FFmpegError, OSError) as error:
                note = f"damaged data near picture {len(self._ticks)} ({_reason(error)})"
                if not self._notes:
                    self._notes.append(note)
                continue
            for picture in pictures:
                if not picture.is_corrupt:
                    yield picture
                elif not self._notes:
                    self._notes.append(f"damaged pictures are left out, the first near picture {len(self._ticks)}")

    def _ticks_of(self, picture: Any) -> int:
        if picture.pts is not None:
            return int(picture.pts)
        if not self.nominal_rate:
            raise InputError(f"{self.name}: has neither presentation times nor a frame rate; put it into a container")
        if not self._ticks:
            self._notes.append(f"no presentation times in the file: taken from its rate {float(self.nominal_rate):g}/s")
            self.tick = 1 / Fraction(self.nominal_rate)
        return len(self._ticks)

    def _finish(self) -> None:
        count = len(self._ticks)
        if count == 0:
            raise InputError(f"{self.name}: not a single picture can be decoded; the file is damaged or cut off")
        if self.expected_frames > count:
            self._notes.append(f"the file promises {self.expected_frames} pictures but only {count} could be decoded")

    def report(self) -> TimingReport:
        """Sum up the times of the pictures decoded in the last iteration."""
        return summarise(self._ticks, self.tick, self._duplicates, self._notes)


def _reason(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error).split(":")[0].strip().lower()


def _kinds(container: Any) -> str:
    return ", ".join(sorted({stream.type for stream in container.streams})) or "no stream at all"
