"""One drawn clip in every kind of recording that laboratories bring: codecs, sample formats, clocks, containers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from tests.evaluator.tracking.plain_video import Clip, ellipse, pair

Image = NDArray[np.uint8]
LIMITED, FULL = 1, 2  # AVColorRange
RGB, BT709, BT601 = 0, 1, 5  # AVColorSpace


@dataclass(frozen=True)
class Kind:
    """How a recording is made.

    options: of the encoder. container: of the muxer. pts: of the frames, in 1/rate. shown: numbers of the drawn images
    that are written, one after the other: every third, but where times are the point. color_range, colorspace: as
    FFmpeg numbers them. after: what is done to the file in the end. rate_hz: said to the tracker, where a recording has
    none. fields: two frames of the clip are woven into one.
    """

    codec: str = "libx264"
    pixels: str = "yuv420p"
    suffix: str = ".mp4"
    options: dict[str, str] = field(default_factory=dict)
    container: dict[str, str] = field(default_factory=dict)
    rate: Fraction = Fraction(30)
    pts: Callable[[int], int] = int
    shown: Callable[[int], list[int]] = lambda count: list(range(0, count, 3))
    color_range: int = LIMITED
    colorspace: int = BT601
    after: Callable[[bytes], bytes] | None = None
    rate_hz: float | None = None
    fields: bool = False


def uneven(number: int) -> int:
    """Times of frames that come 2, 3 or 5 ticks apart."""
    return 3 * number + number * number % 3 * (number % 2)


def without_index(data: bytes) -> bytes:
    """An AVI cut off before its index, as after a power failure."""
    return data[: data.rindex(b"idx1")]


X264 = {"crf": "18"}
KINDS: dict[str, Kind] = {
    "H.264, 4:2:0": Kind(options=X264),
    "H.264, 4:4:4": Kind(pixels="yuv444p", options=X264),
    "H.264, RGB": Kind("libx264rgb", "rgb24", ".mkv", X264, color_range=FULL, colorspace=RGB),
    "H.264, 4:2:2, 10 bits": Kind(pixels="yuv422p10le", options=X264),
    "H.264, NV12, full range": Kind(pixels="nv12", options=X264, color_range=FULL),
    "H.264, full range": Kind(pixels="yuvj420p", options=X264, color_range=FULL),
    "H.264, BT.709": Kind(options=X264, colorspace=BT709),
    "H.264, B-frames, edit list": Kind(options={**X264, "bf": "3", "b_strategy": "0"}, suffix=".mov"),
    "H.264, times that vary": Kind(
        options=X264, pts=uneven, rate=Fraction(90), shown=lambda n: [uneven(k) for k in range(n // 3 - 1)]
    ),
    "H.264, 120 a second": Kind(options=X264, rate=Fraction(120)),
    "H.264, 240 a second": Kind(options=X264, rate=Fraction(240)),
    "H.264, MPEG-TS": Kind(options=X264, suffix=".ts"),
    "H.264, fragmented MP4": Kind(options=X264, container={"movflags": "frag_keyframe+empty_moov"}),
    "H.264, MKV without length": Kind(options=X264, suffix=".mkv", container={"live": "1"}),
    "H.264, FLV": Kind(options=X264, suffix=".flv"),
    "H.264, bare stream": Kind(options={**X264, "bf": "0"}, suffix=".h264", rate_hz=30.0),
    "H.264, interlaced": Kind(
        options={**X264, "flags": "+ilme+ildct", "x264opts": "tff=1"},
        fields=True,
        shown=lambda n: list(range(0, n, 2)),
    ),
    "screen, each frame twice": Kind(
        options=X264, rate=Fraction(60), shown=lambda n: [k // 6 * 6 for k in range(0, n, 3)]
    ),
    "HEVC, 8 bits": Kind("libx265", options={"crf": "18", "x265-params": "log-level=none"}),
    "HEVC, 10 bits": Kind("libx265", "yuv420p10le", options={"crf": "18", "x265-params": "log-level=none"}),
    "HEVC, grey, 12 bits": Kind("libx265", "gray12le", options={"crf": "18", "x265-params": "log-level=none"}),
    "VP9": Kind("libvpx-vp9", suffix=".webm", options={"crf": "20", "b": "0", "cpu-used": "5"}),
    "AV1": Kind("libsvtav1", suffix=".mkv", options={"crf": "22", "preset": "9"}),
    "AV1, 10 bits": Kind("libsvtav1", "yuv420p10le", options={"crf": "22", "preset": "9"}),
    "ProRes 422": Kind("prores_ks", "yuv422p10le", ".mov"),
    "ProRes 4444": Kind("prores_ks", "yuva444p10le", ".mov", {"profile": "4444"}),
    "DNxHR HQ": Kind("dnxhd", "yuv422p", ".mxf", {"profile": "dnxhr_hq"}),
    "CineForm": Kind("cfhd", "yuv422p10le", ".mov"),
    "MPEG-2": Kind("mpeg2video", suffix=".mpg", options={"qmin": "2", "qmax": "3"}),
    "Motion JPEG, AVI without index": Kind(
        "mjpeg", "yuvj420p", ".avi", {"qmin": "2", "qmax": "2"}, color_range=FULL, after=without_index
    ),
    "FFV1, grey, 12 bits": Kind("ffv1", "gray12le", ".mkv"),
    "FFV1, RGB, 12 bits": Kind("ffv1", "gbrp12le", ".mkv"),
    "Ut Video, RGB": Kind("utvideo", "gbrp", ".avi"),
    "raw, UYVY": Kind("rawvideo", "uyvy422", ".mov"),
    "raw, RGB": Kind("rawvideo", "bgr24", ".avi"),
    "YUV4MPEG": Kind("wrapped_avframe", suffix=".y4m"),
    "GIF": Kind("gif", "rgb8", ".gif"),
    "APNG": Kind("apng", "rgb24", ".apng"),
    "PNG images, 16 bits": Kind(suffix=".png", rate_hz=30.0),
    "TIFF images, 16 bits": Kind(suffix=".tif", rate_hz=30.0),
}


def drawn(seed: int, images: int = 180) -> Clip:
    """Two discs of 14 px on a black body that drives around a floor; most kinds of recordings show a third of it."""
    return pair(np.random.default_rng(seed), ellipse(14, 14), 7.0, 51.0, frames=images, step=0.01)


def write(folder: Path, kind: Kind, images: list[Image]) -> tuple[Path, NDArray[np.float64], NDArray[np.int_]]:
    """Write a clip; gives the path, the true time of every frame that can be measured, s, and its number in `images`.

    Of repeated frames each counts; of fields each is a frame.
    """
    shown = np.array(kind.shown(len(images)))
    if kind.suffix in {".png", ".tif"}:
        path = folder / "images"
        path.mkdir()
        for number, place in enumerate(shown):
            deep = images[place][..., ::-1].astype(np.uint16) * 257
            cv2.imwrite(str(path / f"{number:04d}{kind.suffix}"), deep)
        return path, np.arange(len(shown)) / float(kind.rate), shown
    path = folder / f"clip{kind.suffix}"
    written = [images[place] for place in shown]
    if kind.fields:
        written = [_woven(first, second) for first, second in zip(written[0::2], written[1::2], strict=True)]
    with av.open(str(path), "w", options=kind.container) as container:
        stream = container.add_stream(kind.codec, rate=kind.rate, options=kind.options)
        stream.height, stream.width = written[0].shape[:2]
        stream.pix_fmt = kind.pixels
        stream.codec_context.color_range, stream.codec_context.colorspace = kind.color_range, kind.colorspace
        stream.codec_context.time_base = 1 / kind.rate
        for index, image in enumerate(written):
            container.mux(stream.encode(_frame(image, kind, kind.pts(index))))
        container.mux(stream.encode())
    if kind.after is not None:
        path.write_bytes(kind.after(path.read_bytes()))
    times = np.array([kind.pts(k) for k in range(len(written))]) / float(kind.rate)
    if kind.fields:
        times = np.stack([times, times + 0.5 / float(kind.rate)], axis=1).ravel()
    return path, times, shown


def _frame(image: Image, kind: Kind, pts: int) -> av.VideoFrame:
    frame = av.VideoFrame.from_ndarray(image, format="rgb24")
    if not kind.pixels.startswith(("rgb", "bgr", "gbr")):
        frame = frame.reformat(
            format=kind.pixels, dst_colorspace=kind.colorspace, src_color_range=FULL, dst_color_range=kind.color_range
        )
    frame.pts, frame.time_base = pts, 1 / kind.rate
    return frame


def _woven(first: Image, second: Image) -> Image:
    """Lines 0, 2, 4 … of the first frame and 1, 3, 5 … of the second."""
    woven = first.copy()
    woven[1::2] = second[1::2]
    return woven
