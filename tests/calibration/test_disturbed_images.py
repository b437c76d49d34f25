"""What hides, disturbs or imitates dots costs those dots, never the plane."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.assessment.quality import assess
from calibration.assignment.lattice import Lattice, assign_grid
from calibration.assignment.matching import Match, match_gauge
from calibration.camera import Camera, camera_above
from calibration.detection.disturbed import useful
from calibration.detection.dots import Dots, detect_dots
from calibration.errors import CalibrationError
from calibration.estimation.calibrate import calibrate
from calibration.estimation.disc_projection import fitted_centers
from calibration.gauge.geometry import Gauge
from tests.calibration.drawing import draw_gauge, gauge_of, random_poses

CAMERA = camera_above(size_px=(480, 360), focal_px=1200, distance_mm=120, tilt_deg=3, turn_deg=4, k1=-0.2)


# Fields of `Dots` that hold a value for each dot.
PER_DOT = (
    "centers_px",
    "covariance_px2",
    "diameter_px",
    "contrast",
    "background",
    "blur_px",
    "noise",
    "shape",
    "color",
)
EXACT = {"pitch_tolerance_percent": 0.0}
GAUGE = gauge_of(**EXACT)


def drawn(seed: int = 0, snr: float = 40.0, camera: Camera = CAMERA, **options: object) -> np.ndarray:
    return draw_gauge(camera, GAUGE, rng=np.random.default_rng(seed), snr=snr, **options)  # type: ignore[arg-type]


def matched(image: np.ndarray) -> tuple[Dots, Match, np.ndarray]:
    """Dots, their places, and how far (m, 2) px the centres lie from where the camera puts them."""
    dots = detect_dots(image, "black", "white")
    match = match_gauge(dots, assign_grid(dots), GAUGE)
    points = np.pad(GAUGE.positions_mm()[match.row, match.column], ((0, 0), (0, 1)))
    true = fitted_centers(points, np.full(len(points), 0.6), CAMERA.parameters, CAMERA.lens)
    return dots, match, dots.centers_px[match.dot] - true


def within(left: float, bottom: float, right: float, top: float) -> np.ndarray:
    """Pixels that show a rectangle of the plate, mm."""
    corners = [(left, bottom, 0.0), (right, bottom, 0.0), (right, top, 0.0), (left, top, 0.0)]
    rim = np.rint(CAMERA.image_from_plate(corners) * 16).astype(np.int32)
    return cv2.fillPoly(np.zeros(CAMERA.size_px[::-1], np.uint8), [rim], 1, shift=4) > 0


@pytest.mark.parametrize("side", ["left", "right"])
def test_plate_with_a_whole_side_under_a_dark_cloth_keeps_its_places(side: str) -> None:
    image = drawn()
    hidden = slice(0, 190) if side == "left" else slice(300, None)
    image[:, hidden] = 12
    _, match, off = matched(image)
    assert 60 < len(match) < 90
    assert match.certain
    assert np.abs(off).max() < 0.1


def test_row_under_a_cloth_as_white_as_the_sheet_is_known_from_the_other_images() -> None:
    rng = np.random.default_rng(8)
    images = [draw_gauge(v, GAUGE, rng=rng, snr=40) for v in random_poses(CAMERA, 4, rng, tilt_deg=25, shift_mm=2)]
    images[0][within(-25, -16, 25, -10.5)] = 200
    found = calibrate(images, GAUGE)
    assert found.sightings[0].match.extent == ("whole", "short")
    assert any("part of the array is hidden or out of view" in note for note in assess(found).notes)
    with pytest.raises(CalibrationError, match="does nothing hide whole rows of it"):
        calibrate(images[:1], GAUGE)


def test_array_split_by_a_white_strip_stays_one_array() -> None:
    image = drawn()
    image[within(4.5, -16, 10.5, 16)] = 200
    _, match, off = matched(image)
    assert len(match) == 11 * 9
    assert set(match.column.tolist()) == set(range(13)) - {8, 9}
    assert np.abs(off).max() < 0.1


def test_row_under_a_white_cloth_darker_than_the_sheet_is_hidden_not_absent() -> None:
    image = drawn()
    image[within(-25, -16, 25, -10.5)] = 170
    match = calibrate([image], GAUGE).sightings[0].match
    assert len(match) == 13 * 8
    assert not match.certain


@pytest.mark.parametrize("columns", [12, 14])
def test_array_one_column_short_or_long_is_another_gauge(columns: int) -> None:
    with pytest.raises(CalibrationError, match=r"array of about 13 × 9 dots .* does not fit the gauge"):
        calibrate([drawn()], gauge_of(columns=columns, **EXACT))


def test_a_third_of_the_dots_missing_leaves_one_array() -> None:
    missing = tuple(np.random.default_rng(3).choice(117, 39, replace=False).tolist())
    _, match, off = matched(drawn(missing=missing))
    assert len(match) == 78
    assert np.abs(off).max() < 0.1


def test_edge_of_the_sheet_next_to_the_dots_does_not_move_them() -> None:
    image = drawn()
    image[~within(-19, -13, 19, 13)] = 70
    dots, match, off = matched(image)
    used = useful(dots.covariance_px2[match.dot])
    sigma = np.sqrt(np.einsum("nii->ni", dots.covariance_px2[match.dot]))
    assert used.mean() > 0.95
    assert np.sqrt(np.mean((off / sigma)[used] ** 2)) < 1.2


def test_large_discs_between_the_dots_do_not_shift_the_array() -> None:
    image = drawn()
    for x, y in ((100, 90), (225, 145), (310, 250), (170, 250)):
        cv2.circle(image, (x, y), 13, 40, -1, cv2.LINE_AA)
    dots, match, off = matched(image)
    used = useful(dots.covariance_px2[match.dot])
    assert used.sum() > 95
    assert np.abs(off[used]).max() < 0.1


def test_faint_images_that_continue_the_array_are_not_taken_for_it() -> None:
    dots = detect_dots(drawn(), "black", "white")
    top = dots.centers_px[:, 1] < CAMERA.image_from_plate([0.0, 10.5, 0.0])[1] - 12
    faint = replace(dots, contrast=np.where(top, 0.1, 1.0) * dots.contrast)
    assert len(assign_grid(dots)) == 117
    assert len(assign_grid(faint)) == 117 - top.sum()


def test_parts_of_an_array_are_told_apart_by_what_they_are() -> None:
    """Arrays of numbers have no one equality: taking a part off a list of others would raise."""
    parts = [Lattice(np.arange(n), np.zeros((n, 2), int)) for n in (9, 8, 8)]
    parts.remove(parts[2])
    assert [len(part) for part in parts] == [9, 8]


def test_faint_weave_of_a_cloth_beside_the_gauge_is_no_second_gauge() -> None:
    left, right = detect_dots(drawn(), "black", "white"), detect_dots(drawn(seed=1), "black", "white")
    shifted = replace(right, centers_px=right.centers_px + np.array([left.size_px[0], 0.0]))
    for contrast, others in ((1.0, len(right)), (0.1, 0)):
        weave = replace(shifted, contrast=contrast * shifted.contrast)
        both = replace(left, **{n: np.concatenate([getattr(left, n), getattr(weave, n)]) for n in PER_DOT})
        assert assign_grid(both).others == others


def test_dots_in_strong_noise_are_found_and_state_it() -> None:
    dots, match, off = matched(drawn(snr=6))
    assert len(match) > 80
    sigma = np.sqrt(np.einsum("nii->ni", dots.covariance_px2[match.dot]))
    assert 0.8 < np.sqrt(np.mean((off / sigma) ** 2)) < 1.3


def test_dots_twice_as_wide_as_the_file_says_are_another_plate() -> None:
    with pytest.raises(CalibrationError, match="ratio of dot diameter to pitch is 2 times"):
        calibrate([drawn()], gauge_of(diameter_mm=0.6, **EXACT))


def test_dots_half_as_wide_again_put_every_length_in_doubt() -> None:
    verdict = assess(calibrate([drawn()], gauge_of(diameter_mm=0.8, **EXACT)))
    assert verdict.level == "limited"
    assert "pitch_mm or diameter_mm is wrong" in verdict.summary


def test_image_of_another_camera_among_the_others_is_named() -> None:
    rng = np.random.default_rng(2)
    other = camera_above(size_px=(480, 360), focal_px=1600, distance_mm=160, tilt_deg=3, k1=0.1)
    views = random_poses(CAMERA, 4, rng, tilt_deg=25, shift_mm=2)
    views += random_poses(other, 3, rng, tilt_deg=25, shift_mm=2)[1:2]
    with pytest.raises(CalibrationError, match=r"image \d: \d+ of 117 dots contradict the other images"):
        calibrate([draw_gauge(view, GAUGE, rng=rng, snr=40) for view in views], GAUGE)


def test_measured_distance_makes_one_image_enough() -> None:
    image = drawn()
    alone, measured = calibrate([image], GAUGE), calibrate([image], GAUGE, distance_mm=(120.0, 0.3))
    assert assess(alone).level == "limited"
    assert assess(measured).scale_sigma < 0.0005
    assert "height correction" not in assess(measured).summary


@pytest.mark.parametrize(("times", "told"), [(1.0, False), (0.98, True)])
def test_a_measured_distance_that_contradicts_the_images_tells_of_the_pitch(times: float, *, told: bool) -> None:
    """With a pitch of 2.50 mm for 2.55 all lengths were 2 % too short, "sound", 6 sigmas from the measured distance."""
    rng = np.random.default_rng(4)
    views = [CAMERA, *random_poses(CAMERA, 4, rng, tilt_deg=30, shift_mm=2)]
    images = [draw_gauge(view, GAUGE, rng=rng, snr=60) for view in views]
    pitch = float(np.mean(GAUGE.pitch_mm))
    dots = GAUGE.dots.model_copy(update={"pitch_mm": pitch * times})
    found = assess(calibrate(images, GAUGE.model_copy(update={"dots": dots}), distance_mm=(120.0, 0.3)))
    assert ("as if the pitch were" in found.summary) == told
    assert (found.level == "limited") >= told
    if told:
        assert f"as if the pitch were {pitch:.4g}"[:24] in found.summary
        assert any("measure the pitch over many dots" in step for step in found.next_steps)


def test_colour_fiducials_in_a_grey_image_are_named_as_the_cause() -> None:
    fiducials = ({"column": 6, "row": 4, "color": "red"}, {"column": 9, "row": 4, "color": "blue"})
    with pytest.raises(CalibrationError, match="differ by their color, which a grey image does not show"):
        calibrate([drawn()], Gauge.model_validate(GAUGE.model_dump() | {"fiducial": fiducials}))
