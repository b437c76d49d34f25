"""Recordings decoded by FFmpeg (PyAV): files, devices and streams."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack
from fractions import Fraction
from typing import Any, Literal

import av

from evaluator.errors import InputError
from evaluator.recording.fields import Fields, field_order, fields_of
from evaluator.recording.frame import Frame
from evaluator.recording.groups import LONGEST, Groups
from evaluator.recording.layout import Layout
from evaluator.recording.parallel import decoded, decoders_for, first_packets, groups_for, threads_for
from evaluator.recording.streams import (
    Undiscarded,
    asked_of_viewers,
    has_decoding_times,
    is_sparse,
    starts_anywhere,
    videos_of,
)
from evaluator.recording.timing import TimingReport, clock_runs, in_order, summarise
from evaluator.wording import counted, verb

# Frames examined for torn edges: four seconds, in which a robot has moved. Their luma is stored, which limits the
# number of large frames; cameras that do not mark interlaced recordings as such have small ones.
PROBED, HELD_BYTES = 120, 100_000_000
SLOWEST_PROGRESSIVE = 31  # interlaced cameras record 25 or 29.97 frames a second; faster recordings are not examined
FIRST_PACKETS = 8  # packets whose times are examined for a running clock
# Tolerance of the stated number of frames, which may include the last frame and delays of sound and B-frames.
LACKING = 10
REORDERED = 16  # frames: most by which H.264 and HEVC may show a frame later than they decode it


class Recording:
    """Frames in presentation order with exact times; iterate as often as needed, `report` afterwards.

    Iteration raises InputError if no frame can be decoded. Of a file that is truncated or damaged, all decodable frames
    are returned, with a note in `report().notes`.
    """

    def __init__(
        self,
        name: str,
        *,
        live: bool = False,
        format_name: str | None = None,
        fields: Fields = "auto",
        threads: int = 0,
        rate_hz: Fraction | None = None,
    ) -> None:
        """Open the recording to check that it contains a video.

        name: a path, or an address for FFmpeg. live: return each frame immediately; only one iteration is possible.
        rate_hz: frames a second if the recording has no times; None for the stated rate.
        threads: of the decoder; 0: one per core; 1: only that of the caller.
        """
        self.name, self.live, self.fields, self._threads = name, live, fields, threads
        self._format, self._rate = format_name, rate_hz
        container = self._open()
        stream = videos_of(container)[0]
        self.size_px: tuple[int, int] = stream.width, stream.height
        sparse = is_sparse(container)
        self.nominal_rate: Fraction | None = (not sparse and stream.average_rate) or stream.guessed_rate
        self.expected_frames: int = 0 if sparse else stream.frames  # 0 if the container does not state it
        # The duration of a container is that of the frames only if it contains no other streams.
        alone = container.duration is not None and len(container.streams) == 1 and not live
        self.expected_s: float | None = container.duration / av.time_base if alone else None
        if sparse:  # FFmpeg shortens the duration of one that is cut off
            self.expected_s = float(stream.frames * stream.time_base)
        self.tick: Fraction = stream.time_base
        self._opened: Any = container
        self._packets: Undiscarded | None = None  # of the last iteration
        self._reset()

    def __repr__(self) -> str:
        """One line: the name, the size and the rate."""
        rate = "unknown rate" if self.nominal_rate is None else f"{float(self.nominal_rate):g} frames/s"
        return f"Recording({self.name}, {self.size_px[0]} × {self.size_px[1]} px, {rate})"

    def _reset(self) -> None:
        self._ticks: list[int] = []
        self._duplicates: list[int] = []
        self._notes: list[str] = []
        self._standing = 0  # omitted frames
        self._counted = False  # whether times are computed from frame numbers
        self.clock = self.tick

    def _open(self) -> Any:
        try:
            # No "nobuffer" for live sources: it drops the frames by which the format was detected.
            container = av.open(self.name, format=self._format)
        except (FileNotFoundError, IsADirectoryError, PermissionError) as error:
            raise InputError(f"{self.name}: {str(error.strerror).lower()}") from error
        except (av.error.FFmpegError, ValueError, OSError) as error:
            raise InputError(
                f"{self.name}: not a video that FFmpeg can open ({_reason(error)}); is it complete and of a known "
                "format?"
            ) from error
        if not container.streams.video:
            kinds = _kinds(container)
            container.close()
            raise InputError(f"{self.name}: holds no video, {kinds}; give a video file")
        if not videos_of(container):
            container.close()
            raise InputError(
                f"{self.name}: FFmpeg has no decoder for the codec of its video; convert it, for example to H.264"
            )
        return container

    def __iter__(self) -> Iterator[Frame]:
        """Decode; the planes of each frame are views that are valid as long as the frame exists."""
        self._reset()
        order, images = self.fields, self._images()
        if order == "auto":
            order, images = self._field_order(images)
        if order == "none":
            for frame in images:
                self._count(frame)
                yield frame
            return
        self._notes.append(f"interlaced, {order} field first: every field is treated as a frame")
        ticks = self._interval_ticks()
        for frame in images:
            for field in fields_of(frame, order, ticks, len(self._ticks)):
                self._count(field)
                yield field

    def _count(self, frame: Frame) -> None:
        self._ticks.append(frame.ticks)
        self.clock = frame.tick
        if frame.repeated:
            self._duplicates.append(frame.index)

    def _images(self) -> Iterator[Frame]:
        """Every frame of the recording, before the separation of fields."""
        container, self._opened = self._opened or self._open(), None
        with ExitStack() as opened:
            opened.enter_context(container)
            self._notes.extend(asked_of_viewers(container))
            first, images = self._under_way(container, opened)
            runs = clock_runs(first)
            layout: Layout | None = None
            origin = None if starts_anywhere(container) or self.live else 0
            most = REORDERED if has_decoding_times(container) else 1
            frame: Frame | None = None
            timed = ((image, self._ticks_of(image, k, runs=runs)) for k, image in enumerate(images))
            index, last = 0, None
            for image, ticks in timed if self.live else in_order(timed, most):
                if ticks is None or (last is not None and ticks <= last):
                    self._standing += 1
                    continue
                last, origin = ticks, ticks if origin is None else origin
                if layout is None:
                    self._notes.extend(_turned_by_viewers(image))
                if layout is None or not layout.fits(image):
                    layout = Layout.of(image, videos_of(container)[0].codec_context.name)
                frame = layout.frame(image, index, ticks - origin, self.tick, frame)
                index += 1
                yield frame
        self._finish(index, 0 if last is None or origin is None else last - origin)

    def _under_way(self, container: Any, opened: ExitStack) -> tuple[list[Any], Iterator[Any]]:
        """Choose the fastest decoding for the recording; return its first packets, and an iterator over all frames."""
        stream, threads = videos_of(container)[0], self._threads
        # Frame threads are fastest, but delay frames by one per thread, which is too long for a live source.
        stream.thread_type = "SLICE" if self.live else "AUTO"
        if self.live:
            stream.codec_context.thread_count = threads
            return [], self._decoded(container.demux(stream), [stream], None)
        self._packets = Undiscarded(container, stream)
        groups = groups_for(stream, threads)
        first, packets = first_packets(iter(self._packets), FIRST_PACKETS if groups is None else LONGEST + 1)
        if groups is not None and not groups.several(first):
            groups = None
        stream.codec_context.thread_count = threads_for(stream, threads, groups)
        again = range(1, decoders_for(stream, threads, groups))
        return first, self._decoded(packets, [stream, *(self._again(opened) for _ in again)], groups)

    def _field_order(self, images: Iterator[Frame]) -> tuple[Literal["none", "top", "bottom"], Iterator[Frame]]:
        """Field order of the recording as stated in the file, or determined from frames; and an iterator over all."""
        if self.live:
            return "none", images
        said, rate = self._said_order(), self.nominal_rate
        if said == "none" and (rate is None or rate > SLOWEST_PROGRESSIVE):
            return "none", images
        seen = deque[Frame]()

        def first() -> Iterator[Frame]:
            for frame in images:
                seen.append(frame)
                yield frame
                if len(seen) == PROBED or len(seen) * frame.luma.nbytes > HELD_BYTES:
                    return

        def every() -> Iterator[Frame]:
            while seen:
                yield seen.popleft()
            yield from images

        return field_order(first()) or said, every()

    def _said_order(self) -> Literal["none", "top", "bottom"]:
        # FFmpeg's AVFieldOrder: 2 and 5 mean that the top field is shown first, 3 and 4 the bottom field.
        self._opened = self._opened or self._open()
        order = int(getattr(videos_of(self._opened)[0].codec_context, "field_order", 0) or 0)
        return "top" if order in {2, 5} else "bottom" if order in {3, 4} else "none"

    def _interval_ticks(self) -> int:
        rate = self.nominal_rate or Fraction(30)
        return round(1 / (rate * self.tick))

    def _again(self, opened: ExitStack) -> Any:
        """Open the stream again, until the end of `opened`."""
        return videos_of(opened.enter_context(self._open()))[0]

    def _decoded(self, packets: Iterator[Any], streams: list[Any], groups: Groups | None) -> Iterator[Any]:
        """All decodable frames; ends with a note if reading fails."""
        results = decoded(packets, streams, at_once=self.live or self._threads == 1, groups=groups)
        given = 0
        while True:
            try:
                result = next(results)
            except StopIteration:
                return
            except (av.error.FFmpegError, OSError) as error:
                self._notes.append(f"the recording cannot be read beyond frame {given} ({_reason(error)})")
                return
            try:
                images = result()
            except (av.error.FFmpegError, OSError) as error:
                note = f"damaged data near frame {given} ({_reason(error)})"
                if not self._notes:
                    self._notes.append(note)
                continue
            for image in images:
                if not image.is_corrupt:
                    given += 1
                    yield image
                elif not self._notes:
                    self._notes.append(f"damaged frames are left out, the first near frame {given}")

    def _ticks_of(self, image: Any, count: int, *, runs: bool) -> int | None:
        """Presentation time of a frame in ticks, None if it has none; runs: whether the recording's clock runs."""
        if count == 0:
            self._counted = not runs or image.pts is None
            rate = self._rate or self.nominal_rate
            if self._counted and not rate:
                raise InputError(f"{self.name}: has neither time stamps nor a frame rate; give the rate")
            if self._counted and rate:
                self._notes.append(f"no presentation times in the file: taken from its rate {float(rate):g}/s")
                self.tick = 1 / rate
            elif self._rate:
                self._notes.append(f"the given rate {float(self._rate):g}/s is not used: the recording has times")
        return count if self._counted else image.pts

    def _finish(self, count: int, last: int) -> None:
        if count == 0:
            raise InputError(f"{self.name}: no frame can be decoded; the file is damaged or truncated")
        if self._standing > count:
            raise InputError(
                f"{self.name}: presentation times stand still or run backwards in {self._standing} of"
                f" {counted(self._standing + count, 'frame')};"
                " record it anew, or write it into a container with a frame rate"
            )
        if self._standing:
            said = f"{counted(self._standing, 'frame')} {verb(self._standing, 'is', 'are')} left out"
            self._notes.append(f"{said}: their times are not after those before them")
        if self.expected_frames > count + self.left_out_frames:
            self._notes.append(
                f"the file announces {counted(self.expected_frames, 'frame')} but only {count} could be decoded"
            )
        last_s, rate = float(last * self.tick), self.nominal_rate
        if not self.expected_frames and self.expected_s and rate and (self.expected_s - last_s) * rate > LACKING:
            self._notes.append(
                f"the file announces {self.expected_s:.4g} s, but the last frame that could be decoded is at"
                f" {last_s:.4g} s"
            )

    @property
    def left_out_frames(self) -> int:
        """Frames of the file that the last iteration left out: cut away by an edit list, or at a standing time."""
        return self._standing + (self._packets.discarded if self._packets else 0)

    def report(self) -> TimingReport:
        """Summary of the times of the last iteration."""
        return summarise(self._ticks, self.clock, self._duplicates, self._notes)


def _reason(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error).split(":")[0].strip().lower()


def _turned_by_viewers(image: Any) -> list[str]:
    """Notes on rotations by viewers that are not applied here, because pixels are those of the sensor."""
    turn = abs(round(image.rotation))
    return [f"players rotate this video by {turn}°; it is measured as recorded by the sensor"] if turn else []


def _kinds(container: Any) -> str:
    kinds = sorted({stream.type for stream in container.streams})
    return f"only {', '.join(kinds)}" if kinds else "no stream of any kind"
