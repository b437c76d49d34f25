"""Files as cameras, phones and microscopes write them: stacks, previews, cuts, stretched pixels, other sizes."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from calibration.camera import camera_above
from evaluator.errors import InputError
from evaluator.recording import open_recording
from evaluator.workflow.checks import check_experiment

FRAMES, SIZE = 24, (64, 48)
RATE = Fraction(30)


def frames(size: tuple[int, int] = SIZE) -> list[np.ndarray]:
    """Grey frames, each brighter than the one before by five levels."""
    return [np.full((size[1], size[0], 3), 40 + 5 * k, np.uint8) for k in range(FRAMES)]


def video(path: Path, *streams: list[np.ndarray], pixel: Fraction = Fraction(1), codec: str = "libx264") -> Path:
    """Encode streams of frames; pixel: width over height of one."""
    with av.open(str(path), "w") as container:
        opened = []
        for images in streams:
            stream = container.add_stream(codec, rate=RATE, options={"crf": "10", "g": "12", "bf": "0"})
            stream.height, stream.width = images[0].shape[:2]
            stream.pix_fmt = "yuv420p"
            stream.codec_context.sample_aspect_ratio = pixel
            opened.append((stream, images))
        for k in range(FRAMES):
            for stream, images in opened:
                frame = av.VideoFrame.from_ndarray(images[k], format="rgb24")
                frame.pts = k
                container.mux(stream.encode(frame))
        for stream, _ in opened:
            container.mux(stream.encode())
    return path


def cut_like_a_phone(path: Path, whole: Path, first: int) -> Path:
    """Copy a video whose first frames are there, but not to be shown."""
    with av.open(str(whole)) as source, av.open(str(path), "w", options={"avoid_negative_ts": "disabled"}) as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                shift = round(first / (RATE * packet.time_base))
                packet.pts, packet.dts, packet.stream = packet.pts - shift, packet.dts - shift, stream
                target.mux(packet)
    return path


def notes(path: Path, **how: float) -> tuple[int, str]:
    """How many frames a recording gives, and what is said of it."""
    recording = open_recording(path, **how)
    return sum(1 for _ in recording), "; ".join(recording.report().notes)


def stack(path: Path) -> Path:
    cv2.imwritemulti(str(path), frames())
    return path


def test_every_image_of_a_tiff_stack_is_a_frame(tmp_path: Path) -> None:
    read = list(open_recording(stack(tmp_path / "stack.tif"), rate_hz=50))
    assert [round(float(frame.luma.mean())) for frame in read] == [40 + 5 * k for k in range(FRAMES)]
    assert [frame.time_s for frame in read] == pytest.approx([k / 50 for k in range(FRAMES)])


def test_a_stack_has_no_clock(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a stack of images has no time stamps; give the frame rate"):
        open_recording(stack(tmp_path / "stack.tif"))


def test_a_stack_that_is_cut_off_gives_its_good_images_and_says_so(tmp_path: Path) -> None:
    path = stack(tmp_path / "stack.tif")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    count, said = notes(path, rate_hz=50)
    assert 2 <= count < FRAMES
    assert f"its image {count + 1} cannot be read" in said


def test_what_macos_leaves_beside_images_is_no_image(tmp_path: Path) -> None:
    for k, image in enumerate(frames()[:3]):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
        (tmp_path / f"._{k}.png").write_bytes(b"\0\5\26\7" * 20)
    assert notes(tmp_path, rate_hz=50)[0] == 3


def test_of_several_videos_in_a_file_the_largest_is_measured_and_it_is_said(tmp_path: Path) -> None:
    path = video(tmp_path / "camera.mp4", frames((32, 24)), frames())
    assert next(iter(open_recording(path))).size_px == SIZE
    assert "holds 2 videos: the one of 64×48 px is measured" in notes(path)[1]


def test_frames_that_a_phone_has_cut_off_are_not_missed(tmp_path: Path) -> None:
    path = cut_like_a_phone(tmp_path / "cut.mp4", video(tmp_path / "whole.mp4", frames()), 5)
    count, said = notes(path)
    assert count == FRAMES - 5
    assert not said


def test_a_matroska_file_that_ends_early_says_so(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    noisy = [rng.integers(0, 256, (*SIZE[::-1], 3), dtype=np.uint8) for _ in range(FRAMES)]
    path = video(tmp_path / "whole.mkv", noisy)
    assert not notes(path)[1]
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 3])
    assert "announces 0.8 s, but the last frame that could be decoded is at" in notes(path)[1]


def test_pixels_that_are_not_square_are_said(tmp_path: Path) -> None:
    path = video(tmp_path / "stretched.mp4", frames(), pixel=Fraction(4, 3))
    assert "its pixels are 1.33 times as wide as high" in notes(path)[1]
    assert not notes(video(tmp_path / "square.mp4", frames()))[1]


def test_check_names_recordings_of_another_size_than_the_cameras_images_and_stacks_without_a_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = camera_above(size_px=(96, 72), focal_px=300, distance_mm=120)
    monkeypatch.setattr("calibration.store.load_camera", lambda _: camera)
    (tmp_path / "camera.json").touch()
    video(tmp_path / "small.mp4", frames())
    video(tmp_path / "turned.mp4", frames((72, 96)))
    video(tmp_path / "right.mp4", frames((96, 72)))
    stack(tmp_path / "stack.tif")
    runs = "".join(
        f'[[run]]\nid = "{Path(name).stem}"\nleft_rpm = 30\nright_rpm = 14\nvideo = "{name}"\n'
        for name in ("small.mp4", "turned.mp4", "right.mp4", "stack.tif")
    )
    path = tmp_path / "experiment.toml"
    path.write_text(f'format = 1\nname = "sizes"\nrobot = "barrel"\ncamera = "camera.json"\n{runs}', encoding="utf-8")
    faults = check_experiment(path).faults
    assert len(faults) == 3
    assert "frames of 64×48 px, but the camera was calibrated with images of 96×72 px" in faults[0]
    assert "them by 90 degrees" in faults[1]
    assert "a stack of images has no time stamps" in faults[2]
