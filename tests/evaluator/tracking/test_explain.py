from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from evaluator.cli.track import track
from evaluator.recording import open_recording
from evaluator.tracking import TrackingSettings
from evaluator.tracking import track as track_recording
from evaluator.tracking.detection.explain import explain
from tests.evaluator.tracking.plain_video import Clip, ellipse, finished, paint, texture

BLUE, SAND, LAMP = (50, 90, 200), (200, 160, 48), (150.0, 110.0, 70.0)


def moving(color: tuple[int, int, int], *, floor: tuple[float, float, float] | None = None, size: float = 18.0) -> Clip:
    rng = np.random.default_rng(5)
    ground, images = texture(rng, strength=6.0), []
    if floor is not None:
        ground = ground - ground.mean(axis=(0, 1)) + np.array(floor)
    path = np.stack([40 + 6.0 * np.arange(30), np.full(30, 120.0)], axis=-1)
    for center in path:
        canvas = ground.copy()
        paint(canvas, ellipse(size, size), tuple(center), 0.0, color)
        images.append(finished(rng, canvas))
    return Clip(images, {"car": path}, size / 2)


@pytest.mark.parametrize(
    ("color", "settings", "reason"),
    [
        (BLUE, {"mark": {"green": {}}}, "is not within 82 to 172: say color or hue_deg"),
        (BLUE, {"mark": {"car": {"color": "#325ac8", "diameter_px": 60}}}, "is not about diameter_px = 60"),
        (BLUE, {"mark": {"car": {"color": "#325ac8", "region_px": [0, 0, 30, 30]}}}, "outside region_px"),
        ((92, 106, 96), {"mark": {"green": {}}}, "too pale"),
        (BLUE, {"mark": {"car": {"color": "#325ac8"}}}, "chosen"),
    ],
)
def test_each_blob_is_told_why_it_is_not_the_mark(
    tmp_path: Path, color: tuple[int, int, int], settings: dict[str, object], reason: str
) -> None:
    clip = moving(color)
    frames = list(open_recording(clip.write(tmp_path)))
    (seen,) = explain(frames[12], TrackingSettings.model_validate(settings))
    at_mark = [one for one in seen.blobs if np.hypot(*np.subtract(one.blob.center_px, clip.truth["car"][12])) < 3]
    assert any(reason in one.verdict for one in at_mark)
    assert all(one.chosen == (reason == "chosen") for one in at_mark)


def test_the_command_draws_what_the_search_saw_and_points_to_it(tmp_path: Path) -> None:
    video, sheet = moving(BLUE).write(tmp_path), tmp_path / "search.png"
    told = CliRunner().invoke(track, [str(video), "-o", str(tmp_path / "m.csv"), "-q"])
    assert "see what the search saw with --explain search.png" in str(told.exception)
    shown = CliRunner().invoke(track, [str(video), "-o", str(tmp_path / "m.csv"), "-q", "--explain", str(sheet)])
    assert f"see {sheet}" in str(shown.exception)
    image = cv2.imread(str(sheet))
    assert image.shape[1] == 1240
    assert len(image) > 8 * 300  # four frames, two marks


def test_a_colour_read_off_the_image_is_found_under_a_tinted_lamp(tmp_path: Path) -> None:
    clip = moving(SAND, floor=LAMP)
    settings = TrackingSettings.model_validate({"mark": {"car": {"color": "#c8a030"}}})
    table = track_recording(open_recording(clip.write(tmp_path)), settings)
    error = table[["car_x_px", "car_y_px"]].to_numpy() - clip.truth["car"]
    assert (table["car_status"][2:] == "ok").all()
    assert np.abs(error[2:]).max() < 0.3
