"""Frames for the report and the studio: which are kept, how large they are, and what a preview waits for."""

from __future__ import annotations

import base64
import json
from collections import OrderedDict
from concurrent.futures import Future
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.recording import Frame
from evaluator.workflow.frames import decoder, live
from evaluator.workflow.frames.decoder import Wanted
from evaluator.workflow.frames.live import LiveSource
from evaluator.workflow.runs import thumbnails
from evaluator.workflow.runs.thumbnails import WithThumbnails, small_jpeg


def frame(index: int, level: int = 100, size: tuple[int, int] = (64, 48), step: int = 1) -> Frame:
    plane = np.full((size[1] // step, size[0]), level, np.uint8)
    plane[:, : size[0] // 2] = 200
    return Frame(
        index, index, Fraction(1, 50), plane, None, None, 8, full_range=True, matrix="bt601", row_origin=0,
        row_step=step, kind="", repeated=False, owner=None,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("promised", "there", "kept"),
    [
        (110, 110, range(0, 110, 10)),  # every eleventh part
        (0, 110, range(0, 110, 54)),  # of ten seconds at 60 frames/s
        (5, 5, range(5)),
        (110, 300, range(0, 300, 20)),  # 30 were taken: every second one
    ],
)
def test_a_dozen_small_frames_spread_over_a_recording_are_kept(
    promised: int, there: int, kept: range, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thumbnails, "small_jpeg", lambda one: f"{one.index}".encode())

    class Source(list[Any]):
        expected_frames, other = promised, "kept"

    recording = WithThumbnails(Source(frame(k) for k in range(there)))  # type: ignore[arg-type]
    assert (len(list(recording)), recording.other) == (there, "kept")
    list(recording)  # read again, it begins anew
    shown = json.loads(recording.to_json())
    assert [int(base64.b64decode(one["jpeg"])) for one in shown] == list(kept)
    assert [one["time_s"] for one in shown] == [pytest.approx(k / 50) for k in kept]


@pytest.mark.parametrize("step", [1, 2])
def test_a_small_frame_is_320_px_wide_and_a_field_as_high_as_its_frame(step: int) -> None:
    shown = cv2.imdecode(np.frombuffer(small_jpeg(frame(0, 40, (640, 480), step)), np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    assert shown.shape == (240, 320, 3)
    assert abs(int(shown[120, 20, 0]) - 200) < 8
    assert abs(int(shown[120, 300, 2]) - 40) < 8


@pytest.mark.parametrize(
    ("wanted", "numbers"),
    [
        ({"first": 3}, [3]), ({"first": 3, "count": 4}, [3, 4, 5, 6]), ({"first": 8, "count": 4}, [8, 9]),
        ({"first": 12, "count": 4}, [12]), ({"first": 7, "count": 4, "near": True}, [5]),
    ],
)  # fmt: skip
def test_frames_are_answered_by_their_numbers_within_the_recording(
    wanted: dict[str, Any], numbers: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    contents = SimpleNamespace(time_s=list(range(10)), key_frames=[0, 5], size_px=(6, 4))
    source = SimpleNamespace(contents=contents, key_frame=lambda number: number // 5 * 5, image=lambda number: number)
    monkeypatch.setattr(decoder, "_frames_of", lambda *_: source)
    monkeypatch.setattr(decoder, "jpeg", lambda image, most_px: (image, most_px))
    opened: Any = OrderedDict()
    found = decoder._answer(opened, "frames", Wanted(Path("a"), most_px=9, **wanted))
    assert found == [(number, (number, 9)) for number in numbers]
    assert decoder._answer(opened, "contents", Path("a"), None) == vars(contents)


def test_three_recordings_stay_open_and_the_one_not_asked_for_longest_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events: list[str] = []

    class Frames:
        def __init__(self, path: Path, rate_hz: float | None) -> None:
            self.name = f"{path.name}{rate_hz or ''}"
            events.append(f"open {self.name}")

        def close(self) -> None:
            events.append(f"close {self.name}")

    monkeypatch.setattr("evaluator.recording.seek.Frames", Frames)
    for name in "abcd":
        (tmp_path / name).write_text(name)
    opened: Any = OrderedDict()
    for name in "abcab":
        decoder._frames_of(opened, tmp_path / name, None)
    assert events == ["open a", "open b", "open c"]
    decoder._frames_of(opened, tmp_path / "d", None)
    assert events[3:] == ["close c", "open d"]
    (tmp_path / "d").write_text("longer")
    decoder._frames_of(opened, tmp_path / "d", 30.0)
    assert events[5:] == ["close a", "open d30.0"]
    with pytest.raises(InputError, match="e: no such file"):
        decoder._frames_of(opened, tmp_path / "e", None)


@pytest.mark.parametrize(("most_px", "size"), [(0, (60, 40)), (60, (60, 40)), (30, (30, 20)), (1, (1, 1))])
def test_an_image_is_no_wider_than_asked_for(most_px: int, size: tuple[int, int]) -> None:
    image = cv2.imdecode(
        np.frombuffer(decoder.jpeg(np.zeros((40, 60, 3), np.uint8), most_px), np.uint8), cv2.IMREAD_COLOR
    )
    assert image is not None
    assert image.shape[1::-1] == size


def test_a_preview_shows_the_frame_whose_dots_were_found_and_the_newest_one_where_they_are_late(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[int] = []
    finding: list[Future[dict[str, Any]]] = []

    def submit(_: Any, one: Frame) -> Future[dict[str, Any]]:
        asked.append(one.index)
        finding.append(Future())
        return finding[-1]

    monkeypatch.setattr(live, "SOON_S", 0.0)
    monkeypatch.setattr(live, "FIRST_FRAME_S", 0.01)
    monkeypatch.setattr(decoder, "jpeg", lambda image, most_px: (image.shape, most_px))
    bench = live._Bench(LiveSource("0"))
    bench._finder.shutdown()
    bench._finder = SimpleNamespace(submit=submit)  # type: ignore[assignment]
    with pytest.raises(InputError, match="0: delivers no frames"):
        bench._look()
    for index in (1, 2):
        bench._latest = frame(index)
        image, found = bench._look()
        assert image == ((48, 64, 3), 1280)
        assert (found["late"], found["centers_px"], found["size_px"]) == (True, [], [64, 48])
        assert bench._shown.index == index
    finding[0].set_result({"centers_px": [[1.0, 2.0]]})
    bench._latest = frame(3)
    _, found = bench._look()
    assert (found["late"], found["centers_px"], bench._shown.index, asked) == (False, [[1.0, 2.0]], 1, [1])
    bench._look()
    assert asked == [1, 3]


def test_cameras_have_their_device_and_the_name_that_the_system_gives_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live.sys, "platform", "linux")
    devices = [Path("/sys/class/video4linux/video2"), Path("/sys/class/video4linux/video0")]
    monkeypatch.setattr(Path, "glob", lambda *_: devices)

    def named(path: Path, **_: Any) -> str:
        if "video2" in str(path):
            raise OSError
        return "Microscope\n"

    monkeypatch.setattr(Path, "read_text", named)
    assert live.cameras_here() == [
        {"name": "/dev/video0", "words": "Microscope (video0)"}, {"name": "/dev/video2", "words": "camera (video2)"},
    ]  # fmt: skip
    monkeypatch.setattr(live.sys, "platform", "darwin")
    assert [one["name"] for one in live.cameras_here()] == ["0", "1", "2"]
