"""Orientation tags turn nothing: images and videos of one camera share the pixels of its sensor."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from calibration.detection.image import read_image
from calibration.errors import CalibrationError
from evaluator.recording import open_recording
from evaluator.recording.seek import Frames

ORIENTATION = 274  # of EXIF and TIFF
SENSOR = np.random.default_rng(5).integers(0, 255, (32, 48, 3)).astype(np.uint8)  # RGB
KINDS: dict[str, dict[str, object]] = {
    "photo.jpg": {"quality": 100, "subsampling": 0},
    "photo.png": {},
    "photo.tif": {},
    "lzw.tif": {"compression": "tiff_lzw"},
    "big.tif": {"big_tiff": True},
    "photo.webp": {"lossless": True},
}


def photograph(path: Path, orientation: int, pixels: np.ndarray, **options: object) -> Path:
    tags = Image.Exif()
    tags[ORIENTATION] = orientation
    Image.fromarray(pixels).save(path, exif=tags, **options)
    with Image.open(path) as written:
        assert written.getexif()[ORIENTATION] == orientation
    return path


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("name", KINDS)
def test_photographs_are_read_as_the_sensor_saw_them(tmp_path: Path, name: str, orientation: int) -> None:
    image = read_image(photograph(tmp_path / name, orientation, SENSOR, **KINDS[name]))
    assert image.shape == SENSOR.shape
    # A JPEG is not exact; turned, the noise would differ by 85 on average.
    assert np.abs(image[..., ::-1].astype(float) - SENSOR).mean() < (5.0 if name.endswith("jpg") else 1e-9)


@pytest.mark.parametrize("orientation", [1, 3, 6])
def test_tiffs_of_16_bits_are_read_as_the_sensor_saw_them(tmp_path: Path, orientation: int) -> None:
    pixels = SENSOR[..., 0].astype(np.uint16) * 200
    np.testing.assert_array_equal(read_image(photograph(tmp_path / "deep.tif", orientation, pixels)), pixels)


def test_a_folder_of_images_is_read_like_photographs(tmp_path: Path) -> None:
    for k, orientation in enumerate((1, 6, 3)):
        photograph(tmp_path / f"{k}.tif", orientation, SENSOR)
    frames = list(open_recording(tmp_path, rate_hz=30))
    assert [frame.size_px for frame in frames] == [(48, 32)] * 3
    assert [frame.repeated for frame in frames] == [False, True, True]


def test_a_tiff_cut_off_in_its_tags_is_no_crash(tmp_path: Path) -> None:
    whole = photograph(tmp_path / "whole.tif", 6, SENSOR).read_bytes()
    for length in range(9, len(whole), 97):
        (tmp_path / "cut.tif").write_bytes(whole[:length])
        with suppress(CalibrationError):
            read_image(tmp_path / "cut.tif")


def video(path: Path, degrees: int) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "1"})
        stream.height, stream.width = SENSOR.shape[:2]
        stream.pix_fmt = "yuv444p"
        stream.set_display_rotation(degrees)
        for index in range(4):
            frame = av.VideoFrame.from_ndarray(np.roll(SENSOR, 2 * index, axis=1), format="rgb24")
            frame.pts = index
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
@pytest.mark.parametrize("degrees", [0, 90, 180, -90])
def test_videos_are_read_as_the_sensor_saw_them_and_it_is_said(tmp_path: Path, suffix: str, degrees: int) -> None:
    recording = open_recording(video(tmp_path / f"v{suffix}", degrees))
    first = next(iter(frames := list(recording)))
    assert first.size_px == (48, 32)
    assert len(frames) == 4
    assert np.abs(first.to_rgb().astype(float) - SENSOR).mean() < 5.0
    turned = f"players rotate this video by {abs(degrees)}°; it is measured as recorded by the sensor"
    assert recording.report().notes == ((turned,) if degrees else ())


def test_a_frame_found_by_its_number_is_not_turned_either(tmp_path: Path) -> None:
    frames = Frames(video(tmp_path / "v.mp4", 90))
    assert frames.contents.size_px == (48, 32)
    assert np.abs(frames.image(2)[..., ::-1].astype(float) - np.roll(SENSOR, 4, axis=1)).mean() < 5.0
    frames.close()
