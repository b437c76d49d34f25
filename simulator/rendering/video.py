"""Frames → video file, with exact presentation times."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import numpy as np
from av import VideoFrame
from av.filter import Graph
from av.video.format import VideoFormat
from av.video.stream import VideoStream
from numpy.typing import NDArray

from simulator.errors import SimulationError
from simulator.rendering.scene import Scene
from simulator.rendering.tables import Encoding

CONTAINERS = {
    "h264": ("mp4", "mov", "mkv", "avi"),
    "lossless": ("mp4", "mov", "mkv"),
    "ffv1": ("mp4", "mkv", "avi", "nut"),
    "mjpeg": ("mp4", "mov", "avi", "mkv"),
}


def check_container(encoding: Encoding, path: Path) -> None:
    """Raise SimulationError if a file with this suffix cannot hold this codec."""
    if path.suffix.lstrip(".").lower() not in CONTAINERS[encoding.codec]:
        fit = ", ".join(f".{name}" for name in CONTAINERS[encoding.codec])
        raise SimulationError(f'{path}: codec "{encoding.codec}" goes into {fit}; use that suffix')


def encode(
    frames: Iterable[tuple[Fraction, NDArray[np.uint8] | NDArray[np.uint16]]],
    scene: Scene,
    clock: Fraction,
    size_px: tuple[int, int],
    path: Path,
) -> None:
    """Write frames (presentation time, image) to path; clock: time unit of which presentation times are multiples.

    Raises SimulationError if codec, container, bit depth and size are incompatible.
    """
    codec, pixel_format, options = _codec(scene.encoding, scene)
    check_container(scene.encoding, path)
    if pixel_format.startswith("yuv420") and (size_px[0] % 2 or size_px[1] % 2):
        raise SimulationError(
            f"an image of {size_px[0]} × {size_px[1]} px has an odd size, impossible with 4:2:0 colour; "
            f'set chroma = "444" or codec = "lossless" under [encoding]'
        )
    # The edit list of an mp4 has its own clock, by default 1 ms, which is too coarse for a first frame after 0.
    muxing = (
        {"movie_timescale": str(clock.denominator * max(1, 1_000_000 // clock.denominator))}
        if path.suffix.lower() in {".mp4", ".mov"}
        else {}
    )
    with av.open(str(path), "w", options=muxing) as container:
        stream = cast("VideoStream", container.add_stream(codec, rate=scene.frame_rate, options=options))
        stream.width, stream.height = size_px
        stream.pix_fmt = pixel_format
        context = stream.codec_context
        context.time_base = clock
        weave = None
        for shown, image in frames:
            if scene.timing.interlaced != "no" and weave is None:
                weave = _field_converter(scene, size_px, _given_format(image), pixel_format, clock)
            frame = VideoFrame.from_ndarray(_shifted(image, scene.sensor.bits), format=_given_format(image))
            frame.pts, frame.time_base = round(shown / clock), clock
            container.mux(stream.encode(weave(frame) if weave else frame))
        container.mux(stream.encode())


def _codec(encoding: Encoding, scene: Scene) -> tuple[str, str, dict[str, str]]:
    """Codec name, pixel format and options of FFmpeg."""
    deep, color = scene.sensor.bits > 8, scene.sensor.color
    # One thread: with several, x264 encodes fields differently from run to run (progressive images do not differ).
    interlaced = {"flags": "+ildct+ilme", "threads": "1"} if scene.timing.interlaced != "no" else {}
    if encoding.codec == "lossless":
        if deep:
            raise SimulationError('codec "lossless" has 8 bits; for more set codec = "ffv1"')
        return "libx264rgb", "rgb24", {"qp": "0", "preset": encoding.preset or "ultrafast"}
    if encoding.codec == "ffv1":
        if color:
            return "ffv1", "gbrp16le" if deep else "bgr0", {"level": "3"}
        return "ffv1", "gray16le" if deep else "gray", {"level": "3"}
    if encoding.codec == "mjpeg":
        return "mjpeg", f"yuvj{encoding.chroma}p", {"qmin": str(encoding.quality), "qmax": str(encoding.quality)}
    pixel_format = f"yuv{encoding.chroma}p" + ("10le" if deep else "")
    return "libx264", pixel_format, {"crf": f"{encoding.crf:g}", "preset": encoding.preset or "fast", **interlaced}


def _field_converter(
    scene: Scene, size_px: tuple[int, int], given: str, wanted: str, clock: Fraction
) -> Callable[[VideoFrame], VideoFrame]:
    """Convert woven frames field by field, so that subsampled colour does not mix their times, and mark the order."""
    graph = Graph()
    order = "tff" if scene.timing.interlaced == "top_first" else "bff"
    nodes = [
        graph.add_buffer(width=size_px[0], height=size_px[1], format=VideoFormat(given), time_base=clock),
        graph.add("setfield", order),
        graph.add("scale", "interl=1"),
        graph.add("format", wanted),
        graph.add("buffersink"),
    ]
    graph.link_nodes(*nodes).configure()

    def convert(frame: VideoFrame) -> VideoFrame:
        graph.push(frame)
        return cast("VideoFrame", graph.pull())

    return convert


def _given_format(image: NDArray[np.uint8] | NDArray[np.uint16]) -> str:
    if image.ndim == 2:
        return "gray" if image.dtype == np.uint8 else "gray16le"
    return "rgb24" if image.dtype == np.uint8 else "rgb48le"


def _shifted(image: NDArray[np.uint8] | NDArray[np.uint16], bits: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Numbers of 10 and 12 bits, shifted to the top of 16 bits as in FFmpeg's formats."""
    return image if bits == 8 else np.asarray(image << (16 - bits), dtype=np.uint16)
