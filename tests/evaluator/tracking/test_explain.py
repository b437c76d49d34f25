from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from evaluator.cli.measurement.track import track
from evaluator.recording import Frame, open_recording
from evaluator.tracking import TrackingSettings
from evaluator.tracking import track as track_recording
from evaluator.tracking.detection.explain import explain
from evaluator.tracking.luma_marks.explain import explain_luma
from tests.evaluator.tracking.drawn_tags import tag_clip
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
        ((93, 105, 96), {"mark": {"green": {}}}, "too pale"),
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


def test_a_mark_that_touches_something_of_another_hue_is_listed_by_itself(tmp_path: Path) -> None:
    canvas = texture(np.random.default_rng(6), strength=6.0)
    paint(canvas, ellipse(120, 50), (200.0, 120.0), 0.0, (190, 110, 60))  # a hand
    paint(canvas, ellipse(40, 40), (135.0, 120.0), 0.0, (40, 160, 70))
    clip = Clip([finished(np.random.default_rng(6), canvas)], {}, 20.0)
    (seen,) = explain(next(iter(open_recording(clip.write(tmp_path)))), TrackingSettings(mark={"green": {}}))
    (ball,) = [one for one in seen.blobs if np.hypot(*np.subtract(one.blob.center_px, (135.0, 120.0))) < 4]
    assert 1.8 * ball.blob.radius_px == pytest.approx(36.0, rel=0.1)
    assert 82 < ball.hue_deg < 172


def test_the_command_draws_what_the_search_saw_and_points_to_it(tmp_path: Path) -> None:
    video, sheet = moving(BLUE).write(tmp_path), tmp_path / "search.png"
    told = CliRunner().invoke(track, [str(video), "-o", str(tmp_path / "m.csv"), "-q"])
    assert "--explain search.png shows all candidates" in str(told.exception)
    shown = CliRunner().invoke(track, [str(video), "-o", str(tmp_path / "m.csv"), "-q", "--explain", str(sheet)])
    assert f"see {sheet}" in str(shown.exception)
    image = cv2.imread(str(sheet))
    assert image is not None
    assert image.shape[1] == 1240
    assert len(image) > 8 * 300  # four frames, two marks


def test_a_colour_read_off_the_image_is_found_under_a_tinted_lamp(tmp_path: Path) -> None:
    clip = moving(SAND, floor=LAMP)
    settings = TrackingSettings.model_validate({"mark": {"car": {"color": "#c8a030"}}})
    table = track_recording(open_recording(clip.write(tmp_path)), settings)
    error = table[["car_x_px", "car_y_px"]].to_numpy() - clip.truth["car"]
    assert (table["car_status"][2:] == "ok").all()
    assert np.abs(error[2:]).max() < 0.3


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ({"kind": "aruco", "id": 7}, "chosen"),
        ({"kind": "aruco", "id": 3}, "not number 3: say id = 7"),
        ({"kind": "apriltag", "id": 7}, 'say kind = "aruco", dictionary = "4x4_1000"'),
    ],
)
def test_each_tag_is_told_why_it_is_not_the_mark(tmp_path: Path, said: dict[str, object], reason: str) -> None:
    clip = tag_clip(np.random.default_rng(3), "aruco", frames=2)
    (frame, _) = open_recording(clip.write(tmp_path))
    (seen,) = explain_luma(frame, TrackingSettings.model_validate({"mark": {"tag": said}}))
    first = seen.things[0]
    assert np.hypot(*np.subtract(first.center_px, clip.truth["tag_7"][0])) < 2
    assert reason in first.verdict
    assert first.chosen == (reason == "chosen")


def lamps(folder: Path, places: tuple[tuple[int, int, int], ...]) -> Frame:
    """A frame with lights of given diameters on a dark floor."""
    canvas = texture(np.random.default_rng(2), strength=3.0) * 0.3
    for x, y, size in places:
        paint(canvas, ellipse(size, size), (x, y), 0.0, (250, 250, 250))
    clip = Clip([finished(np.random.default_rng(4), canvas)] * 2, {}, 4.0)
    return next(iter(open_recording(clip.write(folder))))


@pytest.mark.parametrize(
    ("third", "reason"),
    [((160, 60, 3), "too weak"), ((160, 60, 8), "one of 3 where 2 are sought"), ((160, 60, 90), "too large")],
)
def test_each_light_is_told_why_it_is_not_the_mark(tmp_path: Path, third: tuple[int, int, int], reason: str) -> None:
    frame = lamps(tmp_path, ((80, 120, 8), (240, 120, 8), third))
    seen = explain_luma(frame, TrackingSettings.model_validate({"mark": {n: {"kind": "light"} for n in "ab"}}))
    assert [one.mark for one in seen] == ["a", "b"]
    (verdict,) = [one.verdict for one in seen[0].things if np.hypot(*np.subtract(one.center_px, third[:2])) < 3]
    assert reason in verdict
    assert sum(one.chosen for one in seen[0].things) == (0 if "one of 3" in reason else 2)


def test_the_command_draws_what_the_search_for_tags_saw(tmp_path: Path) -> None:
    clip = tag_clip(np.random.default_rng(3), "aruco", frames=6)
    (tmp_path / "t.toml").write_text('[mark.tag_3]\nkind = "aruco"\n', encoding="utf-8")
    sheet, said = tmp_path / "search.png", ["-q", "--settings", str(tmp_path / "t.toml"), "-o", str(tmp_path / "m.csv")]
    told = CliRunner().invoke(track, [str(clip.write(tmp_path)), "--explain", str(sheet), *said])
    assert "no mark was found" in str(told.exception)
    image = cv2.imread(str(sheet))
    assert image is not None
    assert image.shape[1] == 1240


def test_a_search_for_colours_tells_nothing_of_tags_and_of_a_frame_without_any() -> None:
    tag = TrackingSettings.model_validate({"mark": {"roof": {"kind": "aruco", "id": 3}}})
    assert explain(SimpleNamespace(u=1), tag) == []  # type: ignore[arg-type]
    assert explain(SimpleNamespace(u=None), TrackingSettings()) == []  # type: ignore[arg-type]
