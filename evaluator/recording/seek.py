"""Exact access to any frame of a recording by its number, with the same result as iteration.

If the container states the presentation time of every packet, a frame is decoded from the key frame before it and
identified by its time. All other recordings (fields, missing times, damaged data) are decoded from the beginning.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.recording.frame import Frame
from evaluator.recording.images import ImageSequence
from evaluator.recording.layout import Layout
from evaluator.recording.open import has_no_clock, open_recording
from evaluator.recording.streams import starts_anywhere, videos_of
from evaluator.recording.video import Recording

Image = NDArray[np.uint8]
CACHE_BYTES = 160_000_000  # of decoded frames: a group of 250 at 640 x 480, two of 12 at 1920 x 1080
AHEAD = 60  # frames up to which decoding on is as fast as seeking


class CannotSeekError(Exception):
    """Frames cannot be identified by their times; decode from the beginning."""


@dataclass(frozen=True)
class Contents:
    """Contents of a recording: time of every frame, s; numbers of key frames; (width, height) in px."""

    time_s: tuple[float, ...]
    key_frames: tuple[int, ...]
    size_px: tuple[int, int]


class Frames:
    """The frames of one recording by number; decoded ones are cached up to CACHE_BYTES. Not thread-safe."""

    def __init__(self, path: Path, rate_hz: float | None = None) -> None:
        """Open a recording and list its frames. Raises InputError."""
        self._path, self._rate = path, rate_hz
        self._cache: OrderedDict[int, Any] = OrderedDict()
        self._bytes = 0
        self._source: _Seeking | _Sequential
        try:
            self._source = _Seeking(path, rate_hz)
        except CannotSeekError:
            self._source = _Sequential(path, rate_hz)

    @property
    def contents(self) -> Contents:
        """Times, key frames and size."""
        return self._source.contents

    def key_frame(self, index: int) -> int:
        """The key frame at or before a frame."""
        keys = self.contents.key_frames
        return keys[max(bisect_right(keys, index) - 1, 0)]

    def close(self) -> None:
        """Close the file and clear the cache."""
        self._source.close()
        self._cache.clear()

    def image(self, index: int) -> Image:
        """Frame number index, (height, width, 3) BGR. Raises InputError if there is none."""
        image = self._image(index)
        return self._source.to_image(image)

    def frame(self, index: int) -> Frame:
        """Frame `index` as given by iteration. Raises InputError if there is none."""
        image = self._image(index)
        return self._source.to_frame(image, index)

    def _image(self, index: int) -> Any:
        count = len(self.contents.time_s)
        if not 0 <= index < count:
            raise InputError(f"{self._path.name}: there is no frame {index}; it has {count}")
        if index not in self._cache:
            try:
                self._decode(index)
            except CannotSeekError:
                self._source.close()
                self._source = _Sequential(self._path, self._rate)
                self._cache.clear()
                self._bytes = 0
                return self._image(min(index, len(self.contents.time_s) - 1))
        self._cache.move_to_end(index)
        return self._cache[index]

    def _decode(self, index: int) -> None:
        for number, image in self._source.until(index):
            if number not in self._cache:
                self._cache[number] = image
                self._bytes += self._source.frame_bytes
            while self._bytes > CACHE_BYTES and len(self._cache) > 1:
                self._cache.popitem(last=False)
                self._bytes -= self._source.frame_bytes


class _Seeking:
    """Frames identified by the times in the container."""

    def __init__(self, path: Path, rate_hz: float | None) -> None:
        self._path = path
        self._container: Any = None
        self._images: Iterator[Any] = iter(())
        self._next = -1  # number of the next frame of _images; -1: none
        if has_no_clock(path) or not _frames_are_whole(path, rate_hz):
            raise CannotSeekError
        self._open()
        self._list()

    def _open(self) -> None:
        try:
            self._container = av.open(str(self._path))
        except (av.error.FFmpegError, OSError) as error:
            raise InputError(f"{self._path.name}: cannot be opened") from error
        self._stream = videos_of(self._container)[0]
        self._stream.thread_type = "AUTO"

    def _list(self) -> None:
        """Read the times of all packets without decoding them."""
        packets = [p for p in self._container.demux(self._stream) if p.size]
        shown = [p for p in packets if not p.is_discard and not p.is_corrupt]
        if not shown or any(p.pts is None or p.dts is None for p in shown):
            raise CannotSeekError
        self._ticks = sorted({p.pts for p in shown})
        if len(self._ticks) < len(shown):
            raise CannotSeekError  # several frames have the same time: decoding decides which one is used
        self._numbers = {ticks: number for number, ticks in enumerate(self._ticks)}
        keys = sorted((self._numbers[p.pts], p.dts) for p in shown if p.is_keyframe)
        if not keys or keys[0][0] != 0:
            raise CannotSeekError
        self._seek_to = dict(keys)
        self._origin = origin = self._ticks[0] if starts_anywhere(self._container) else 0
        tick = self._stream.time_base
        times = tuple((t - origin) * tick.numerator / tick.denominator for t in self._ticks)
        image = self._first()
        self.frame_bytes = image.width * image.height * 3 // 2
        self.contents = Contents(times, tuple(number for number, _ in keys), (image.width, image.height))

    def _first(self) -> Any:
        self._container.seek(self._seek_to[0], stream=self._stream)
        image = next(iter(self._container.decode(self._stream)), None)
        if image is None or image.pts != self._ticks[0]:
            raise CannotSeekError
        return image

    def close(self) -> None:
        self._images = iter(())  # breaks a reference cycle, which would keep decoded frames until a garbage collection
        if self._container is not None:
            self._container.close()

    def until(self, index: int) -> Iterator[tuple[int, Any]]:
        """Decode up to a frame, from the current position or from the key frame before; yield all frames in between."""
        keys = self.contents.key_frames
        first = bisect_right(keys, index) - 1
        ahead = index - self._next
        if self._next < 0 or not (0 <= ahead < AHEAD and (self._next >= keys[first] or ahead < AHEAD // 4)):
            self._seek(first)
        while True:
            image = next(self._images, None)
            number = None if image is None else self._numbers.get(image.pts)
            if image is None or image.is_corrupt or number != self._next:
                self._next = -1
                raise CannotSeekError
            self._next += 1
            yield number, image
            if number == index:
                return

    def _seek(self, first: int) -> None:
        """Seek to a key frame, or to an earlier one if the container seeks past it."""
        for place in range(first, -1, -1):
            number = self.contents.key_frames[place]
            try:
                self._container.seek(self._seek_to[number], stream=self._stream)
                decoded = self._container.decode(self._stream)
                # Frames shown before the key frame depend on skipped ones.
                self._images = (p for p in decoded if p.pts is None or p.pts >= self._ticks[number])
                head = next(self._images, None)
            except (av.error.FFmpegError, OSError) as error:
                raise CannotSeekError from error
            if head is not None and head.pts == self._ticks[number] and head.key_frame:
                self._images = _before(head, self._images)
                self._next = number
                return
        raise CannotSeekError

    def to_image(self, image: Any) -> Image:
        bgr: Image = image.to_ndarray(format="bgr24")
        return bgr

    def to_frame(self, image: Any, index: int) -> Frame:
        layout = Layout.of(image)
        return layout.frame(image, index, self._ticks[index] - self._origin, self._stream.time_base, None)


class _Sequential:
    """Frames in the order of the recording, decoded from its beginning if an earlier one is requested."""

    def __init__(self, path: Path, rate_hz: float | None) -> None:
        self._recording: Recording | ImageSequence = open_recording(path, rate_hz=rate_hz, threads=0)
        times, size = [], (0, 0)
        for frame in self._recording:
            times.append(frame.time_s)
            size = frame.size_px
        if not times:
            raise InputError(f"{path.name}: no frame can be decoded; the file is damaged or truncated")
        self.frame_bytes = size[0] * size[1] * 3
        self.contents = Contents(tuple(times), (0,), size)
        self._frames: Iterator[Any] = iter(())
        self._next = len(times)

    def close(self) -> None:
        self._frames = iter(())

    def until(self, index: int) -> Iterator[tuple[int, Any]]:
        if index < self._next:
            self._frames, self._next = iter(self._recording), 0
        for frame in self._frames:
            self._next = frame.index + 1
            if frame.index > index - AHEAD:  # recent frames are needed for a step back
                yield frame.index, frame
            if frame.index == index:
                return
        raise InputError("the recording became shorter after it was opened; open it again")

    def to_image(self, image: Any) -> Image:
        return np.asarray(cv2.cvtColor(image.to_rgb(), cv2.COLOR_RGB2BGR), np.uint8)

    def to_frame(self, image: Any, index: int) -> Frame:
        del index
        frame: Frame = image
        return frame


def _frames_are_whole(path: Path, rate_hz: float | None) -> bool:
    """Whether iteration yields whole frames with times in the file, rather than fields or counted frames."""
    recording = open_recording(path, rate_hz=rate_hz, threads=0)
    first = next(iter(recording), None)
    return first is not None and first.row_step == 1 and not isinstance(recording, ImageSequence)


def _before(first: Any, others: Iterator[Any]) -> Iterator[Any]:
    yield first
    yield from others
