"""Recording from a camera: exact frames and times, the start of the motors, and what goes wrong at a bench.

The virtual camera is a file, or a pipe that is fed at the pace of a camera.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from evaluator.capture.clock import CaptureClock
from evaluator.capture.light import LightRegion, light_on
from evaluator.capture.record import CaptureStart, record_camera
from evaluator.capture.start import line_on, program
from evaluator.cli.camera.record import record as command
from evaluator.errors import InputError
from evaluator.progress import Cancelled
from evaluator.recording import open_recording

MICRO = Fraction(1, 1_000_000)
SIZE = (64, 48)
Floats = NDArray[np.float64]


def frames(count: int, pixels: str, light_from: float) -> Iterator[av.VideoFrame]:
    """Frames of noise; a light in the corner goes on at a frame number, whose fraction dims that frame."""
    rng = np.random.default_rng(4)
    for k in range(count):
        image = rng.integers(40, 80, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
        share = float(np.clip(k + 1 - light_from, 0, 1))
        image[2:13, 2:13] = (image[2:13, 2:13] + share * 150).astype(np.uint8)
        yield av.VideoFrame.from_ndarray(image, format="rgb24").reformat(format=pixels)


def camera_file(path: Path, times_us: list[int], codec: str = "ffv1", light_from: float = np.inf) -> list[bytes]:
    """A recording as a camera might give it; returns the luma of its frames as they will be decoded."""
    pixels = {"mjpeg": "yuvj422p"}.get(codec, "yuv422p")
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=60)
        stream.width, stream.height = SIZE
        stream.pix_fmt = pixels
        stream.time_base = stream.codec_context.time_base = MICRO
        for frame, at in zip(frames(len(times_us), pixels, light_from), times_us, strict=True):
            frame.pts, frame.time_base = at, MICRO
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with av.open(str(path)) as container:
        return [bytes(frame.planes[0]) for frame in container.decode(video=0)]


def recorded(path: Path) -> tuple[list[float], list[bytes]]:
    with av.open(str(path)) as container:
        stored = list(container.decode(video=0))
    first = stored[0].pts
    times = [float((frame.pts - first) * frame.time_base) for frame in stored]
    return times, [bytes(frame.planes[0]) for frame in stored]


UNEVEN = [5_000_000 + at for at in (0, 16_683, 33_310, 50_001, 100_020, 116_690)]  # two frames were dropped


@pytest.mark.parametrize(("codec", "suffix"), [("ffv1", ".nut"), ("mjpeg", ".nut")])
def test_frames_and_times_are_those_of_the_camera(tmp_path: Path, codec: str, suffix: str) -> None:
    source = tmp_path / f"camera{suffix}"
    given = camera_file(source, UNEVEN, codec)
    found = record_camera(source, tmp_path / "r01.mp4")
    times, luma = recorded(tmp_path / "r01.mp4")
    assert luma == given
    assert np.allclose(times, (np.array(UNEVEN) - UNEVEN[0]) / 1e6, atol=1e-6)
    assert (found.clock.frames, found.clock.dropped, found.clock.source) == (6, 2, "camera")
    said = json.loads((tmp_path / "r01.capture.json").read_text())
    assert (said["dropped"], said["source"], said["times_from"]) == (2, str(source), "camera")
    assert [float(frame.time_s) for frame in open_recording(tmp_path / "r01.mp4")] == pytest.approx(times, abs=1e-6)


def test_frames_without_times_have_those_of_their_arrival(tmp_path: Path) -> None:
    pipe = tmp_path / "camera.y4m"
    os.mkfifo(pipe)

    def feed() -> None:
        with pipe.open("wb") as file:
            file.write(b"YUV4MPEG2 W64 H48 F60:1 Ip A1:1 C420jpeg\n")
            for _ in range(12):
                file.write(b"FRAME\n" + bytes(64 * 48 * 3 // 2))
                file.flush()
                time.sleep(0.03)

    clock = CaptureClock()
    for k in range(20):
        clock.add(None, 100 + k / 50 + (0.004 if k % 2 else 0.0))
    report = clock.report()
    assert report.source == "arrival"
    assert report.interval_s == pytest.approx(0.02, abs=0.005)
    feeder = threading.Thread(target=feed)
    feeder.start()
    record_camera(pipe, tmp_path / "r01.mp4")
    feeder.join()
    assert len(recorded(tmp_path / "r01.mp4")[0]) == 12


def test_a_moment_of_the_computer_lies_where_the_promptest_frame_says() -> None:
    clock, rng = CaptureClock(), np.random.default_rng(0)
    for k in range(200):
        clock.add(7 + k / 60, 1000 + k / 60 + rng.exponential(0.002))
    start, sigma = clock.in_recording(1000.5)
    assert start == pytest.approx(0.5, abs=1e-3)
    assert 1 / 60 < sigma < 1.5 / 60


def seen(on: float, exposure: float, noise: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Times (mid-exposure) and brightness of frames that saw a light go on."""
    times = np.arange(60) / 60
    share = np.clip((times + exposure / 2 - on) / exposure, 0, 1)
    return times, np.rint(50 + 100 * share + noise * rng.standard_normal(60))


@pytest.mark.parametrize("known", [True, False])
def test_start_by_a_light_is_within_its_uncertainty(known: bool) -> None:
    rng = np.random.default_rng(3)
    off = []
    for _ in range(400):
        on, exposure = rng.uniform(0.3, 0.6), rng.uniform(0.002, 1 / 60)
        at, sigma = light_on(*seen(on, exposure, 1.0, rng), exposure if known else None)
        off.append((at - on) / sigma)
        assert abs(at - on) < 1 / 60
    assert np.mean(np.abs(off) < 1.96) > 0.93
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.15


def test_no_light_no_start() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        with pytest.raises(InputError, match="no light switches on"):
            light_on(np.arange(300) / 60, np.rint(50 + rng.standard_normal(300)))


def test_light_in_a_recording_starts_the_run(tmp_path: Path) -> None:
    source = tmp_path / "camera.nut"
    camera_file(source, [round(k * 1e6 / 60) for k in range(60)], light_from=30.25)  # on at 30.25 exposures: mid 29.75
    start = CaptureStart(light=LightRegion(7, 7), exposure_s=1 / 60)
    found = record_camera(source, None, start=start)
    assert found.start_s == pytest.approx(29.75 / 60, abs=3 * found.start_sigma_s)
    assert found.start_sigma_s < 0.002
    with pytest.raises(InputError, match="not within the image"):
        record_camera(source, None, start=CaptureStart(light=LightRegion(70, 7)))


def test_a_program_starts_the_motors_after_the_rest(tmp_path: Path) -> None:
    source, started = tmp_path / "camera.nut", tmp_path / "started"
    camera_file(source, [round(k * 1e6 / 60) for k in range(60)])
    run = program(f"\"{sys.executable}\" -c \"open(r'{started}', 'w')\"")
    found = record_camera(source, None, start=CaptureStart(signal=run, rest_s=0.5))
    assert 0.48 < found.start_s < 1.0  # at the pace of the camera, though the file could be read at once
    for _ in range(1000):
        if started.exists():
            break
        time.sleep(0.1)
    assert started.exists()
    failing = program(f'"{sys.executable}" -c "raise SystemExit(3)"')()
    failing.send()
    while not failing.fault():
        time.sleep(0.02)
    refused = record_camera(source, None, start=CaptureStart(signal=lambda: failing))
    assert np.isnan(refused.start_s)
    assert "ended with status 3" in refused.start_note
    with pytest.raises(InputError, match="no such program"):
        record_camera(source, None, start=CaptureStart(signal=program("no-such-program-here")))


def test_a_line_says_that_the_motors_started(tmp_path: Path) -> None:
    source = tmp_path / "camera.nut"
    camera_file(source, UNEVEN)
    reading, writing = os.pipe()
    os.write(writing, b"go\n")
    with os.fdopen(reading) as stream:
        moment = line_on(stream)().moment
        for _ in range(3000):
            if moment() is not None:
                break
            time.sleep(0.02)
    assert moment() is not None
    os.close(writing)


def test_interrupted_recording_is_whole_up_to_there(tmp_path: Path) -> None:
    source = tmp_path / "camera.nut"
    camera_file(source, [round(k * 1e6 / 60) for k in range(60)])

    def stop(*_: object) -> None:
        raise Cancelled

    found = record_camera(source, tmp_path / "r01.mp4", progress=stop)
    assert found.clock.frames == len(recorded(tmp_path / "r01.mp4")[0]) >= 1


def test_seconds_end_it(tmp_path: Path) -> None:
    source = tmp_path / "camera.nut"
    camera_file(source, [round(k * 1e6 / 60) for k in range(60)])
    assert record_camera(source, None, seconds=0.5).clock.frames == 31


def test_command_says_what_it_recorded_and_never_records_over_a_file(tmp_path: Path) -> None:
    source, out = tmp_path / "camera.nut", tmp_path / "r01.mp4"
    camera_file(source, UNEVEN)
    done = CliRunner().invoke(command, [str(source), "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert "6 frames at 59.94/s" in done.output
    assert "2 frames were dropped" in done.output
    before = out.read_bytes()
    with pytest.raises(InputError, match="exists already"):
        record_camera(source, out)
    assert out.read_bytes() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["camera.nut", "r01.capture.json", "r01.mp4"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["/dev/video97"], "no such camera"),
        (["missing.mp4"], "cannot be opened"),
        (["{camera}", "-o", "{folder}/r.avi"], r"written as \.mp4"),
        (["{camera}", "--start-line", "--start-program", "ls"], "give only one of"),
    ],
)
def test_what_cannot_be_recorded_is_said_in_a_sentence(tmp_path: Path, arguments: list[str], said: str) -> None:
    camera_file(tmp_path / "camera.nut", UNEVEN)
    filled = [part.format(camera=tmp_path / "camera.nut", folder=tmp_path) for part in arguments]
    with pytest.raises(InputError, match=said):
        CliRunner().invoke(command, filled, catch_exceptions=False)


def test_what_programs_read_is_json_where_no_start_is_known(tmp_path: Path) -> None:
    source = tmp_path / "camera.nut"
    camera_file(source, UNEVEN, "ffv1")
    done = CliRunner().invoke(command, [str(source), "--json"])
    assert done.exit_code == 0, done.output

    def refuse(word: str) -> None:
        raise AssertionError(word)

    assert json.loads(done.stdout, parse_constant=refuse)["start_s"] is None
