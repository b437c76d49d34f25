from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration.camera import camera_above
from evaluator.errors import InputError
from evaluator.recording import open_recording
from evaluator.tracking import AsCalibrated, TrackingSettings, load_settings, place_on_plate, track
from tests.evaluator.tracking.synthetic import draw, turning_marks, write_video

REAL = Path(__file__).parents[4] / "shared" / "real"
SIZE = (240, 200)


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, np.ndarray]]:
    rng = np.random.default_rng(7)
    truth = turning_marks(40, (115.0, 100.0), 40.0, 12.0, 0.02)
    images = [
        draw(rng, SIZE, {name: tuple(points[k]) for name, points in truth.items()}, 6.0, 0.8, 3.0) for k in range(40)
    ]
    return write_video(tmp_path_factory.mktemp("clip") / "turn.mkv", images), truth


def test_marks_are_found_without_help_and_measured_within_their_uncertainty(
    turning: tuple[Path, dict[str, np.ndarray]],
) -> None:
    video, truth = turning
    table = track(open_recording(video))
    for name, points in truth.items():
        assert (table[f"{name}_status"] == "ok").all()
        error = table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() - points
        sigma = table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy()
        assert np.sqrt(np.mean(error**2)) < 0.02
        assert 0.75 < np.std(error / sigma) < 1.25


def test_marks_are_placed_on_their_plane_with_uncertainty(turning: tuple[Path, dict[str, np.ndarray]]) -> None:
    video, truth = turning
    camera = camera_above(size_px=SIZE, focal_px=12.0 * 143.5, distance_mm=150.0)
    marks = place_on_plate(track(open_recording(video)), camera, 6.5)
    assert list(marks.columns[:5]) == ["time_s", "green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm"]
    expected = (truth["green"] - [119.5, 99.5]) / [12.0, -12.0]
    assert np.abs(marks[["green_x_mm", "green_y_mm"]].to_numpy() - expected).max() < 0.01
    assert np.allclose(marks["green_x_sigma_mm"], marks["green_x_sigma_px"] / 12.0, rtol=1e-3)


def test_resting_marks_of_a_real_video_scatter_little(tmp_path: Path) -> None:
    video = REAL / "robots_from_above" / "robot_move.mp4"
    if not video.exists():
        pytest.skip("the real recordings are not beside the project")
    settings = tmp_path / "tracking.toml"
    settings.write_text(
        "format = 1\nmask_px = [[0, 0, 98, 468]]\n[mark.green]\ndiameter_px = 13\n"
        "[mark.yellow_top]\nregion_px = [440, 20, 475, 57]\n[mark.yellow_low]\nregion_px = [512, 184, 548, 220]\n"
    )
    table = track(open_recording(video), load_settings(settings))
    repeated = table["green_status"] == "repeated frame"  # the recording holds some twice while the robot drives
    assert repeated.mean() < 0.02
    assert (table["green_status"][~repeated] == "ok").mean() >= 0.99
    for name, place in {"yellow_top": (457.4, 38.5), "yellow_low": (529.4, 202.0)}.items():
        points = table[[f"{name}_x_px", f"{name}_y_px"]].dropna().to_numpy()
        assert len(points) >= 0.99 * len(table)  # the recording holds frames twice while the camera shakes
        assert np.abs(np.median(points, axis=0) - place).max() < 0.6
        assert np.std(points, axis=0).max() < 0.2


def test_a_real_ball_is_absent_while_it_is_out_of_view(tmp_path: Path) -> None:
    video = REAL / "green_ball" / "ball.mp4"
    if not video.exists():
        pytest.skip("the real recordings are not beside the project")
    settings = tmp_path / "tracking.toml"
    settings.write_text("format = 1\n[mark.green]\ndiameter_px = 40\n")
    table = track(open_recording(video), load_settings(settings))
    seen = table.loc[table["green_status"] == "ok", "frame"]
    assert len(seen) >= 8
    assert seen.between(20, 33).all()


def test_nothing_is_found_where_there_is_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    video = write_video(tmp_path / "empty.mkv", [draw(rng, SIZE, {}, 6.0, 0.8, 3.0) for _ in range(15)])
    table = track(open_recording(video), TrackingSettings())
    assert (table["green_status"] == "not seen").all()
    assert table["green_x_px"].isna().all()


@pytest.mark.parametrize(("calibrated_px", "said"), [(SIZE[::-1], "by 90 degrees"), ((640, 480), "camera mode")])
def test_frames_of_another_size_than_the_calibration_are_refused(
    turning: tuple[Path, dict[str, np.ndarray]], calibrated_px: tuple[int, int], said: str
) -> None:
    camera = camera_above(size_px=calibrated_px, focal_px=12.0 * 143.5, distance_mm=150.0)
    with pytest.raises(InputError, match=said):
        track(AsCalibrated(open_recording(turning[0]), camera))
    as_calibrated = camera_above(size_px=SIZE, focal_px=12.0 * 143.5, distance_mm=150.0)
    assert next(iter(AsCalibrated(open_recording(turning[0]), as_calibrated))).size_px == SIZE
