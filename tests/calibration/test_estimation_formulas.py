"""The solve of a camera part by part: derivatives, priors, robust weights, faces, tolerances."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

from calibration.camera import PARAMETERS, camera_above, camera_height, project
from calibration.errors import CalibrationError
from calibration.estimation import calibrate
from calibration.estimation.bundle_adjustment import (
    LENS_PARAMETERS,
    Fit,
    State,
    _moved,
    _normal,
    add_prior,
    outliers,
    solve,
    view_rows,
    whitening,
)
from calibration.estimation.calibrate import Calibration
from calibration.estimation.disc_projection import fitted_centers
from calibration.estimation.flatness import (
    PEAK_TO_VALLEY_SIGMAS,
    Flatness,
    bend_scale,
    coefficient_sigma,
    face_terms,
    flatness_of,
    rest_covariance,
)
from calibration.estimation.gauge_tolerance import change_by_pitch, with_tolerance
from calibration.estimation.initial_values import rough_pose, rough_prior
from calibration.estimation.model_choice import Trial
from calibration.estimation.robust import robust_scale
from calibration.gauge.geometry import Tolerance
from tests.calibration.bundles import FREE, GAUGE, LOOSE, STEPS, bundle, moved_by, seen
from tests.calibration.drawing import gauge_of


@pytest.mark.parametrize("far", [False, True])
def test_gradient_is_half_the_slope_of_the_robust_cost_with_all_its_priors(far: bool) -> None:
    views, state = bundle(2)
    state = replace(state, face_mm=np.array([0.02, -0.01, 0.03]), lens=state.lens + np.eye(10)[0] * 3.0)
    if far:  # some dots beyond three sigmas: their pull is constant
        views[0] = replace(views[0], centers_px=views[0].centers_px + 0.5 * (np.arange(88) % 7 == 0)[:, None])
    prior = replace(rough_prior((400, 300)), distance_mm=(118.0, 0.4), face_mm=0.05)

    def cost(at: State) -> float:
        return _normal(views, at, prior, 1.3).cost

    gradient = _normal(views, state, prior, 1.3).gradient
    for place, step in enumerate(STEPS / 50):  # no dot crosses three sigmas
        slope = (cost(moved_by(state, place, step)) - cost(moved_by(state, place, -step))) / (2 * step)
        assert gradient[place] == pytest.approx(-slope / 2, rel=2e-3), place


def test_rows_are_the_derivatives_of_the_whitened_residuals() -> None:
    views, state = bundle(2)
    state = replace(state, face_mm=np.array([0.02, -0.01, 0.03]))
    skew = np.array([[4e-4, 1e-4], [1e-4, 2e-4]])
    view = replace(views[1], whitening=whitening(np.tile(skew, (88, 1, 1))))
    plain, white, rows = view_rows(view, state, 1)
    np.testing.assert_allclose(np.sum(white**2, axis=1), np.einsum("ni,ij,nj->n", plain, np.linalg.inv(skew), plain))
    for column, place in enumerate([*range(7), *range(13, 19)]):
        step = STEPS[place]
        one, other = (view_rows(view, moved_by(state, place, side * step), 1)[1] for side in (1, -1))
        np.testing.assert_allclose(rows[:, :, column], (other - one) / (2 * step), rtol=1e-4, atol=1e-3)


def test_priors_weigh_a_lens_by_its_sigmas_and_the_focal_length_by_its_logarithm() -> None:
    _, state = bundle(1)
    prior = rough_prior((400, 300))
    state = replace(state, lens=state.lens + np.array([0, 0, 16.0, 0, 0, 0, 0, 0, 0, 0]))
    normal = _normal([], replace(state, poses=np.zeros((0, 6))), prior, 1.0)
    logarithm = np.log(1200 / 600)  # of 1.5 widths, a factor e of which is one sigma
    assert normal.cost == pytest.approx(logarithm**2 + (16 / 32) ** 2 + 0.2**2)
    short = replace(state, lens=np.array([79.0, *state.lens[1:]]))
    assert np.isinf(_normal([], replace(short, poses=np.zeros((0, 6))), prior, 1.0).cost)  # less than 0.2 widths
    assert _moved(state, np.array([-1e6, *[0.0] * 9])).lens[0] == pytest.approx(0.3 * 1200)


def test_priors_are_known_to_their_sigmas_by_the_normal_matrix_too() -> None:
    """At their means the matrix is minus the derivative of the gradient; no image says anything."""
    _, state = bundle(1)
    free = tuple(LENS_PARAMETERS)
    prior = replace(rough_prior((400, 300)), distance_mm=(camera_height(state.poses[0])[0], 0.4), face_mm=0.05)
    state = replace(state, free=free, lens=prior.mean, face_mm=np.zeros(3))

    def added(at: State) -> tuple[np.ndarray, np.ndarray]:
        matrix, gradient = np.zeros((19, 19)), np.zeros(19)
        add_prior(matrix, gradient, at, prior)
        return matrix, gradient

    matrix, gradient = added(state)
    assert gradient == pytest.approx(np.zeros(19), abs=1e-9)
    sigmas = [1 / np.sqrt(matrix[k, k]) for k in range(13)]
    assert sigmas == pytest.approx([*prior.sigma, 0.05, 0.05, 0.05])
    for place in range(19):
        step = 1e-4
        slope = (added(moved_by(state, place, step))[1] - added(moved_by(state, place, -step))[1]) / (2 * step)
        np.testing.assert_allclose(matrix[place], -slope, rtol=1e-3, atol=1e-4 * np.abs(matrix).max())
    height = camera_height(state.poses[0])[1]
    assert height @ matrix[13:, 13:] @ height == pytest.approx((height @ height / 0.4) ** 2)


def test_cost_of_a_residual_is_its_square_up_to_three_sigmas_and_then_a_line() -> None:
    views, state = bundle(1, noise_px=0.0)
    for sigmas, cost in ((2.9, 2.9**2), (3.1, 6 * 3.1 - 9), (30.0, 171.0)):
        off = views[0].centers_px + np.where(np.arange(88) == 40, sigmas * 0.02, 0.0)[:, None] * [0.6, 0.8]
        assert _normal([replace(views[0], centers_px=off)], state, LOOSE, 1.0).cost == pytest.approx(cost, abs=1e-6)


def test_scale_is_that_of_normal_residuals_whatever_some_outliers() -> None:
    white = 2.5 * np.random.default_rng(0).normal(size=(20000, 2))
    assert robust_scale([white]) == pytest.approx(2.5, rel=0.02)
    white[:1000] = 1e3
    assert robust_scale([white[:10000], white[10000:]]) == pytest.approx(2.5, rel=0.07)
    assert robust_scale([np.full((9, 2), np.nan)]) == 1.0
    assert robust_scale([np.zeros((9, 2))]) == 1e-3


def test_dots_beyond_five_robust_sigmas_are_left_out() -> None:
    white = np.tile([[1.1774, 0.0]], (99, 1))
    white[3], white[4] = [0.0, 4.9], [3.54, 3.54]  # 4.9 and 5.006
    fit: Any = SimpleNamespace(whitened=[white])
    assert np.flatnonzero(~outliers(fit)[0]).tolist() == [4]


def test_dots_within_five_of_their_own_sigmas_stay_however_good_the_others_are() -> None:
    """Residuals of most dots, which a glare makes uncertain, are a quarter of what they state."""
    white = np.tile([[0.25, 0.0]], (99, 1))
    white[3], white[4] = [0.0, 4.9], [3.54, 3.54]
    fit: Any = SimpleNamespace(whitened=[white])
    assert np.flatnonzero(~outliers(fit)[0]).tolist() == [4]


def test_residual_of_a_calibration_is_the_root_mean_square_of_both_coordinates_of_all_images() -> None:
    found: Any = SimpleNamespace(fit=SimpleNamespace(residual_px=[np.array([[3.0, 4.0]]), np.array([[0.0, 5.0]])]))
    get = Calibration.rms_px.fget
    assert get is not None
    assert get(found) == pytest.approx(np.sqrt((9 + 16 + 25) / 4))


@pytest.mark.parametrize(
    ("extents", "refused"),
    [
        ([("whole", "whole")], False),
        ([("short", "whole")], True),
        ([("whole", "short")], True),
        ([("open", "open")], False),
        ([("short", "whole"), ("whole", "short")], False),  # each shows what the other lacks
        ([("short", "open"), ("open", "whole")], True),
    ],
)
def test_an_array_that_ends_early_in_all_images_is_not_that_of_the_file(
    extents: list[tuple[str, str]], refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibrate, "does_not_fit", lambda *_: "it does not fit")
    sightings: Any = [
        SimpleNamespace(name=f"{k}.png", match=SimpleNamespace(extent=extent), lattice=None)
        for k, extent in enumerate(extents)
    ]
    if refused:
        with pytest.raises(CalibrationError, match=r"0\.png: it does not fit"):
            calibrate._check_extent(sightings, GAUGE)
    else:
        calibrate._check_extent(sightings, GAUGE)


def test_solve_finds_the_camera_and_the_noise_of_its_dots() -> None:
    views, state = bundle(4, noise_px=0.06, seed=2)
    views = [replace(view, whitening=view.whitening * 3) for view in views]  # stated as 0.02 px
    start = replace(state, lens=state.lens * [1.1, 1, 1, 1, 0.5, 1, 1, 1, 1, 1], poses=state.poses * 1.02)
    fit = solve(views, start, LOOSE)
    assert fit.variance == pytest.approx(9.0, rel=0.15)
    freedom = 2 * 4 * 88 - len(state.free) - 4 * 6  # coordinates of dots, less what is fitted to them
    assert fit.variance == pytest.approx(sum(np.sum(w**2) for w in fit.whitened) / freedom, rel=1e-9)
    sigma = np.sqrt(np.diag(np.linalg.inv(fit.normal))[:4] * fit.variance)
    error = fit.state.lens[[0, 2, 3, 4]] - state.lens[[0, 2, 3, 4]]
    assert np.abs(error / sigma).max() < 3.5
    assert fit.cost == pytest.approx(sum(np.sum(w**2) for w in fit.whitened), rel=0.05)


def test_a_start_from_which_some_steps_lead_uphill_ends_in_the_same_place() -> None:
    """From twice and a half as far and 0.4 rad turned, steps have to be damped on the way."""
    views, state = bundle(4, noise_px=0.06, seed=2)
    far = state.poses * [1, 1, 1, 2.5, 2.5, 2.5] + [0.4, 0, 0, 0, 0, 0]
    found = solve(views, replace(state, lens=state.lens * [1, 1, 1, 1, 0, 1, 1, 1, 1, 1], poses=far), LOOSE)
    assert found.cost == pytest.approx(solve(views, state, LOOSE).cost, rel=0.01)


def test_dots_that_are_out_of_place_widen_the_noise_of_their_images_by_their_size_there() -> None:
    straight = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120)
    view = seen(straight.parameters, np.random.default_rng(0), 0.02)
    state = State(straight.pose[None], straight.lens_parameters, "brown", ())
    (wider,) = with_tolerance([view], state, Tolerance(dot_mm=0.003))
    variance = 0.02**2 + (0.003 * 1200 / 120) ** 2
    np.testing.assert_allclose(wider.whitening, np.tile(np.eye(2) / np.sqrt(variance), (88, 1, 1)), atol=1e-6)


def test_error_of_the_pitch_moves_the_gauge_away_in_proportion_and_leaves_the_lens() -> None:
    views, state = bundle(3, noise_px=0.0)
    fit = solve(views, state, LOOSE)
    change = change_by_pitch(views, fit)
    assert change[:4] == pytest.approx(np.zeros(4), abs=1e-3)
    for k, pose in enumerate(fit.state.poses):
        assert change[4 + 6 * k : 10 + 6 * k] == pytest.approx([0, 0, 0, *pose[3:]], abs=1e-4)


def test_face_is_of_legendre_polynomials_over_the_array() -> None:
    terms = face_terms(gauge_of(columns=41, rows=41))
    corner, middle, edge = terms[0, 0], terms[20, 20], terms[20, 40]
    assert np.abs(corner) == pytest.approx(np.ones(7))
    assert middle == pytest.approx([-0.5, 0, -0.5, 0, 0, 0, 0], abs=1e-12)
    assert np.abs(edge) == pytest.approx([1, 0, 0.5, 1, 0, 0.5, 0], abs=1e-12)
    # Terms of first order are the pose's: none has a mean slope, and all are orthogonal.
    flat = terms.reshape(-1, 7)
    gram = flat.T @ flat / len(flat)
    assert np.abs(gram - np.diag(np.diag(gram))).max() < 0.03
    assert np.diag(gram) == pytest.approx([1 / 5, 1 / 9, 1 / 5, 1 / 7, 1 / 15, 1 / 15, 1 / 7], rel=0.2)


def test_faces_of_equal_coefficients_have_their_peak_to_valley_below_ten_sigmas() -> None:
    terms = face_terms(GAUGE).reshape(-1, 7)
    drawn = np.ptp(np.random.default_rng(0).normal(size=(4000, 7)) @ terms.T, axis=1)
    assert np.quantile(drawn, 0.95) == pytest.approx(PEAK_TO_VALLEY_SIGMAS, rel=0.03)
    stated = gauge_of(columns=11, rows=8, tolerance={"flatness_mm": 0.13})
    assert coefficient_sigma(stated) == pytest.approx(0.13 / PEAK_TO_VALLEY_SIGMAS)
    assert coefficient_sigma(GAUGE) == pytest.approx(0.05 * 15)  # of half of ten pitches of 3 mm


def test_flatness_of_a_known_face_is_its_peak_to_valley_and_its_mean_square_slope() -> None:
    gauge = gauge_of(columns=61, rows=41, pitch_mm=0.5, diameter_mm=0.2)
    found = flatness_of(gauge, np.array([0.2]), np.zeros((1, 1)))
    for value in (found.peak_to_valley_mm, found.low_mm, found.high_mm):
        assert value == pytest.approx(0.3, rel=1e-3)  # from -c/2 in the middle to c at two ends
    assert found.mean_square_mm2 == pytest.approx(0.09, rel=1e-3)
    slope = 3 * 0.2**2 / 15**2  # dz/dx = 3·c·u/15 mm, u² in the mean 1/3; half of it along either axis
    assert found.slope_square == pytest.approx(slope / 2, rel=0.01)
    assert bend_scale(found) == pytest.approx(slope / 8, rel=0.01)
    wide = flatness_of(gauge, np.array([0.2]), np.array([[0.02**2]]))
    assert (wide.low_mm, wide.high_mm) == pytest.approx((1.5 * (0.2 - 0.0392), 1.5 * (0.2 + 0.0392)), rel=0.03)


def test_a_bent_face_lies_a_third_of_its_bend_higher_and_leans_by_a_quarter_over_half_its_size() -> None:
    gauge = gauge_of(columns=11, rows=8)
    low, high = gauge.positions_mm().reshape(-1, 2).min(axis=0), gauge.positions_mm().reshape(-1, 2).max(axis=0)
    straight = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, center_mm=tuple((low + high) / 2))
    bent = Flatness(np.zeros(1), np.zeros((1, 1)), 0.12, 0.1, 0.14, 0.12**2, 0.0)
    covariance = rest_covariance(bent, gauge, straight.pose)
    slope = camera_height(straight.pose)[1]
    assert np.sqrt(slope @ covariance @ slope) == pytest.approx(0.12 / 3, rel=1e-3)

    def normal(pose: np.ndarray) -> np.ndarray:
        return cv2.Rodrigues(np.ascontiguousarray(pose[:3]))[0][:, 2]

    by_pose = np.stack([(normal(straight.pose + d) - normal(straight.pose - d)) / 2e-6 for d in 1e-6 * np.eye(6)], 1)
    leans = np.sqrt(np.diag(by_pose @ covariance @ by_pose.T)[:2])  # of the normal in the image: x, then y
    assert leans == pytest.approx(0.03 / ((high - low) / 2), rel=1e-3)


def test_centre_of_a_small_discs_image_is_that_of_the_conic() -> None:
    """A circle seen in perspective is an ellipse: its centre from the inverse of the conic."""
    tilted = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=60, tilt_deg=35)
    center, radius = np.array([4.0, -3.0]), 1.0
    rotation = cv2.Rodrigues(tilted.pose[:3].copy())[0]
    plane = np.column_stack([rotation[:, :2], tilted.pose[3:]])
    pinhole = np.array([[1200, 0, 199.5], [0, 1200, 149.5], [0, 0, 1.0]])
    inverse = np.linalg.inv(pinhole @ plane)
    circle = np.array([[1, 0, -center[0]], [0, 1, -center[1]], [-center[0], -center[1], center @ center - radius**2]])
    conic = inverse.T @ circle @ inverse
    expected = np.linalg.solve(conic[:2, :2], -conic[:2, 2])
    found = fitted_centers(np.array([[*center, 0.0]]), np.array([radius]), tilted.parameters, "brown")[0]
    of_middle = tilted.image_from_plate([[*center, 0.0]])[0]
    assert np.hypot(*(expected - of_middle)) > 0.1
    assert found == pytest.approx(expected, abs=2e-3)


def nearest_ellipse(rim: np.ndarray) -> np.ndarray:
    """Centre of the ellipse of least mean square distance, per length of a rim (n, 2), by brute force."""
    length = np.hypot(*((np.roll(rim, -1, 0) - np.roll(rim, 1, 0)) / 2).T)
    about = rim - rim.mean(axis=0)
    a, b, _, c = np.linalg.inv(2 * about.T @ about / len(rim)).ravel()

    def distances(p: np.ndarray) -> np.ndarray:
        off = rim - p[:2]
        slope = off @ [[p[2], p[3]], [p[3], p[4]]]
        q = np.sqrt((off * slope).sum(axis=1))
        return np.asarray((q - 1) * q / np.hypot(*slope.T) * np.sqrt(length))

    start = [*rim.mean(axis=0), a, b, c]
    return np.asarray(
        least_squares(distances, start, x_scale=[1, 1, a, a, a], xtol=1e-14, ftol=1e-14, gtol=1e-14).x[:2]
    )


@pytest.mark.parametrize("place", [(8.0, -5.0), (-9.0, 6.0), (3.0, 9.0)])
def test_centre_of_a_discs_image_through_a_lens_is_that_of_the_ellipse_nearest_to_its_rim(
    place: tuple[float, float],
) -> None:
    """It lies a pixel beside the image of the disc's centre; weighed by other lengths, 0.002 px elsewhere."""
    tilted = camera_above(size_px=(640, 480), focal_px=900, distance_mm=60, tilt_deg=45, tilt_azimuth_deg=60, k1=-0.3)
    angle = np.linspace(0, 2 * np.pi, 721)[:-1]
    circle = np.array(place) + 3.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    rim = project(np.column_stack([circle, 0 * angle]), tilted.parameters, tilted.lens)[0]
    found = fitted_centers(np.array([[*place, 0.0]]), np.array([3.0]), tilted.parameters, tilted.lens)[0]
    assert found == pytest.approx(nearest_ellipse(rim), abs=1e-4)


def alone(fit: Fit) -> list[Trial]:
    """The trials of a search that knows one lens model."""
    return [Trial("brown", fit.state.free, fit, 1.0)]


@pytest.mark.parametrize("pitch_percent", [0.0, 0.2])
def test_camera_has_the_covariance_of_its_solve_and_the_error_of_the_pitch(pitch_percent: float) -> None:
    views, state = bundle(3)
    fit = solve(views, state, LOOSE)
    gauge = gauge_of(columns=11, rows=8, pitch_tolerance_percent=pitch_percent)
    camera = calibrate._camera(fit, views, gauge, None, (400, 300), alone(fit))
    joint = np.linalg.inv(fit.normal) * fit.variance
    exact = camera.with_exact_pitch().covariance
    names = [*FREE, *PARAMETERS[:6]]  # the pose in the first image follows the lens
    rows = [PARAMETERS.index(name) for name in names]
    np.testing.assert_allclose(exact[np.ix_(rows, rows)], joint[:10, :10], rtol=1e-6, atol=1e-12)
    others = np.setdiff1d(np.arange(len(PARAMETERS)), rows)
    assert not exact[others].any()
    share = pitch_percent / 100
    assert camera.pitch_error[3:6] == pytest.approx(share * fit.state.poses[0][3:], abs=1e-4)
    np.testing.assert_allclose(camera.covariance - exact, np.outer(camera.pitch_error, camera.pitch_error), atol=1e-12)


def test_camera_of_a_bent_gauge_has_the_rest_of_its_face_and_a_wider_pitch() -> None:
    views, state = bundle(3)
    fit = solve(views, state, LOOSE)
    bent = Flatness(np.zeros(1), np.zeros((1, 1)), 0.12, 0.1, 0.14, 0.12**2, 0.004)
    plain, found, flat = (
        calibrate._camera(fit, views, GAUGE, flatness, (400, 300), alone(fit))
        for flatness in (None, bent, replace(bent, used=False))
    )
    rest = rest_covariance(bent, GAUGE, fit.state.poses[0])
    exact = [camera.with_exact_pitch().covariance for camera in (plain, found, flat)]
    np.testing.assert_allclose(exact[1][:6, :6] - exact[0][:6, :6], rest, atol=1e-9)
    np.testing.assert_allclose(exact[2], exact[0])
    times = found.pitch_error[5] / fit.state.poses[0][5]
    assert abs(times) == pytest.approx(np.hypot(GAUGE.scale_sigma, 0.001), rel=1e-3)


@pytest.mark.parametrize("turn_deg", [0.0, 130.0])
def test_rough_pose_of_exact_dots_is_the_pose(turn_deg: float) -> None:
    camera = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=110, tilt_deg=20, turn_deg=turn_deg, k1=-0.2)
    found = rough_pose(seen(camera.parameters, np.random.default_rng(0), 0.0), camera)
    assert found == pytest.approx(camera.pose, abs=1e-4)
