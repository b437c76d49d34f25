"""Selection of the video stream of a file, and properties that are stated only in its container."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from av.stream import Disposition

from evaluator.wording import counted

# Containers whose clock starts at any time. AVI has times of decoding only, which FFmpeg shifts by a frame for H.264.
STREAMED = ("mpegts", "mpeg", "avi")


def videos_of(container: Any) -> list[Any]:
    """Video streams for which FFmpeg has a decoder, the recording first.

    Files may also contain previews and cover images: the recording is the stream with the most pixels, as in FFmpeg's
    command, that is not a cover.
    """
    videos = [stream for stream in container.streams.video if stream.codec_context is not None]
    return sorted(videos, key=lambda stream: (_is_cover(stream), -stream.width * stream.height))


def _is_cover(stream: Any) -> bool:
    return bool(stream.disposition & Disposition.attached_pic)


def has_decoding_times(container: Any) -> bool:
    """Whether FFmpeg passes on times of decoding as those of presentation: an AVI has no others.

    They differ if the codec has B-frames.
    """
    return container.format.name == "avi" and bool(videos_of(container)[0].codec_context.has_b_frames)


def starts_anywhere(container: Any) -> bool:
    """Whether the clock of a container starts at any time, so that times count from the first frame."""
    return container.format.name in STREAMED


def is_sparse(container: Any) -> bool:
    """Whether frames come at some steps of the clock of an AVI only; what it announces are the steps, not the frames.

    So FFmpeg writes frames of varying rate, with empty ones between them that it leaves out again.
    """
    stream = videos_of(container)[0]
    return container.format.name == "avi" and bool(stream.average_rate != stream.guessed_rate)


def asked_of_viewers(container: Any) -> Iterator[str]:
    """Notes on other videos in a file, and on non-square pixels."""
    first, *others = videos_of(container)
    size = f"{first.width}×{first.height}"
    if others := [stream for stream in others if not _is_cover(stream)]:
        yield f"holds {counted(len(others) + 1, 'video')}: the one of {size} px is measured, the first of the largest"
    shape = first.sample_aspect_ratio
    if shape and shape != 1:
        yield (
            f"its pixels are {float(shape):.3g} times as wide as high (players stretch them): lengths in px along x and"
            " y differ, so measure with a camera.json, not with a ruler in the image"
        )


class Undiscarded:
    """Packets of a stream; counts those that must not be shown, for example after a phone has cut a video."""

    def __init__(self, container: Any, stream: Any) -> None:
        """Nothing is read yet."""
        self._packets, self.discarded = container.demux(stream), 0

    def __iter__(self) -> Iterator[Any]:
        """All packets, because those that are not shown are needed to decode the others."""
        for packet in self._packets:
            self.discarded += packet.is_discard
            yield packet
