"""Bad images end in one sentence that says what was found, never in a camera."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from calibration.assessment.quality import assess
from calibration.camera import Camera, camera_above
from calibration.detection.image import read_image
from calibration.errors import CalibrationError
from calibration.estimation.calibrate import calibrate
from calibration.gauge.geometry import Gauge
from evaluator.cli.camera.calibrate import calibrate as command
from tests.calibration.drawing import draw_gauge, gauge_of, random_poses

CAMERA = camera_above(size_px=(480, 360), focal_px=1200, distance_mm=120, tilt_deg=3, k1=-0.2)
FIDUCIALS = tuple({"column": c, "row": r, "diameter_mm": 1.9} for c, r in ((6, 4), (9, 4), (6, 2)))


GAUGE = gauge_of()


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [draw_gauge(v, GAUGE, rng=rng, snr=40) for v in random_poses(CAMERA, 4, rng, tilt_deg=25, shift_mm=2)]


@pytest.fixture(scope="module")
def calibrated(images: list[np.ndarray]) -> Camera:
    return calibrate(images, GAUGE).camera


@pytest.fixture(scope="module")
def marked() -> np.ndarray:
    return draw_gauge(CAMERA, gauge_of(fiducial=FIDUCIALS), rng=np.random.default_rng(1), snr=40)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (gauge_of(columns=11, rows=8), "array of about 13 × 9 dots .* does not fit the gauge"),
        (gauge_of(columns=15, rows=11), "array of about 13 × 9 dots .* does not fit the gauge"),
        (gauge_of(layout="staggered"), "are pitch_mm and layout in its file those of this plate"),
        (gauge_of(pitch_mm=(3.0, 4.0)), "are pitch_mm and layout in its file those of this plate"),
        (
            gauge_of(color="white", background="black"),
            r"dots of color white found, but \d+ of color black on white; exchange color",
        ),
        (gauge_of(fiducial=FIDUCIALS), "fiducial dots of the gauge .* are not visible"),
    ],
)
def test_gauge_file_of_another_plate_is_named_as_the_cause(images: list[np.ndarray], wrong: Gauge, said: str) -> None:
    with pytest.raises(CalibrationError, match=said):
        calibrate(images[:2], wrong)  # a single one may look like a tilted view of the wrong plate


def test_plate_upside_down_is_told_by_its_fiducials(marked: np.ndarray) -> None:
    with pytest.raises(CalibrationError, match="the image is mirrored"):
        calibrate([np.ascontiguousarray(marked[:, ::-1])], gauge_of(fiducial=FIDUCIALS))


@pytest.mark.parametrize(("corners", "said"), [(4, "not discs but squares"), (6, "not discs but hexagons")])
def test_marks_that_are_not_discs_are_told(corners: int, said: str) -> None:
    image = np.zeros((4 * 360, 4 * 480), np.uint8)
    angle = (np.arange(corners) + 0.5) * 2 * np.pi / corners
    rim = 0.65 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    for x, y in GAUGE.positions_mm().reshape(-1, 2):
        at = CAMERA.image_from_plate(rim + np.array([x, y, 0.0]))
        cv2.fillPoly(image, [np.rint(16 * (4 * at + 1.5)).astype(np.int32)], 255, shift=4)
    dark = cv2.GaussianBlur(cv2.resize(image, (480, 360), interpolation=cv2.INTER_AREA), (0, 0), 0.8)
    with pytest.raises(CalibrationError, match=said):
        calibrate([(220 - 0.7 * dark).astype(np.uint8)], GAUGE)


def test_two_plates_in_view_are_told(images: list[np.ndarray]) -> None:
    small = cv2.resize(images[0], (230, 172), interpolation=cv2.INTER_AREA)
    both = np.full((360, 480), 200, np.uint8)
    both[4:176, 4:234], both[184:356, 246:476] = small, small
    with pytest.raises(CalibrationError, match="two dot arrays in view"):
        calibrate([both], GAUGE)


@pytest.mark.parametrize("kind", ["noise", "gradient", "chessboard"])
def test_image_of_something_else_is_told(kind: str) -> None:
    y, x = np.mgrid[:360, :480]
    image = {
        "noise": np.random.default_rng(0).integers(0, 255, x.shape),
        "gradient": x // 2,
        "chessboard": (x // 40 + y // 40) % 2 * 200,
    }[kind]
    with pytest.raises(CalibrationError, match=r"is it a sharp image of a dot gauge|form a regular array"):
        calibrate([image.astype(np.uint8)], GAUGE)


def test_image_blurred_beyond_use_is_refused(images: list[np.ndarray]) -> None:
    with pytest.raises(CalibrationError, match="too blurred"):
        calibrate([cv2.GaussianBlur(image, (0, 0), 9) for image in images], GAUGE)


def test_images_of_different_size_are_refused(images: list[np.ndarray]) -> None:
    with pytest.raises(CalibrationError, match="images differ in size: image 1 480×360, image 2 480×300"):
        calibrate([images[0], images[1][:300]], GAUGE)


def test_grey_colour_and_16_bit_images_give_the_same_camera(images: list[np.ndarray], calibrated: Camera) -> None:
    grey = calibrated.parameters
    colour = calibrate([np.repeat(p[:, :, None], 3, axis=2) for p in images], GAUGE).camera.parameters
    deep = calibrate([p.astype(np.uint16) * 257 for p in images], GAUGE).camera.parameters
    assert np.allclose(grey, colour, atol=1e-3)
    assert np.allclose(grey, deep, atol=1e-3)


def test_strong_jpeg_blocks_are_survived_with_wider_intervals(images: list[np.ndarray], calibrated: Camera) -> None:
    coded = [cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 10])[1], 0) for image in images]
    blocky = calibrate(coded, GAUGE).camera
    assert blocky.sigma("focal_px") > 1.5 * calibrated.sigma("focal_px")
    assert abs(blocky.value("focal_px") - 1200) < 4 * blocky.sigma("focal_px")


def test_one_image_many_times_is_ill_conditioned_for_being_parallel(images: list[np.ndarray]) -> None:
    verdict = assess(calibrate([images[0]] * 4, GAUGE))
    assert verdict.level == "ill-conditioned"
    assert "parallel" in verdict.summary


def test_failed_calibration_leaves_no_file(tmp_path: Path) -> None:
    image, gauge, out = tmp_path / "p.png", tmp_path / "gauge.toml", tmp_path / "camera.json"
    cv2.imwrite(str(image), np.full((100, 100), 128, np.uint8))
    gauge.write_text(
        'format = 1\nname = "g"\n[dots]\ncolumns = 5\nrows = 4\npitch_mm = 3.0\ndiameter_mm = 1.0\n', encoding="utf-8"
    )
    run = CliRunner().invoke(command, [str(image), "--gauge", str(gauge), "-o", str(out)])
    assert isinstance(run.exception, CalibrationError)
    assert not out.exists()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(400), "HEIC photograph.*save it as JPEG or PNG"),
        (b"\xff\xd8\xff\xe0\0\x10JFIF\0" + bytes(40), "damaged or cut off"),
        (b"\x89PNG\r\n\x1a\n" + bytes(40), "damaged or cut off"),
        (b"hello, this is no image", "not a readable image"),
    ],
)
def test_a_file_that_is_no_image_is_told_apart_from_one_that_is_damaged(
    tmp_path: Path, content: bytes, said: str
) -> None:
    path = tmp_path / "photograph.jpg"
    path.write_bytes(content)
    with pytest.raises(CalibrationError, match=said):
        read_image(path)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg"])
def test_a_photograph_that_is_cut_off_is_one_sentence_and_nothing_else(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], suffix: str
) -> None:
    path = tmp_path / f"cut{suffix}"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(CalibrationError):
        read_image(path)
    assert capfd.readouterr().err == ""  # nothing of the libraries' own


@pytest.mark.parametrize(
    ("shape", "seen"),
    [
        ((12, 15), (12, 15)),
        ((12, 15, 2), (12, 15)),  # grey and its opacity
        ((12, 15, 3), (12, 15, 3)),
        ((12, 15, 4), (12, 15, 3)),
        ((11, 15), "15×11 pixels, too small to hold a dot array"),
        ((12, 11, 3), "11×12 pixels"),
    ],
)
def test_an_image_has_no_opacity_and_twelve_pixels_along_either_side(
    shape: tuple[int, ...], seen: tuple[int, ...] | str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (path := tmp_path / "a.png").touch()
    pixels = np.arange(np.prod(shape)).reshape(shape) % 251
    monkeypatch.setattr("calibration.detection.image.read_pixels", lambda _: pixels)
    if isinstance(seen, str):
        with pytest.raises(CalibrationError, match=seen):
            read_image(path)
        return
    found = read_image(path)
    assert found.shape == seen
    np.testing.assert_array_equal(found[..., 0] if found.ndim == 3 else found, pixels.reshape(*shape[:2], -1)[..., 0])
