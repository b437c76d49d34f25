"""The live camera, with a file as the virtual device: preview, dots, focus, exposure, images taken."""

from __future__ import annotations

import json
import shutil
import time
from functools import partial
from operator import add
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.workflow import LiveCamera, LiveSource
from evaluator.workflow.frames.child import Child
from evaluator.workflow.samples import sample_folder
from evaluator.workflow.viewing.cameras import light_of
from tests.evaluator.studio.live_camera import camera_file
from tests.evaluator.studio.serving import Serving
from tests.waiting import HANGS_S


def gauge_image(name: str = "gauge-1-plate.png") -> np.ndarray:
    return np.asarray(cv2.imread(str(sample_folder() / name), cv2.IMREAD_GRAYSCALE))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("gauge.toml", "gauge-1-plate.png"):
        shutil.copy(sample_folder() / name, tmp_path / name)
    camera_file(tmp_path / "camera.mkv", [gauge_image("gauge-3-tilted.png")] * 5)
    return tmp_path


def looked(studio: Serving, file: str) -> tuple[dict[str, Any], np.ndarray]:
    status, _, body = studio.ask("GET", f"/api/live/look?file={file}")
    assert status == 200, body
    length = int.from_bytes(body[:4], "big")
    image = cv2.imdecode(np.frombuffer(body[4 + length :], np.uint8), cv2.IMREAD_COLOR)
    return json.loads(body[4 : 4 + length]), np.asarray(image)


def test_what_a_camera_shows_has_its_dots_and_an_image_is_taken_without_loss_and_undone(
    studio: Serving, folder: Path
) -> None:
    (file,) = studio.get("/api/live")["files"]
    found, shown = looked(studio, file["id"])
    while found["late"]:  # what finds dots is compiled meanwhile, and the preview goes on
        found, shown = looked(studio, file["id"])
    image = gauge_image("gauge-3-tilted.png")
    assert shown.shape[:2] == image.shape
    assert sum(found["of_array"]) > 200
    assert found["blur_px"] < 2.5
    gauge = studio.get("/api/rig")["gauges"][0]["id"]
    taken = studio.post(f"/api/gauges/{gauge}/take", {"file": file["id"]})
    assert taken["name"] == "gauge-2.png"
    assert np.array_equal(np.asarray(cv2.imread(str(folder / "gauge-2.png"), cv2.IMREAD_GRAYSCALE)), image)
    assert taken["id"] in [one["id"] for one in studio.get("/api/rig")["images"]]
    assert studio.step("camera", gauge) == "the image gauge-2.png"
    assert not (folder / "gauge-2.png").exists()
    studio.post("/api/live/close", {})


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("camera=/etc/passwd", "choose a camera"),
        ("camera=http://127.0.0.1:1/x", "choose a camera"),
        ("camera=concat:a|b", "choose a camera"),
        ("camera=/dev/video999", "is it plugged in"),
        ("camera=0&size=big", "width x height"),
        ("camera=0&rate=1e9", "up to 1000"),
        ("file=0123456789abcdef", "no longer exists"),
    ],
)
def test_nothing_but_cameras_and_recordings_of_the_folder_is_opened(studio: Serving, query: str, words: str) -> None:
    status, _, body = studio.ask("GET", f"/api/live/look?{query}")
    assert (status, words in json.loads(body)["error"]) == (400, True), body


def test_a_camera_that_cannot_be_opened_and_one_without_images_are_sentences(tmp_path: Path) -> None:
    (tmp_path / "no.mkv").write_bytes(b"nothing of a video")
    live = LiveCamera()
    with pytest.raises(InputError, match="cannot be opened as a camera"):
        live.look(LiveSource(str(tmp_path / "no.mkv")))
    live.close()


def test_a_file_comes_at_the_pace_of_its_times(tmp_path: Path) -> None:
    image = gauge_image()
    images = [np.roll(image, 8 * number, axis=1) for number in range(30)]
    live, source = LiveCamera(), LiveSource(str(camera_file(tmp_path / "camera.mkv", images, rate=1)))
    first = live.look(source)[0]
    until = time.monotonic() + HANGS_S
    while live.look(source)[0] == first:  # of a file that is read at once every look shows the last frame
        assert time.monotonic() < until
    live.close()


def test_a_process_that_nobody_asks_ends_and_begins_anew() -> None:
    # Of the standard library: a process that imports this module takes as long as the rest of the test.
    child = Child(partial, (add, 1), HANGS_S, "slow", "died", idle_s=0.2)
    assert child.ask(1) == 2
    process = child._process
    process.join(HANGS_S)
    assert not process.is_alive()
    assert child.ask(2) == 3
    child.close()


@pytest.mark.parametrize(
    ("share_clipped", "level", "words"),
    [(0.015, 0.7, "saturated"), (0.004, 0.7, ""), (0.0, 0.4, ""), (0.0, 0.2, "increase the exposure time")],
)
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_light_that_is_wrong_is_said(share_clipped: float, level: float, words: str, kind: type) -> None:
    top = np.iinfo(kind).max
    image: np.ndarray = np.full((200, 100), round(level * top), kind)
    image.ravel()[: round(share_clipped * image.size)] = top
    said = light_of(image)
    assert (words in said) if words else said == ""
