"""Marks of other colours, lights and tags, rendered and tracked: where they are, and how sure that is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.errors import InputError
from evaluator.pose import poses_from_marks
from evaluator.recording import open_recording
from evaluator.robot_geometry import read_geometry, sought
from evaluator.tracking import TrackingSettings, place_on_plate, track
from evaluator.tracking.luma_marks.lights import bright_blobs
from evaluator.tracking.settings import MarkSettings
from simulator.rendering import Scene, render_clip
from simulator.robot import shipped_robot_text
from tests.evaluator.tracking.synthetic import frames_in_memory

HEIGHT_MM = 6.5


def robot_file(folder: Path, marks: list[dict[str, Any]]) -> Path:
    """The barrel robot with other marks."""
    lines = [shipped_robot_text("barrel").split("[marks]")[0]]
    for mark in marks:
        lines += ["[[mark]]", *(f"{key} = {value!r}".replace("'", '"') for key, value in mark.items())]
    path = folder / "robot.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def rendered(folder: Path, robot: Path, **changes: object) -> tuple[Path, pd.DataFrame]:
    """A clip of the robot on a circle, and its truth."""
    content: dict[str, object] = {
        "format": 1,
        "seed": 3,
        "robot": str(robot),
        "duration_s": 1.0,
        "camera": {"size_px": (480, 360), "focal_px": 2250.0, "distance_mm": 150.0, "tilt_deg": 8.0},
        "motion": {"kind": "circle", "radius_mm": 6.0, "speed_mm_s": 10.0, "y_mm": -5.0},
        "encoding": {"codec": "lossless"},
    }
    truth = render_clip(Scene.model_validate(content | changes), folder / "clip.mp4")
    return folder / "clip.mp4", truth


def tracked(clip: Path, robot: Path) -> pd.DataFrame:
    return track(open_recording(clip), sought(read_geometry(robot), None))


def errors_px(table: pd.DataFrame, truth: pd.DataFrame, name: str) -> np.ndarray:
    columns = [f"{name}_x_px", f"{name}_y_px"]
    return np.asarray(table[columns].to_numpy() - truth[columns].to_numpy())


def normal_errors(table: pd.DataFrame, truth: pd.DataFrame, name: str) -> np.ndarray:
    sigma = table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy()
    return np.asarray(errors_px(table, truth, name) / sigma)


def test_marks_of_any_colours_are_rendered_and_tracked(tmp_path: Path) -> None:
    places = {"red": (2.0, 0.0), "blue": (-1.5, 2.0), "magenta": (-1.5, -2.0)}
    robot = robot_file(tmp_path, [{"name": n, "x_mm": x, "y_mm": y} for n, (x, y) in places.items()])
    clip, truth = rendered(tmp_path, robot)
    table = tracked(clip, robot)
    for name in places:
        assert (table[f"{name}_status"] == "ok").mean() > 0.95
        assert np.nanmax(np.abs(errors_px(table, truth, name))) < 0.3
        assert np.sqrt(np.nanmean(normal_errors(table, truth, name) ** 2)) < 2.0


def test_marks_of_a_colour_nobody_says_are_asked_for_it(tmp_path: Path) -> None:
    robot = robot_file(tmp_path, [{"name": "front", "x_mm": 1.0, "y_mm": 0.0}])
    with pytest.raises(InputError, match="mark front: say its color"):
        sought(read_geometry(robot), None)
    said = TrackingSettings(mark={"front": MarkSettings(color="cyan")})
    assert sought(read_geometry(robot), said).mark["front"].hue_range("front")[0] > 150


@pytest.mark.parametrize("kind", ["aruco", "apriltag"])
def test_tags_are_rendered_and_tracked_with_honest_uncertainty(tmp_path: Path, kind: str) -> None:
    robot = robot_file(tmp_path, [{"name": "tag_7", "x_mm": 0.5, "y_mm": 0.0, "diameter_mm": 3.5, "kind": kind}])
    clip, truth = rendered(tmp_path, robot)
    table = tracked(clip, robot)
    assert (table["tag_7_status"] == "ok").all()
    assert np.sqrt((errors_px(table, truth, "tag_7") ** 2).mean()) < 0.03
    assert 0.3 < np.sqrt((normal_errors(table, truth, "tag_7") ** 2).mean()) < 2.0


def test_lights_are_tracked_and_told_from_a_glare_that_rests(tmp_path: Path) -> None:
    marks = [
        {"name": n, "x_mm": -1.0, "y_mm": y, "diameter_mm": 0.5, "kind": "light"}
        for n, y in (("light_a", 2.0), ("light_b", -2.0))
    ]
    robot = robot_file(tmp_path, marks)
    glare = {"x_mm": 12.0, "y_mm": 8.0, "diameter_mm": 0.6, "color": (2.5, 2.5, 2.5)}
    clip, truth = rendered(tmp_path, robot, distractor=[glare])
    table = tracked(clip, robot)
    seen = table["light_a_status"] == "ok"
    assert seen.sum() > 40
    assert set(table.loc[~seen, "light_a_status"]) <= {"ambiguous"}
    # Which light is which nothing shows: left and right at first.
    swapped = np.nanmean(np.abs(errors_px(table, truth, "light_a"))) > 5
    other = truth.rename(columns=lambda name: name.replace("_a_", "_c_").replace("_b_", "_a_").replace("_c_", "_b_"))
    right = other if swapped else truth
    for name in ("light_a", "light_b"):
        assert np.nanmax(np.abs(errors_px(table, right, name))) < 0.15
        assert np.sqrt(np.nanmean(normal_errors(table, right, name) ** 2)) < 2.0


def test_halo_of_a_light_does_not_draw_its_centre_to_the_brighter_surroundings() -> None:
    """A saturated light beside the edge of a robot that is darker than the plate, as cameras code it (gamma)."""
    x, y = np.meshgrid(np.arange(80), np.arange(70))
    off = np.hypot(x - 40.3, y - 34.8)
    light = np.where(x < 37, 0.02, 0.012) + 6.0 * np.exp(-((off / 2.8) ** 2)) + 0.12 / (1 + (off / 6.0) ** 2) ** 1.5
    image = 255.0 * np.minimum(light, 1.0)[..., None] ** (1 / 2.2) * np.ones(3)
    (blob,) = bright_blobs(next(frames_in_memory([image]))).blobs
    assert blob.place == pytest.approx((40.3, 34.8), abs=0.03)  # with all of the halo 0.12 px off


def test_tag_without_a_number_and_unknown_dictionary_are_refused() -> None:
    for mark, said in (
        ({"kind": "aruco"}, "without a number"),
        ({"kind": "aruco", "id": 3, "dictionary": "9x9"}, "none of OpenCV"),
    ):
        settings = TrackingSettings(mark={"tag": MarkSettings.model_validate(mark)})
        with pytest.raises(InputError, match=said):
            track([], settings)


def test_one_tag_gives_a_heading_by_its_corners(tmp_path: Path) -> None:
    mark = {"name": "tag", "id": 3, "x_mm": 0.5, "y_mm": 0.0, "diameter_mm": 3.5, "kind": "aruco"}
    robot = robot_file(tmp_path, [mark])
    clip, truth = rendered(tmp_path, robot)
    camera = camera_above(size_px=(480, 360), focal_px=2250.0, distance_mm=150.0, tilt_deg=8.0)
    poses = poses_from_marks(place_on_plate(tracked(clip, robot), camera, HEIGHT_MM), read_geometry(robot).marks())
    off = np.column_stack(
        [poses.x_mm - truth["x_mm"], poses.y_mm - truth["y_mm"], poses.heading_rad - np.radians(truth["heading_deg"])]
    )
    off[:, 2] -= 2 * np.pi * np.round(off[:, 2] / (2 * np.pi))
    assert np.abs(off[:, :2]).max() < 0.01
    assert np.degrees(np.abs(off[:, 2]).max()) < 0.2
    square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(poses.covariance), off) / 3
    assert 0.2 < square.mean() < 4.0
