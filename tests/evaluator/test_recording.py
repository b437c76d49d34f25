from __future__ import annotations

import os
import threading
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.recording import open_recording
from evaluator.workflow.runs.stages import _refuse_cut
from tests.evaluator.tracking.synthetic import draw, noise_images, turning_marks, write_video


def test_times_are_the_exact_presentation_times_of_a_59_94_recording(tmp_path: Path) -> None:
    video = write_video(
        tmp_path / "v.mov", noise_images(8), codec="mjpeg", pixels="yuvj420p", rate=Fraction(60000, 1001)
    )
    times = [frame.time for frame in open_recording(video)]
    assert times == [Fraction(1001 * k, 60000) for k in range(8)]


def test_dropped_images_are_reported_with_their_place(tmp_path: Path) -> None:
    video = write_video(tmp_path / "v.mkv", noise_images(8), pts=[0, 1, 2, 3, 6, 7, 8, 9])
    recording = open_recording(video)
    assert len(list(recording)) == 8
    assert recording.report().dropped == ((4, 2),)


def test_repeated_images_are_reported(tmp_path: Path) -> None:
    images = noise_images(6)
    images[3] = images[2]
    recording = open_recording(write_video(tmp_path / "v.mkv", images))
    list(recording)
    assert recording.report().duplicates == (3,)


def test_times_that_stand_still_come_from_the_rate_of_the_file_or_the_one_given(tmp_path: Path) -> None:
    video = write_video(tmp_path / "v.mkv", noise_images(6), pts=[0] * 6)
    for given, rate in ((None, 60), (30, 30)):
        recording = open_recording(video, rate_hz=given)
        assert [frame.time for frame in recording] == [Fraction(k, rate) for k in range(6)]
        assert recording.report().notes == (f"no presentation times in the file: taken from its rate {rate}/s",)


def test_a_rate_that_is_not_needed_is_said_not_to_be_used(tmp_path: Path) -> None:
    recording = open_recording(write_video(tmp_path / "v.mkv", noise_images(3)), rate_hz=30)
    assert [float(frame.time) for frame in recording] == pytest.approx([0, 1 / 60, 2 / 60], abs=1e-3)
    assert recording.report().notes == ("the given rate 30/s is not used: the recording has times",)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused(tmp_path: Path, rate: float) -> None:
    with pytest.raises(InputError, match="rate must be above 0"):
        open_recording(tmp_path, rate_hz=rate)


def test_images_that_are_not_after_those_before_them_are_left_out(tmp_path: Path) -> None:
    recording = open_recording(write_video(tmp_path / "v.mkv", noise_images(8), pts=[0, 1, 2, 2, 3, 4, 4, 5]))
    frames = list(recording)
    assert [frame.index for frame in frames] == list(range(6))
    assert [float(frame.time) for frame in frames] == pytest.approx([k / 60 for k in range(6)], abs=1e-3)
    assert recording.report().notes == ("2 frames are left out: their times are not after those before them",)


@pytest.mark.parametrize("b_frames", [0, 2, 8])
def test_h264_in_avi_has_its_times_in_order_however_its_frames_refer_to_each_other(
    tmp_path: Path, b_frames: int
) -> None:
    images = [np.full((48, 64, 3), 20 + 8 * k, np.uint8) for k in range(24)]
    options = {"x264-params": f"bframes={b_frames}:b-adapt=0:b-pyramid=normal"}
    recording = open_recording(
        write_video(tmp_path / "v.avi", images, codec="libx264", pixels="yuv420p", options=options)
    )
    frames = [(frame.time, float(frame.luma.mean())) for frame in recording]
    assert [time for time, _ in frames] == [Fraction(k, 60) for k in range(24)]
    assert np.all(np.diff([light for _, light in frames]) > 0)
    assert recording.report().notes == ()


def test_an_avi_with_frames_at_some_steps_of_its_clock_announces_steps_and_is_whole(tmp_path: Path) -> None:
    """Thirty frames a second on a clock of 600, one of them late: FFmpeg's header has 20 times as many as there are."""
    ticks = [20 * k + (k == 20) for k in range(48)]
    how = {"codec": "mjpeg", "pixels": "yuvj420p", "rate": Fraction(600)}
    video = write_video(tmp_path / "v.avi", noise_images(48), pts=ticks, **how)  # type: ignore[arg-type]
    recording = open_recording(video)
    assert [frame.time for frame in recording] == [Fraction(tick, 600) for tick in ticks]
    assert (recording.expected_frames, recording.nominal_rate) == (0, 30)
    assert recording.report().notes == ()
    _refuse_cut(recording, recording.report(), video)  # type: ignore[arg-type]
    content = video.read_bytes()
    video.write_bytes(content[: len(content) // 2])
    recording = open_recording(video)
    list(recording)
    with pytest.raises(InputError, match=r"cut off after 0\.[6-9]\d s: the file announces 1\.57 s"):
        _refuse_cut(recording, recording.report(), video)  # type: ignore[arg-type]
    even = open_recording(write_video(tmp_path / "even.avi", noise_images(8), codec="mjpeg", pixels="yuvj420p"))
    assert (even.expected_frames, even.nominal_rate) == (8, 60)


def test_a_recording_whose_clock_stops_is_refused(tmp_path: Path) -> None:
    video = write_video(tmp_path / "v.mkv", noise_images(12), pts=[0, 1, *[2] * 10])
    with pytest.raises(InputError, match="stand still or run backwards in 9 of 12 frames"):
        list(open_recording(video))


@pytest.mark.parametrize(
    ("codec", "pixels"),
    [
        ("ffv1", "yuv420p"),
        ("ffv1", "gray"),
        ("ffv1", "yuv420p10le"),
        ("ffv1", "yuv422p"),
        ("ffv1", "bgr0"),
        ("ffv1", "gbrp16le"),
        ("ffv1", "gray16le"),
        ("mjpeg", "yuvj420p"),
    ],
)
def test_planes_convert_back_to_the_image_in_every_pixel_format(tmp_path: Path, codec: str, pixels: str) -> None:
    y, x = np.mgrid[:46, :70]
    smooth = np.stack([60 + x, 80 + 2 * y, 120 + 0 * x], axis=-1).astype(np.uint8)
    options = {"qscale": "1"} if codec == "mjpeg" else {}
    video = write_video(tmp_path / "v.mkv", [smooth] * 2, codec=codec, pixels=pixels, options=options)
    frame = next(iter(open_recording(video)))
    expected = smooth
    if pixels.startswith("gray"):
        grey = np.rint(smooth @ [0.299, 0.587, 0.114])
        expected = np.repeat(grey[..., None], 3, axis=2)
    assert np.abs(frame.to_rgb().astype(float) - expected).mean() < 3.0


def test_odd_sizes_are_read_whole(tmp_path: Path) -> None:
    video = write_video(tmp_path / "v.mkv", noise_images(2, (65, 47)), pixels="yuv420p")
    frame = next(iter(open_recording(video)))
    assert frame.luma.shape == (47, 65)
    assert frame.luma.flags.c_contiguous  # kernels would be compiled anew for rows with gaps
    assert frame.to_rgb().shape == (47, 65, 3)


def test_a_video_cut_in_the_middle_gives_its_good_images_and_says_so(tmp_path: Path) -> None:
    video = write_video(tmp_path / "v.mkv", noise_images(30))
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    recording = open_recording(video)
    assert 5 < len(list(recording)) < 30


@pytest.mark.parametrize(("content", "said"), [(b"", "empty"), (b"hello, this is text\n" * 40, "not a video")])
def test_what_is_no_video_is_one_clear_sentence(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "v.mp4"
    path.write_bytes(content)
    with pytest.raises(InputError, match=said):
        open_recording(path)


def test_a_pipe_gives_every_image_from_the_first(tmp_path: Path) -> None:
    video, pipe = write_video(tmp_path / "v.mkv", noise_images(30)), tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=lambda: pipe.write_bytes(video.read_bytes()))
    writer.start()
    frames = [(frame.index, frame.luma.tobytes()) for frame in open_recording(pipe)]
    writer.join()
    assert frames == [(frame.index, frame.luma.tobytes()) for frame in open_recording(video)]


def test_a_missing_video_is_named() -> None:
    with pytest.raises(InputError, match=r"nowhere\.mp4: no such file"):
        open_recording("nowhere.mp4")


def test_a_folder_of_images_needs_a_rate_and_keeps_the_order_of_numbers(tmp_path: Path) -> None:
    for number in (1, 2, 10):
        cv2.imwrite(str(tmp_path / f"frame{number}.png"), np.full((20, 30, 3), number, np.uint8))
    with pytest.raises(InputError, match="rate"):
        open_recording(tmp_path)
    frames = list(open_recording(tmp_path, rate_hz=50))
    assert [int(frame.luma[0, 0]) for frame in frames] == [1, 2, 10]
    assert frames[2].time == Fraction(1, 25)


@pytest.mark.parametrize("first", ["top", "bottom"])
def test_interlaced_recordings_are_taken_apart_into_fields_in_their_order(tmp_path: Path, first: str) -> None:
    def scene(t: float) -> np.ndarray:
        y, x = np.mgrid[:96, :128]
        spot = 200.0 / (1 + np.exp(np.hypot(x - 20 - 1.5 * t, y - 48) - 12))
        return np.repeat((30 + spot)[..., None], 3, axis=2).astype(np.uint8)

    images = []
    for k in range(20):
        early, late = scene(2.0 * k), scene(2.0 * k + 1)
        woven = early.copy()
        woven[(1 if first == "top" else 0) :: 2] = late[(1 if first == "top" else 0) :: 2]
        images.append(woven)
    recording = open_recording(write_video(tmp_path / "v.mkv", images, rate=Fraction(30)))
    fields = list(recording)
    assert len(fields) == 40
    assert fields[0].luma.flags.c_contiguous
    assert [field.row_origin for field in fields[:2]] == ([0, 1] if first == "top" else [1, 0])
    assert fields[3].time - fields[2].time == pytest.approx(Fraction(1, 60), abs=1e-3)
    columns = np.arange(128)
    places = [
        float((field.luma.astype(float) - 29) @ columns @ np.ones(48) / (field.luma.astype(float) - 29).sum())
        for field in fields
    ]
    assert np.allclose(np.diff(places), 1.5, atol=0.2)
    assert f"{first} field first" in recording.report().notes[0]


def test_a_progressive_recording_of_30_a_second_stays_whole(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    marks = turning_marks(24, (60.0, 48.0), 12.0, 6.0, 0.05)
    images = [draw(rng, (120, 96), {n: tuple(p[k]) for n, p in marks.items()}, 3.0, 0.8, 2.0) for k in range(24)]
    recording = open_recording(write_video(tmp_path / "v.mkv", images, rate=Fraction(30), pixels="yuv420p"))
    assert {frame.row_step for frame in recording} == {1}


def test_length_of_a_recording_is_expected_of_a_file_that_holds_nothing_else(tmp_path: Path) -> None:
    silent = write_video(tmp_path / "v.mkv", noise_images(6))
    assert open_recording(silent).expected_s == pytest.approx(0.1, abs=0.01)
    with av.open(str(silent)) as source, av.open(str(tmp_path / "sound.mkv"), "w") as container:
        video = container.add_stream_from_template(source.streams.video[0])
        sound = container.add_stream("pcm_s16le", rate=8000)
        for packet in source.demux(video=0):
            if packet.size:
                packet.stream = video
                container.mux(packet)
        noise = av.AudioFrame.from_ndarray(np.zeros((1, 16000), np.int16), layout="mono")
        noise.sample_rate, noise.pts = 8000, 0
        container.mux([*sound.encode(noise), *sound.encode(None)])
    assert open_recording(tmp_path / "sound.mkv").expected_s is None


def test_frames_that_only_change_their_brightness_are_not_woven_of_fields(tmp_path: Path) -> None:
    lit = [np.full((48, 64, 3), 40 * k, np.uint8) for k in range(6)]
    recording = open_recording(write_video(tmp_path / "v.mkv", lit, pixels="yuv420p", rate=Fraction(30)))
    assert len(list(recording)) == 6
    assert recording.report().notes == ()
