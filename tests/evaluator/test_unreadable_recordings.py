"""Whatever is handed over as a recording: one sentence that names it and exit status 2, never a traceback."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from evaluator.cli.failures import run_safely
from evaluator.cli.group import turnscope
from tests.evaluator.tracking.synthetic import write_video

GREY = np.full((48, 64, 3), 128, np.uint8)


def _sample(folder: Path) -> bytearray:
    """An MP4 of twelve plain frames."""
    video = write_video(folder / "whole.mp4", [GREY] * 12, codec="libx264", pixels="yuv420p")
    return bytearray(video.read_bytes())


def _written(folder: Path, content: bytes) -> Path:
    path = folder / "r.mp4"
    path.write_bytes(content)
    return path


def _folder(folder: Path, *images: np.ndarray) -> Path:
    path = folder / "images"
    path.mkdir()
    for k, image in enumerate(images):
        cv2.imwrite(str(path / f"{k}.tiff"), image)
    return path


def unknown_codec(folder: Path) -> Path:
    return _written(folder, _sample(folder).replace(b"avc1", b"zzzz"))


def no_decoder_settings(folder: Path) -> Path:
    return _written(folder, _sample(folder).replace(b"avcC", b"zzzz"))


def audio_only(folder: Path) -> Path:
    path = folder / "r.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        for k in range(20):
            frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
            frame.rate, frame.pts = 44100, 1024 * k
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def no_stream(folder: Path) -> Path:
    return _written(folder, _sample(folder).replace(b"trak", b"free"))


def no_frames(folder: Path) -> Path:
    content = _sample(folder)
    start = content.find(b"mdat") + 4
    end = content.find(b"moov") - 4
    content[start:end] = bytes(end - start)
    return _written(folder, content)


def cut_off(folder: Path) -> Path:
    content = _sample(folder)
    return _written(folder, content[: content.find(b"moov")])


def text(folder: Path) -> Path:
    return _written(folder, b"time_s, x_mm, y_mm\n" * 40)


def zeros(folder: Path) -> Path:
    return _written(folder, bytes(100_000))


def empty_file(folder: Path) -> Path:
    return _written(folder, b"")


def missing_file(folder: Path) -> Path:
    return folder / "none.mp4"


def folder_without_images(folder: Path) -> Path:
    return _folder(folder)


def unreadable_image(folder: Path) -> Path:
    path = _folder(folder, GREY, GREY)
    (path / "1.tiff").write_bytes(b"not an image")
    return path


def images_of_two_sizes(folder: Path) -> Path:
    return _folder(folder, GREY, GREY[:20])


def images_of_floats(folder: Path) -> Path:
    return _folder(folder, GREY.astype(np.float32))


def folder_named_like_an_image(folder: Path) -> Path:
    path = _folder(folder)
    (path / "0.png").mkdir()
    return path


def one_plain_frame(folder: Path) -> Path:
    return write_video(folder / "r.mp4", [GREY], codec="libx264", pixels="yuv420p")


def frames_of_four_pixels(folder: Path) -> Path:
    return write_video(folder / "r.mp4", [GREY[:2, :2]] * 5, codec="libx264", pixels="yuv420p")


CASES: dict[Callable[[Path], Path], str] = {
    unknown_codec: "no decoder",
    no_decoder_settings: "not a video that FFmpeg can open",
    audio_only: "holds no video, only audio",
    no_stream: "holds no video, no stream of any kind",
    no_frames: "no frame can be decoded",
    cut_off: "not a video that FFmpeg can open",
    text: "not a video that FFmpeg can open",
    zeros: "not a video that FFmpeg can open",
    empty_file: "the file is empty",
    missing_file: "no such file",
    folder_without_images: "holds no images",
    unreadable_image: "1.tiff: not a readable image",
    images_of_two_sizes: "but the images before are",
    images_of_floats: "its samples are float32",
    folder_named_like_an_image: "holds no images",
    one_plain_frame: "no mark was found in any of 1 frame: the recording has no colour",
    frames_of_four_pixels: "no mark was found in any of 5 frames: the recording has no colour",
}


@pytest.mark.parametrize("make", CASES, ids=lambda make: make.__name__)
def test_what_cannot_be_tracked_ends_in_one_sentence_and_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], make: Callable[[Path], Path]
) -> None:
    path = make(tmp_path)
    marks = tmp_path / "m.csv"
    monkeypatch.setattr("sys.argv", ["turnscope", "track", str(path), "-o", str(marks), "--rate", "60", "-q"])
    assert run_safely(turnscope) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith(f"error: {path}")
    assert CASES[make] in said
    assert "\n" not in said
    assert not marks.exists()


def test_an_address_is_opened_as_it_was_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    address = "tcp://127.0.0.1:1"  # nobody listens there
    monkeypatch.setattr("sys.argv", ["turnscope", "track", address, "-o", str(tmp_path / "m.csv"), "-q"])
    assert run_safely(turnscope) == 2
    assert f"error: {address}: " in capsys.readouterr().err
