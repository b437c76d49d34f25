"""Images that cannot be used are left out and named; no image ends in a traceback."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from calibration.assignment.array_in_image import find_array
from calibration.camera import camera_above
from calibration.detection.ellipse_fit import fit_dots
from calibration.detection.image import read_image
from calibration.errors import CalibrationError
from calibration.gauge.geometry import load_gauge
from evaluator.cli.camera.calibrate import calibrate, dots
from tests.calibration.drawing import draw_gauge, random_poses
from tests.calibration.grid_images import loose_circles

GAUGE = 'format = 1\nname = "plate"\n[dots]\ncolumns = 8\nrows = 6\npitch_mm = 3.0\ndiameter_mm = 1.4\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("left-out")
    (folder / "gauge.toml").write_text(GAUGE, encoding="utf-8")
    gauge = load_gauge(folder / "gauge.toml")
    camera = camera_above(size_px=(320, 240), focal_px=900, distance_mm=100, tilt_deg=4)
    rng = np.random.default_rng(2)
    for k, view in enumerate(random_poses(camera, 4, rng, tilt_deg=25, shift_mm=1)):
        cv2.imwrite(str(folder / f"g{k}.png"), draw_gauge(view, gauge, rng=rng, snr=50))
    cv2.imwrite(str(folder / "white.png"), np.full((240, 320), 255, np.uint8))
    cv2.imwrite(str(folder / "large.png"), np.full((480, 640), 255, np.uint8))
    (folder / "cut.png").write_bytes((folder / "g0.png").read_bytes()[:500])
    return folder


def run(folder: Path, *names: str) -> tuple[str, BaseException | None]:
    paths = [name if name.startswith("-") else str(folder / name) for name in names]
    arguments = [*paths, "--gauge", str(folder / "gauge.toml"), "-o", str(folder / "camera.json"), "--no-page"]
    done = CliRunner().invoke(calibrate, arguments)
    return done.output, done.exception


def test_bad_images_are_left_out_and_named_with_the_reason(folder: Path) -> None:
    output, error = run(folder, "g0.png", "cut.png", "g1.png", "white.png", "g2.png", "large.png", "g3.png")
    assert error is None, output
    assert output.startswith("4 images, 192 dots")
    for said in (
        "cut.png: an image that is damaged",
        "white.png: 0 dots of color black",
        "large.png: 640×480 pixels, but",
    ):
        assert said in output


def test_bad_image_is_an_error_where_the_plate_or_the_count_needs_it_or_strict_asks(folder: Path) -> None:
    for names, said in (
        (("white.png", "g0.png", "g1.png", "g2.png"), "defines the plate frame"),
        (("g0.png", "white.png", "g1.png"), "1 of 3 images cannot be used, and at least 3 must remain"),
        (("g0.png", "white.png", "g1.png", "g2.png", "--strict"), "white.png: 0 dots"),
    ):
        error = run(folder, *names)[1]
        assert isinstance(error, CalibrationError)
        assert said in str(error)


def odd_images() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    disc = np.full((200, 300), 255, np.uint8)
    grey = cv2.circle(disc.copy(), (150, 100), 99, 20, -1)
    blobs = np.full((400, 600), 255, np.uint8)
    for x, y in rng.uniform(0, 1, (4000, 2)) * (600, 400):
        cv2.circle(blobs, (int(x), int(y)), 3, 30, -1)
    return {
        "white": disc,
        "deep white": np.full((200, 300), 65535, np.uint16),
        "disc that touches the rim": grey,
        "disc beyond the rim": cv2.circle(disc.copy(), (150, 100), 170, 20, -1),
        "four channels": cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA)[:, :, :3],
        "thousands of blobs": blobs,
        "strip": np.full((12, 900), 90, np.uint8),
        "loose circles": loose_circles(rng),
    }


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", list(odd_images()))
def test_odd_image_is_searched_without_a_fault(name: str) -> None:
    found, lattice = find_array(odd_images()[name])
    assert np.isfinite(found.centers_px).all()
    assert len(lattice) <= len(found)


@pytest.mark.parametrize(
    ("image", "said"),
    [(np.zeros((1, 1), np.uint8), "1×1 pixels, too small"), (np.full((90, 90), np.nan, np.float32), "NaN or infinite")],
)
def test_image_that_can_hold_no_dots_is_refused_with_the_reason(tmp_path: Path, image: np.ndarray, said: str) -> None:
    path = tmp_path / "image.tiff"
    cv2.imwrite(str(path), image)
    with pytest.raises(CalibrationError, match=said):
        read_image(path)


def test_dozen_large_circles_are_counted_by_the_command(tmp_path: Path) -> None:
    for seed in range(4):
        path = tmp_path / f"circles-{seed}.png"
        cv2.imwrite(str(path), loose_circles(np.random.default_rng(seed)))
        done = CliRunner().invoke(dots, [str(path)])
        assert done.exit_code == 0, done.output
        assert "dots found" in done.output


@pytest.mark.parametrize("matrix", [(1e-12, 0.0, 1.0), (1.0, 1.0, 1.0), (-1.0, 0.0, 1.0), (np.nan, 0.0, 1.0)])
def test_degenerate_ellipse_is_no_dot_and_claims_no_memory(matrix: tuple[float, float, float]) -> None:
    start = np.array([[50.0, 50.0, *matrix, 1.0, 200.0, -100.0, 0.0, 0.0]])
    fitted, _, noise = fit_dots(np.full((100, 100), 200, np.float32), start, np.array([5.0]))
    assert np.isnan(noise).all()
    assert np.isnan(fitted).all()
