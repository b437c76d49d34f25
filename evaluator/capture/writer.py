"""The recorded file: compressed frames are stored as received, raw frames without loss."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import av

from evaluator.capture.clock import MICRO
from evaluator.errors import InputError

TICK = Fraction(1, MICRO)
AS_IT_CAME = ("mjpeg", "h264", "hevc")  # codecs of cameras that MP4 supports
# Fragments, so that a recording of a killed process is readable up to the last second.
MP4 = {"movflags": "+frag_keyframe+empty_moov+default_base_moof", "video_track_timescale": str(MICRO)}
LOSSLESS = {"qp": "0", "preset": "ultrafast", "g": "60"}  # H.264 without loss, fast enough for a camera
STORED = ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "gray")  # without conversion


class Writer:
    """Writes to a part file beside the path, which is renamed on closing: `with Writer(…) as file`."""

    def __init__(self, path: Path, stream: Any) -> None:
        """Open the file. stream: of the source. Raises InputError if the path exists or is not an .mp4."""
        if path.suffix.lower() != ".mp4":
            raise InputError(f"{path}: recordings are written as .mp4; give such a name")
        if path.exists():
            raise InputError(f"{path}: exists already; give another name")
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path, self._part = path, path.with_name(f"{path.stem}.part.mp4")
        self._container = av.open(str(self._part), "w", options=MP4)
        self.as_it_came = stream.codec_context.name in AS_IT_CAME
        self._out: Any = None
        self._first_us: int | None = None
        self._last_us: int | None = None
        if self.as_it_came:
            self._out = self._container.add_stream_from_template(stream)
            self._out.time_base = TICK

    def write(self, packet: Any, frames: tuple[Any, ...], times_us: tuple[int | None, ...], arrived_us: int) -> None:
        """Store a packet, or the frames that it completed.

        times_us: of the frames from the first on, None for omitted ones. arrived_us: of the packet from the first on,
        for packets without a time.
        """
        if self.as_it_came:
            self._copy(packet, arrived_us)
            return
        for frame, time in zip(frames, times_us, strict=True):
            if time is not None:
                self._encode(frame, time)

    def _copy(self, packet: Any, arrived_us: int) -> None:
        if not packet.size or (self._last_us is None and not packet.is_keyframe):
            return
        shown = arrived_us if packet.pts is None else round(packet.pts * packet.time_base * MICRO)
        decoded = shown if packet.pts is None or packet.dts is None else round(packet.dts * packet.time_base * MICRO)
        if self._first_us is None:
            self._first_us = shown
        if self._last_us is not None and decoded <= self._last_us:
            return  # its time is not after the one before, so that players could not show it
        self._last_us = decoded
        packet.stream, packet.time_base = self._out, TICK
        packet.pts, packet.dts = shown - self._first_us, decoded - self._first_us
        self._container.mux(packet)

    def _encode(self, frame: Any, time_us: int) -> None:
        if self._out is None:
            pixels = frame.format.name
            self._out = self._container.add_stream("libx264", rate=60, options=LOSSLESS)
            self._out.width, self._out.height = frame.width, frame.height
            # Packed formats of cameras have one colour for two pixels, as planes of 4:2:2.
            self._out.pix_fmt = pixels if pixels in STORED else "yuv422p" if "422" in pixels else "yuv444p"
            self._out.time_base = self._out.codec_context.time_base = TICK
        stored = frame.reformat(format=self._out.pix_fmt)
        stored.pts, stored.time_base, stored.pict_type = time_us, TICK, 0
        self._container.mux(self._out.encode(stored))

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Complete the file, also for a recording that was interrupted."""
        if self._out is not None and not self.as_it_came:
            self._container.mux(self._out.encode())
        self._container.close()
        if self._out is not None and self._part.exists():
            self._part.replace(self.path)
        else:
            self._part.unlink(missing_ok=True)
