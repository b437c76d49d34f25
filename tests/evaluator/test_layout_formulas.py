"""Which planes of a decoded frame are used, and which stream of a file is the recording."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from av.stream import Disposition
from av.video.frame import PictureType

from evaluator.recording import open_recording
from evaluator.recording.layout import KINDS, Layout
from evaluator.recording.streams import asked_of_viewers, videos_of


@pytest.mark.parametrize(
    ("name", "bits", "color_range", "colorspace", "found"),
    [
        ("yuv420p", 8, 1, 1, (None, 8, False, "bt709")),
        ("yuv420p", 8, 2, 5, (None, 8, True, "bt601")),
        ("yuvj420p", 8, 0, 2, (None, 8, True, "bt601")),
        ("yuv422p10le", 10, 1, 1, (None, 10, False, "bt709")),
        ("yuv422p10be", 10, 1, 1, ("yuv444p16le", 16, True, "bt601")),
        ("rgb24", 8, 1, 1, ("yuvj444p", 8, True, "bt601")),
        ("gbrp12le", 12, 1, 1, ("yuv444p16le", 16, True, "bt601")),
        ("gray", 8, 1, 2, (None, 8, True, "bt601")),
        ("gray12le", 12, 1, 2, (None, 12, True, "bt601")),
        ("gray14le", 14, 1, 2, ("gray16le", 16, True, "bt601")),
        ("gray16be", 16, 1, 2, ("gray16le", 16, True, "bt601")),
        ("monob", 1, 1, 2, ("gray", 8, True, "bt601")),
    ],
)
def test_planes_are_used_as_they_are_or_converted_without_loss(
    name: str, bits: int, color_range: int, colorspace: int, found: tuple[str | None, int, bool, str]
) -> None:
    image: Any = SimpleNamespace(width=64, height=48, color_range=color_range, colorspace=colorspace)
    image.format = SimpleNamespace(name=name, components=[SimpleNamespace(bits=bits)])
    image.planes = [SimpleNamespace(height=48, width=64)]
    image.reformat = lambda **_: image
    layout = Layout.of(image)
    assert (layout.target, layout.depth, layout.full_range, layout.matrix) == found
    assert layout.fits(image)


@pytest.mark.parametrize(
    ("name", "codec", "said", "cosited"),
    [
        ("yuv420p", "h264", "", True),
        ("yuv420p10le", "hevc", "of a maker", True),
        ("yuv420p", "h264", "x264 - core 165", None),
        ("yuv420p", "hevc", "x265 (build 216)", None),
        ("yuv420p", "mpeg4", "", None),
        ("yuvj420p", "mjpeg", "", False),
        ("nv12", "h264", "", False),
    ],
)
def test_samples_of_colour_are_at_the_even_columns_in_the_video_of_a_camera(
    name: str, codec: str, said: str, *, cosited: bool | None
) -> None:
    """NV12 is converted to full resolution by FFmpeg, which takes them to be midway."""

    class Said(bytes):
        type = SimpleNamespace(name="SEI_UNREGISTERED")

    image: Any = SimpleNamespace(width=64, height=48, color_range=1, colorspace=1, side_data=[Said(said.encode())])
    image.format = SimpleNamespace(name=name, components=[SimpleNamespace(bits=10 if "10" in name else 8)])
    image.planes = [SimpleNamespace(height=48, width=64)]
    image.reformat = lambda **_: image
    assert Layout.of(image, codec).cosited is cosited


def test_kinds_of_frames_are_those_of_the_codec() -> None:
    assert {PictureType[kind].value: kind for kind in "IPB"} == KINDS


@pytest.mark.parametrize(("rate_hz", "rate"), [(23.976, Fraction(2997, 125)), (30000 / 1001, Fraction(30000, 1001))])
def test_a_rate_that_is_said_is_kept_to_a_thousand_and_first(tmp_path: Path, rate_hz: float, rate: Fraction) -> None:
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((8, 8), np.uint8))
    assert open_recording(tmp_path, rate_hz=rate_hz).nominal_rate == rate


def stream(width: int, height: int, *, cover: bool = False, shape: float = 1.0, codec: object = True) -> Any:
    disposition = Disposition.attached_pic if cover else Disposition(0)
    return SimpleNamespace(
        width=width, height=height, disposition=disposition, sample_aspect_ratio=shape, codec_context=codec
    )


def test_the_recording_is_the_largest_video_that_is_no_cover_and_can_be_decoded() -> None:
    preview, main, cover = stream(160, 120), stream(640, 480, shape=1.333), stream(4000, 4000, cover=True)
    unknown = stream(8000, 8000, codec=None)
    container = SimpleNamespace(streams=SimpleNamespace(video=[preview, cover, unknown, main]))
    assert videos_of(container) == [main, preview, cover]
    notes = list(asked_of_viewers(container))
    assert notes[0] == "holds 2 videos: the one of 640×480 px is measured, the first of the largest"
    assert notes[1].startswith("its pixels are 1.33 times as wide as high")
    container.streams.video = [stream(640, 480), cover]
    assert list(asked_of_viewers(container)) == []
