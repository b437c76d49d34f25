"""Every number from which on a camera, an image or a change of the camera is judged otherwise, from either side."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from calibration.assessment import quality
from calibration.assessment.next_image import Advice, NextImage, _turned, image_notes, place_sigmas_mm
from calibration.assessment.quality import (
    _ill_conditioned,
    _misfit,
    _notes,
    _wrong_size,
    assess,
    coverage,
    tilt_spread_deg,
    worst_scale_sigma,
)
from calibration.camera import PARAMETERS, Camera, camera_above
from calibration.estimation.initial_values import rough_prior
from tests.calibration.drawing import gauge_of

SIZE, FOCAL, DISTANCE = (400, 300), 1200.0, 120.0
CAMERA = camera_above(size_px=SIZE, focal_px=FOCAL, distance_mm=DISTANCE)


def known(camera: Camera = CAMERA, **sigmas: float) -> Camera:
    """A camera with independent uncertainties of some parameters."""
    variances = [sigmas.get(name, 0.0) ** 2 for name in PARAMETERS]
    return replace(camera, covariance=np.diag(variances))


def with_values(**values: float) -> Camera:
    parameters = CAMERA.parameters.copy()
    for name, value in values.items():
        parameters[PARAMETERS.index(name)] = value
    return replace(CAMERA, parameters=parameters)


def calibration(camera: Camera = CAMERA, **said: Any) -> Any:
    """A calibration that is sound but for what is said: five images, all dots used."""
    dots = SimpleNamespace(
        size_ratio=1.0, bloom=0.0, name="g.png", match=type("M", (list,), {"certain": True})([0] * 100)
    )
    tilted = [cv2.Rodrigues(np.array([np.pi, 0.0, 0.0]))[0]]
    tilted += [cv2.Rodrigues(0.4 * np.array([np.cos(a), np.sin(a), 0.0]))[0] @ tilted[0] for a in range(4)]
    poses = np.array([[*cv2.Rodrigues(rotation)[0][:, 0], 0.0, 0.0, DISTANCE] for rotation in tilted])
    whole = SimpleNamespace(centers_px=np.array([[0.0, 0.0], [399.0, 0.0], [399.0, 299.0], [0.0, 299.0]]))
    usual: dict[str, Any] = {
        "camera": camera,
        "gauge": gauge_of(),
        "stated": gauge_of(),
        "excess": 0.0,
        "focal_difference": 0.0,
        "excess_sigma": 1e-4,
        "sightings": (dots,) * 5,
        "views": (whole,) * 5,
        "fit": SimpleNamespace(variance=1.0, state=SimpleNamespace(poses=poses)),
        "rms_px": 0.03,
        "rejected": (0,) * 5,
        "distance_mm": None,
        "flatness": SimpleNamespace(low_mm=0.0, high_mm=0.01, used=False),
        "left_out": (),
    }
    return SimpleNamespace(**usual | said)


def test_sound_calibration_says_so_without_a_reason() -> None:
    verdict = assess(calibration(known(focal_px=0.1)))
    assert (verdict.level, verdict.reasons, verdict.next_steps) == ("sound", (), ())
    assert (verdict.coverage, verdict.mark_height_mm) == (1.0, 6.5)
    assert verdict.scale_sigma == pytest.approx(0.1 / FOCAL)  # lengths are in proportion to the focal length
    assert verdict.tilt_spread_deg == pytest.approx(np.degrees(2 * 0.4), abs=2.0)


@pytest.mark.parametrize(("sigmas", "wrong"), [(2.95, False), (3.05, True)])
def test_residuals_from_three_times_the_sharpness_of_dots_on_are_a_misfit(sigmas: float, wrong: bool) -> None:
    fit = SimpleNamespace(variance=sigmas**2, state=calibration().fit.state)
    assert bool(_misfit(calibration(fit=fit))) == wrong
    assert (assess(calibration(fit=fit)).level == "limited") == wrong


@pytest.mark.parametrize(("excess", "level"), [(0.0019, "sound"), (0.0021, "limited"), (-0.0021, "limited")])
def test_gauge_stretched_by_more_than_twice_its_stated_tolerance_is_a_reason_for_doubt(
    excess: float, level: str
) -> None:
    verdict = assess(calibration(known(focal_px=0.1), excess=excess))
    assert verdict.level == level
    assert any(
        f"{100 * abs(excess):.2g} % (± 0.02 %) longer along" in said for said in (*verdict.notes, *verdict.reasons)
    )


def _seen(size_ratio: float) -> SimpleNamespace:
    """An image in focus whose dots are so many times as wide as the gauge file says."""
    return SimpleNamespace(size_ratio=size_ratio, bloom=0.0, name="g.png", match=calibration().sightings[0].match)


@pytest.mark.parametrize(("ratio", "wrong"), [(1.14, False), (1.16, True), (0.81, False), (0.79, True)])
def test_dots_a_seventh_wider_or_a_fifth_narrower_than_the_file_says_are_of_a_wrong_size(
    ratio: float, wrong: bool
) -> None:
    dots, odd = _seen(ratio), _seen(9.0)
    assert bool(_wrong_size(calibration(sightings=(dots, dots, odd)))) == wrong  # the median counts


PRIOR = rough_prior(SIZE)


@pytest.mark.parametrize(
    ("camera", "spread_deg", "said"),
    [
        (CAMERA, 4.9, "all images are parallel within 4.9 degrees"),
        (CAMERA, 5.1, ""),
        (known(focal_px=0.0101 * FOCAL), 20.0, "the focal length is known to 1 % only"),
        (known(focal_px=0.0099 * FOCAL), 20.0, ""),
        (with_values(principal_x_px=400.0), 20.0, "lies outside the image"),
        (with_values(principal_y_px=-0.1), 20.0, "lies outside the image"),
        (with_values(principal_x_px=199.5 + 3.05 * 32), 20.0, "implausibly far"),
        (with_values(principal_y_px=149.5 - 3.05 * 32), 20.0, "implausibly far"),
        (with_values(principal_x_px=199.5 + 2.95 * 32), 20.0, ""),
        (known(principal_y_px=0.26 * 32), 20.0, "is not determined by these images"),
        (known(principal_y_px=0.24 * 32), 20.0, ""),
        (with_values(aspect=1.0061), 20.0, "1.0061 times as high as wide"),
        (with_values(aspect=0.9941), 20.0, ""),
    ],
)
def test_images_do_not_determine_a_camera_beyond_these_limits(camera: Camera, spread_deg: float, said: str) -> None:
    assert PRIOR.sigma[2] == 32.0
    why = _ill_conditioned(calibration(camera), spread_deg)
    assert len(why) == bool(said)
    assert said in "".join(why)


@pytest.mark.parametrize(
    ("covered", "corner_sigma", "level", "noted"),
    [
        (0.41, 0.0, "sound", False),
        (0.39, 0.0, "sound", True),
        (0.39, 1.0, "limited", False),
        (0.21, 0.0, "sound", True),
        (0.19, 0.0, "limited", False),
    ],
)
def test_images_that_show_dots_in_a_part_are_judged_by_the_corners_or_not_believed(
    covered: float, corner_sigma: float, level: str, noted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(quality, "coverage", lambda _: covered)
    verdict = assess(calibration(known(k2=corner_sigma)))
    assert verdict.level == level
    assert any("distortion is extrapolated" in note for note in verdict.notes) == noted
    assert any("every part of the image" in step for step in verdict.next_steps) == (level == "limited")


@pytest.mark.parametrize(
    ("said", "reason", "step"),
    [
        ({"camera": known(focal_px=0.02 * FOCAL)}, "focal length is known to 2 % only", "five or more images"),
        ({"fit": SimpleNamespace(variance=16.0, state=calibration().fit.state)}, "4 times", "flat, rigid gauge"),
        ({"sightings": (_seen(1.2),) * 5},
         "1.20 times that of the gauge file", "measure pitch and dot diameter"),
        ({"camera": known(translation_z_mm=0.5)}, "not determine the height correction", "tilted by 20 to 40 degrees"),
    ],
)  # fmt: skip
def test_every_doubt_comes_with_what_to_do(said: dict[str, Any], reason: str, step: str) -> None:
    verdict = assess(calibration(**said), mark_height_mm=50.0)
    assert len(verdict.reasons) == len(verdict.next_steps) == 1
    assert reason in verdict.reasons[0]
    assert step in verdict.next_steps[0]


def test_an_image_that_was_left_out_and_an_origin_that_may_be_off_by_a_pitch_are_noted() -> None:
    unsure = SimpleNamespace(
        size_ratio=1.0, bloom=0.0, name="g.png", match=type("M", (list,), {"certain": False})([0] * 100)
    )
    notes = _notes(calibration(sightings=(unsure,) * 5, left_out=(("h.png", "no dots"),)))
    assert notes[0] == "left out h.png: no dots"
    assert "off by whole pitches" in notes[-1]
    assert not any("whole pitches" in note for note in _notes(calibration()))
    whole = SimpleNamespace(**vars(unsure) | {"match": type("M", (list,), {"certain": False})([0] * (13 * 9))})
    notes = _notes(calibration(sightings=(whole,) * 5))
    assert "the direction of x and y was chosen arbitrarily" in notes[-1]  # all of a symmetric array is seen
    assert not any("whole pitches" in note for note in notes)
    either = gauge_of(fiducial=[{"column": 4, "row": 4, "diameter_mm": 1.8}])
    assert "x may point the other way" in _notes(calibration(sightings=(unsure,) * 5, gauge=either))[-1]


@pytest.mark.parametrize("percent", [0.0, 0.1])
def test_the_verdict_tells_what_the_pitch_of_the_gauge_takes_of_the_uncertainty(percent: float) -> None:
    verdict = assess(calibration(known(focal_px=0.6), gauge=gauge_of(pitch_tolerance_percent=percent)))
    share = "of which 0.1 % from the pitch of the gauge (pitch_tolerance_percent) and 0.05 % from the images"
    assert verdict.summary.endswith(share if percent else "if the pitch of the gauge is exact")


@pytest.mark.parametrize(("share", "enough"), [(0.00099, True), (0.00101, False)])
def test_corners_are_known_well_enough_to_a_thousandth(
    share: float, enough: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(quality, "coverage", lambda _: 0.3)
    camera = known(focal_px=share * FOCAL)
    assert worst_scale_sigma(camera, 6.5) == pytest.approx(share, rel=1e-3)
    assert (assess(calibration(camera)).level == "sound") == enough


@pytest.mark.parametrize(("gauge_mm", "open_"), [(44.0, True), (36.0, False)])
def test_height_correction_is_open_where_lengths_at_the_marks_are_half_again_as_uncertain(
    gauge_mm: float, open_: bool
) -> None:
    """A height known to σ leaves lengths at h known to σ/(D - h): 1.5 times at 40 mm of 120 against the plate's."""
    verdict = assess(calibration(known(translation_z_mm=0.2)), mark_height_mm=gauge_mm)
    assert verdict.scale_sigma == pytest.approx(0.2 / (DISTANCE - gauge_mm), rel=1e-6)
    assert verdict.plate_scale_sigma == pytest.approx(0.2 / DISTANCE, rel=1e-6)
    assert any("not determine the height correction" in reason for reason in verdict.reasons) == open_
    slight = assess(calibration(known(translation_z_mm=0.05)), mark_height_mm=gauge_mm)  # below a thousandth
    assert slight.level == "sound"


@pytest.mark.parametrize(
    ("sigma_mm", "views", "distance_mm", "said"),
    [
        (0.05, 1, None, "relies on the perspective of a single image, without a check: turning radii at 44 mm are"),
        (0.2, 1, None, "a single image without tilt cannot determine the height correction: turning radii at 44"),
        (0.2, 5, None, "these images do not determine the height correction: turning radii at 44 mm are"),
        (0.2, 1, (120.0, 0.3), "a single image without tilt cannot determine"),
        (0.05, 1, (120.0, 0.3), None),
    ],
)
def test_an_open_height_correction_is_told_with_its_cause(
    sigma_mm: float, views: int, distance_mm: tuple[float, float] | None, said: str | None
) -> None:
    found = calibration(known(translation_z_mm=sigma_mm), distance_mm=distance_mm)
    found.views = found.views[:views]
    reasons = assess(found, mark_height_mm=44.0).reasons
    assert len(reasons) == (said is not None)
    if said is not None:
        doubt = f"uncertain by {100 * sigma_mm / (DISTANCE - 44):.2g} % (1 sigma), on the plane of the gauge by"
        assert said in reasons[0]
        assert f"{doubt} {100 * sigma_mm / DISTANCE:.2g} %" in reasons[0]


def test_corners_are_judged_by_the_worst_of_them() -> None:
    """An uncertain lens tells nothing of which corner is worse; an uncertain tilt of a leaning camera does."""
    leaning = camera_above(size_px=SIZE, focal_px=FOCAL, distance_mm=DISTANCE, tilt_deg=30.0, tilt_azimuth_deg=60.0)
    camera = known(leaning, k1=0.01, rotation_x=1e-3)
    corners = [camera.scale_sigma(6.5, (x, y)) for x in (45.0, 354.0) for y in (45.0, 254.0)]
    assert max(corners) > 1.1 * min(corners)
    assert worst_scale_sigma(camera, 6.5) == pytest.approx(max(corners))


@pytest.mark.parametrize(
    ("ratio", "bloom", "wrong"), [(1.2, 0.0, True), (1.2, 0.06, False), (0.78, 0.0, True), (0.78, 0.04, False)]
)
def test_blooming_dots_may_be_as_much_wider_or_narrower(ratio: float, bloom: float, wrong: bool) -> None:
    dots = SimpleNamespace(size_ratio=ratio, bloom=bloom)
    assert bool(_wrong_size(calibration(sightings=(dots,)))) == wrong


def test_coverage_is_the_share_of_cells_whose_middle_lies_within_the_dots() -> None:
    left = SimpleNamespace(centers_px=np.array([[-1.0, -1.0], [200.0, -1.0], [200.0, 301.0], [-1.0, 301.0]]))
    lower = SimpleNamespace(centers_px=np.array([[-1.0, 200.0], [401.0, 200.0], [401.0, 301.0], [-1.0, 301.0]]))
    assert coverage(calibration(views=(left,))) == pytest.approx(1 / 2)
    assert coverage(calibration(views=(lower,))) == pytest.approx(1 / 3)
    assert coverage(calibration(views=(left, lower))) == pytest.approx(1 / 2 + 1 / 6)


def test_spread_of_tilts_is_the_largest_angle_between_gauges_or_to_the_optical_axis() -> None:
    def tilted(*degrees: float) -> Any:
        flat = cv2.Rodrigues(np.array([np.pi, 0.0, 0.0]))[0]
        turned = [cv2.Rodrigues(np.array([np.radians(angle), 0.0, 0.0]))[0] @ flat for angle in degrees]
        poses = np.array([[*cv2.Rodrigues(each)[0][:, 0], 0.0, 0.0, 100.0] for each in turned])
        return calibration(fit=SimpleNamespace(state=SimpleNamespace(poses=poses)))

    assert tilt_spread_deg(tilted(10.0, -15.0)) == pytest.approx(25.0)
    assert tilt_spread_deg(tilted(10.0, 15.0)) == pytest.approx(15.0)


@pytest.mark.parametrize(("rejected", "noted"), [((2, 0), False), ((0, 3), True)])
def test_dots_left_out_are_worth_a_note_from_a_fiftieth_of_an_image_on(rejected: tuple[int, int], noted: bool) -> None:
    found = _notes(calibration(rejected=rejected, sightings=calibration().sightings[:2]))
    assert any("dots left out" in note for note in found) == noted
    if noted:
        assert found[0].startswith("3 of 200 dots left out")
        assert found[0].endswith("3 of 100")


def test_uncertainty_of_places_grows_from_the_middle_with_the_focal_lengths() -> None:
    """Places r from the middle are uncertain by r·σ/f along r: by 1/√2 of it in a coordinate."""
    found = place_sigmas_mm(known(focal_px=3.0), 0.0, (8, 6))
    x, y = np.meshgrid((np.arange(8) + 0.5) * 50 - 200, (np.arange(6) + 0.5) * 50 - 150)
    expected = np.hypot(x, y) / FOCAL * DISTANCE * (3.0 / FOCAL) / np.sqrt(2)
    np.testing.assert_allclose(found, expected, rtol=0.02)
    assert place_sigmas_mm(known(translation_x_mm=1.0), 0.0).max() < 1e-9  # what all places share changes no length


@pytest.mark.parametrize(("after", "worth"), [(0.91, False), (0.89, True)])
def test_next_image_is_told_that_takes_a_tenth_of_the_uncertainty(after: float, worth: bool) -> None:
    best = NextImage("middle", "left edge", (0.0,) * 6, ((0.0, 0.0),) * 4, 1.0, after)
    assert bool(Advice((), best).sentence) == worth
    assert Advice((), None).sentence == ""


def test_images_add_nothing_without_which_places_are_as_certain_to_a_thousandth() -> None:
    advice = Advice((float("nan"), 1.0008, 1.0012, 1.5), None)
    assert [advice.adds_nothing(k) for k in range(4)] == [False, True, False, False]
    (said,) = image_notes(advice, ["a", "b", "c", "d"])
    assert said == "b adds nothing: the uncertainty is the same without it"
    assert image_notes(Advice((1.5,), None), ["a"]) == ()


@pytest.mark.parametrize("end", [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, -1.0, 0.0)])
def test_smallest_rotation_takes_one_direction_to_another(end: tuple[float, float, float]) -> None:
    start = np.array([0.0, 0.0, 1.0])
    rotation = _turned(start, np.array(end))
    assert rotation @ start == pytest.approx(end, abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    angle = np.arccos(np.clip(end[2], -1, 1))
    assert np.trace(rotation) == pytest.approx(1 + 2 * np.cos(angle))
