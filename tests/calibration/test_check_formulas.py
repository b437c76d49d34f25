"""The check of a camera in closed form: what one error of the calibration, a push or a turn of the camera comes to."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calibration.assessment import camera_check
from calibration.assessment.camera_check import (
    Check,
    _length_change,
    _lens_sigma,
    _plane,
    _pose,
    _pose_change,
    _sigma,
    _sigmas,
    _signed,
    _unseen,
    check_camera,
)
from calibration.camera import PARAMETERS, Camera, camera_above
from calibration.errors import CalibrationError
from calibration.estimation.bundle_adjustment import State, View, with_disc_offsets
from tests.calibration.bundles import CAMERA, GAUGE, seen

SIZE, FOCAL, DISTANCE = (400, 300), 1200.0, 120.0
ERROR = {"rotation_x": 2e-5, "rotation_y": -1e-5, "translation_x_mm": 2e-3, "translation_z_mm": -3e-3, "focal_px": 0.04,
         "aspect": 1e-5, "principal_x_px": -0.03, "principal_y_px": 0.02, "k1": 2e-4, "k2": 2e-3}  # fmt: skip


def above(**said: Any) -> Camera:
    """A camera straight over the plate, but for what is said."""
    usual: dict[str, Any] = {"size_px": SIZE, "focal_px": FOCAL, "distance_mm": DISTANCE}
    return camera_above(**usual | said)


def exact_view(camera: Camera) -> View:
    """The dots of the gauge where a camera sees them, the middles of their discs' images."""
    view = seen(camera.parameters, np.random.default_rng(0), 0.0)
    state = State(camera.pose[None], camera.lens_parameters, camera.lens, ())
    (view,) = with_disc_offsets([view], state)
    return replace(view, centers_px=view.centers_px + view.offset_px)


def off_by(sign: float) -> tuple[Camera, np.ndarray]:
    """CAMERA as a calibration has it that is off by one standard deviation of its only error."""
    error = sign * np.array([ERROR.get(name, 0.0) for name in PARAMETERS])
    return replace(CAMERA, parameters=CAMERA.parameters + error, covariance=np.outer(error, error)), error


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_error_of_pose_and_lens_changes_the_plane_by_what_the_covariance_says(sign: float) -> None:
    camera, _ = off_by(sign)
    state, view, _, _ = _pose(camera, exact_view(CAMERA))
    change, covariance = _pose_change(camera, state, view, 0.0)
    np.testing.assert_allclose(covariance, np.outer(change, change), rtol=0.02, atol=1e-12)
    assert abs(change[2]) > 0.002  # by its distance, not only by rounding
    calm = replace(camera, covariance=np.zeros((16, 16)))
    once, twice = (_pose_change(calm, state, view, noise)[1] for noise in (1.0, 2.0))
    np.testing.assert_allclose(twice, 2 * once)


def test_an_error_of_the_lens_is_one_sigma_in_the_residuals_and_all_of_them_where_it_is_exact(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    freedoms = []
    monkeypatch.setattr(camera_check, "_sigma", lambda statistic, freedom: freedoms.append(freedom) or statistic)
    camera, _ = off_by(1.0)
    state, view, residual, _ = _pose(camera, exact_view(CAMERA))
    whole = float(np.sum((residual / 0.02) ** 2))
    assert _lens_sigma(camera, state, view, whole / 100) == pytest.approx(100 / 101, rel=2e-3)
    assert freedoms == [7]  # all of the lens but p1, p2, and k4, which is no term of this model
    exact = replace(camera, covariance=np.zeros((16, 16)))
    assert _lens_sigma(exact, state, view, 4.0) == pytest.approx(whole / 4, rel=0.01)


def test_refocusing_by_a_twentieth_hides_in_a_straight_image_what_it_does_above_the_plate() -> None:
    """Focal length and distance grow together: lengths at height h by h/(D - h) of that."""
    straight = above()
    state, view, _, _ = _pose(straight, exact_view(straight))
    hidden = 0.05 * 6.5 / (DISTANCE - 6.5)
    assert _unseen(straight, state, view, 1.0, 6.5) == pytest.approx(1.96 * hidden, rel=0.03)
    assert _unseen(straight, state, view, 1.0, 0.0) < 0.1 * hidden


def checked(now: Camera, monkeypatch: pytest.MonkeyPatch, camera: Camera | None = None, **said: Any) -> Check:
    """The check of a camera with dots as another sees them exactly, without an image."""
    monkeypatch.setattr(camera_check, "sight", lambda *_: None)
    monkeypatch.setattr(camera_check, "view_of", lambda *_, **__: exact_view(now))
    return check_camera(camera or above(), GAUGE, np.zeros(SIZE[::-1]), **said)


@pytest.mark.parametrize(("higher_mm", "outcome"), [(0.0, "holds"), (0.05, "changed"), (0.2, "no longer holds")])
def test_a_camera_that_is_higher_is_told_by_how_much_and_fails_from_a_thousandth_of_lengths_on(
    higher_mm: float, outcome: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = checked(above(distance_mm=DISTANCE + higher_mm), monkeypatch)
    assert found.outcome == outcome
    assert found.distance_mm == pytest.approx(higher_mm, abs=1e-4)
    assert found.length_change == pytest.approx(higher_mm / (DISTANCE - 6.5), abs=1e-6)
    assert (found.tilt_deg, found.shift_mm, found.rms_px) == pytest.approx((0, 0, 0), abs=1e-3)
    assert (found.pose_sigma > 4, found.lens_sigma > 4) == (higher_mm > 0, False)
    assert found.dots == 88


def test_sentence_of_a_check_counts_no_sigmas_beyond_counting_and_gives_no_sign_to_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    far = checked(above(distance_mm=DISTANCE + 5.0), monkeypatch).summary
    assert "pose more than 37 sigma (0.000 degrees, +5.000 mm)" in far
    assert far.endswith("calibrate again with new images")
    same = replace(checked(above(), monkeypatch), length_change=-4e-7, distance_mm=-2e-4).summary
    assert same.startswith("the calibration holds: ")
    assert "degrees, 0.000 mm" in same
    assert "lengths by up to 0.000 %" in same


@pytest.mark.parametrize("shape", [(300, 400), (300, 400, 3)])
def test_an_image_of_another_size_than_the_calibration_is_refused(
    shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(camera_check, "sight", lambda *_: None)
    monkeypatch.setattr(camera_check, "view_of", lambda *_, **__: exact_view(above()))
    assert check_camera(above(), GAUGE, np.zeros(shape)).outcome == "holds"
    with pytest.raises(CalibrationError, match="400×300 pixels, the calibration holds for 300×400"):
        check_camera(above(size_px=(300, 400)), GAUGE, np.zeros(shape))


def test_tilt_and_place_of_the_gauge_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    assert checked(above(tilt_deg=0.3), monkeypatch).tilt_deg == pytest.approx(0.3, rel=1e-3)
    shifted = checked(above(center_mm=(0.3, -0.4)), monkeypatch)
    assert shifted.shift_mm == pytest.approx(0.5, rel=1e-3)
    assert shifted.outcome == "holds"


def test_a_lens_that_changed_no_longer_holds_though_lengths_at_mark_height_are_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = checked(above(k1=-0.3), monkeypatch, height_mm=0.0)
    assert found.lens_sigma > 4
    assert found.outcome == "no longer holds"
    assert "the lens has changed" in found.summary


def test_noise_of_the_calibration_and_the_pitch_of_a_strange_gauge_make_a_change_less_certain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    higher = above(distance_mm=DISTANCE + 0.05)
    sigmas = [checked(higher, monkeypatch, variance=variance).pose_sigma for variance in (1.0, 4.0)]
    assert sigmas[0] > 1.5 * sigmas[1] > 1.5
    error = np.array([0.1 if name == "translation_z_mm" else 0.0 for name in PARAMETERS])
    pitched = replace(above(), covariance=np.outer(error, error), pitch_error=error)
    same, strange = (checked(higher, monkeypatch, pitched, gauge_is_known=known).pose_sigma for known in (True, False))
    assert same > 4
    assert strange < 0.6


@pytest.mark.parametrize(("sigma", "told"), [(3.95, False), (4.05, True)])
def test_a_change_is_told_from_four_sigmas_on(sigma: float, told: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    higher = above(distance_mm=DISTANCE + 0.2)
    monkeypatch.setattr(camera_check, "_sigma", lambda _, freedom: sigma if freedom == 3 else 0.0)
    by_pose = checked(higher, monkeypatch)
    assert by_pose.outcome == ("no longer holds" if told else "holds")
    monkeypatch.setattr(camera_check, "_sigma", lambda _, freedom: 0.0 if freedom == 3 else sigma)
    by_lens = checked(above(), monkeypatch)
    assert by_lens.outcome == ("no longer holds" if told else "holds")
    if told:
        assert "the camera has moved" in by_pose.summary
        assert "the lens has changed" in by_lens.summary


@pytest.mark.parametrize("sigmas", [0.5, 4.0, 20.0])
def test_significance_is_that_of_a_normal_deviation_as_improbable(sigmas: float) -> None:
    assert _sigma(sigmas**2, 1) == pytest.approx(sigmas, rel=1e-6)
    assert _sigma(sigmas**2, 3) < sigmas
    assert _sigma(1e4, 1) == 37.0
    assert _sigmas(36.94) == "36.9 sigma"
    assert _sigmas(37.0) == "more than 37 sigma"
    assert (_signed(0.0006), _signed(-0.0004)) == ("+0.001", "0.000")


def test_plane_is_seen_at_its_tilt_and_distance() -> None:
    assert _plane(above().pose) == pytest.approx([0.0, 0.0, DISTANCE], abs=1e-9)
    shifted = above(center_mm=(7.0, -3.0), turn_deg=50)
    assert _plane(shifted.pose) == pytest.approx([0.0, 0.0, DISTANCE], abs=1e-9)  # where on the plate says nothing
    tilted = above(tilt_deg=4.0)
    assert np.hypot(*_plane(tilted.pose)[:2]) == pytest.approx(np.sin(np.radians(4.0)))
    assert _plane(tilted.pose)[2] == pytest.approx(DISTANCE * np.cos(np.radians(4.0)))


@pytest.mark.parametrize("higher_mm", [0.5, -0.5])
def test_lengths_change_with_the_distance_of_the_camera_from_the_height_of_the_marks(higher_mm: float) -> None:
    moved = above(distance_mm=DISTANCE + higher_mm)
    assert _length_change(moved, above(), 6.5) == pytest.approx(higher_mm / (DISTANCE - 6.5), rel=1e-6)
    assert _length_change(moved, above(), 0.0) == pytest.approx(higher_mm / DISTANCE, rel=1e-6)


def test_lengths_change_along_one_axis_where_the_aspect_does() -> None:
    parameters = above().parameters.copy()
    parameters[PARAMETERS.index("aspect")] = 1.01
    assert _length_change(replace(above(), parameters=parameters), above(), 0.0) == pytest.approx(
        1 / 1.01 - 1, rel=1e-6
    )


def test_length_change_of_a_tilt_is_that_near_the_rim() -> None:
    """To first order by 2·tilt·tan(angle off the axis) along the tilt, at 0.4 of the width."""
    tilted = above(tilt_deg=0.2)
    change = _length_change(tilted, above(), 0.0)
    assert abs(change) == pytest.approx(2 * np.radians(0.2) * 0.4 * 400 / FOCAL, rel=0.05)
