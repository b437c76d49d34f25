"""turnscope calibrate, dots and check-camera as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from calibration.assignment.lattice import Lattice, array_size
from calibration.camera import camera_above
from calibration.estimation.gauge_as_printed import stretched
from calibration.gauge.geometry import load_gauge
from evaluator.cli.camera.calibrate import calibrate, check_camera, dots
from tests.calibration.drawing import draw_gauge, random_poses

GAUGE = """format = 1
name = "plate"
[dots]
columns = 11
rows = 8
pitch_mm = 3.0
diameter_mm = 1.2
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibration")
    (folder / "gauge.toml").write_text(GAUGE, encoding="utf-8")
    gauge = load_gauge(folder / "gauge.toml")
    camera = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=4, k1=-0.3)
    rng = np.random.default_rng(2)
    for k, view in enumerate(random_poses(camera, 5, rng, tilt_deg=25, shift_mm=2)):
        cv2.imwrite(str(folder / f"g{k}.png"), draw_gauge(view, gauge, rng=rng, snr=50))
    return folder


def test_images_become_camera_page_and_verdict(folder: Path) -> None:
    images = [str(path) for path in sorted(folder.glob("g*.png"))]
    out = folder / "camera.json"
    run = CliRunner().invoke(calibrate, [*images, "--gauge", str(folder / "gauge.toml"), "-o", str(out)])
    assert run.exit_code == 0, run.output
    assert "sound: lengths and turning radii at 6.5 mm" in run.output
    stored = json.loads(out.read_text(encoding="utf-8"))
    assert stored["verdict"]["level"] == "sound"
    assert stored["gauge"]["dots"]["columns"] == 11
    page = out.with_suffix(".html").read_text(encoding="utf-8")
    assert page.count("<svg") >= 4
    assert "Uncertainty over the image" in page
    axes = folder / "axes.png"
    checked = CliRunner().invoke(check_camera, [str(out), images[0], "--annotate", str(axes)])
    assert cv2.imread(str(axes)).shape == (300, 400, 3)
    assert checked.exit_code == 0, checked.output
    assert "the calibration holds" in checked.output


def test_calibration_of_a_stretched_gauge_holds_for_the_file_that_states_one_pitch(folder: Path) -> None:
    stated = load_gauge(folder / "gauge.toml")
    camera, rng = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=4), np.random.default_rng(5)
    images = [str(folder / f"long{k}.png") for k in range(4)]
    for path, view in zip(images, random_poses(camera, 4, rng, tilt_deg=25, shift_mm=2), strict=True):
        cv2.imwrite(path, draw_gauge(view, stretched(stated, 0.006), rng=rng, snr=50))
    file, out = str(folder / "gauge.toml"), str(folder / "long.json")
    assert CliRunner().invoke(calibrate, [*images, "--gauge", file, "-o", out, "--no-page"]).exit_code == 0
    checked = CliRunner().invoke(check_camera, [out, images[0], "--gauge", file])
    assert checked.exit_code == 0, checked.output
    assert "the calibration holds" in checked.output
    assert "% longer along columns than rows in the images of the calibration" in checked.output


def test_plate_image_named_by_option_defines_the_frame(folder: Path) -> None:
    images = [str(path) for path in sorted(folder.glob("g*.png"))]
    frames = []
    for order in (images, images[::-1]):
        out = folder / "again.json"
        arguments = [*order, "--gauge", str(folder / "gauge.toml"), "--plate", images[0], "-o", str(out), "--no-page"]
        assert CliRunner().invoke(calibrate, arguments).exit_code == 0
        frames.append(json.loads(out.read_text(encoding="utf-8"))["parameters"])
    assert frames[0] == pytest.approx(frames[1], abs=1e-4)


def test_dots_are_counted_and_drawn_without_a_gauge_file(folder: Path) -> None:
    run = CliRunner().invoke(dots, [str(folder / "g0.png"), "--annotate", str(folder / "seen")])
    assert run.exit_code == 0, run.output
    assert "88 assigned to a square array of 11 × 8" in run.output
    assert f"written: {folder / 'seen' / 'g0-dots.png'}" in run.output
    assert cv2.imread(str(folder / "seen" / "g0-dots.png")).shape == (300, 400, 3)


@pytest.mark.parametrize("turned", [False, True])
def test_an_array_is_counted_across_and_down_as_the_image_shows_it(turned: bool) -> None:
    column, row = (each.ravel() for each in np.meshgrid(range(4), range(3), indexing="ij"))
    points = 20.0 * np.column_stack([column, row])
    index = np.column_stack([row, -column] if turned else [column, row])
    assert array_size(Lattice(np.arange(12), index), points) == ("square", 4, 3)


@pytest.mark.parametrize(
    ("level", "outcome", "status"), [("sound", "holds", 0), ("doubtful", "holds", 0), ("sound", "no longer holds", 1)]
)
def test_a_check_says_what_the_calibration_is_worth_and_its_status_tells_whether_it_holds(
    level: str, outcome: str, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    verdict = SimpleNamespace(level=level, summary=f"{level}, seen from one side", mark_height_mm=6.5)
    stored = SimpleNamespace(gauge=None, flatness=None, variance=1.0, verdict=verdict, camera=lambda: None)
    found = SimpleNamespace(outcome=outcome, summary=f"The camera {outcome}.", dots=90, rms_px=0.04, shift_mm=0.1)
    monkeypatch.setattr("calibration.store.load_camera_file", lambda _: stored)
    monkeypatch.setattr("calibration.estimation.gauge_as_printed.excess_found", lambda *_: None)
    monkeypatch.setattr("calibration.detection.image.read_image", lambda _: None)
    monkeypatch.setattr("calibration.assessment.camera_check.check_camera", lambda *_, **__: found)
    done = CliRunner().invoke(check_camera, ["camera.json", "today.png"])
    assert done.exit_code == status, done.output
    assert f"The camera {outcome}." in done.output
    assert ("note: the calibration itself is doubtful, seen from one side" in done.output) == (level == "doubtful")
