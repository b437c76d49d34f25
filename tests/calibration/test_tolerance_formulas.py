"""What misplaced dots do to a solve, by moving them one by one; where a solve begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.camera import camera_above
from calibration.estimation.bundle_adjustment import Fit, _normal
from calibration.estimation.gauge_tolerance import covariance_with_tolerance
from calibration.estimation.initial_values import FEW, _spread, rough_prior, rough_start
from calibration.gauge.geometry import Tolerance
from tests.calibration.bundles import LOOSE, bundle, seen

STEP_MM, DOT_MM = 1e-4, 0.004


@pytest.mark.parametrize(("variance", "counts"), [(4.0, 4.0), (0.25, 1.0)])
def test_a_dot_that_is_out_of_place_is_so_in_every_image_and_noise_is_not(variance: float, counts: float) -> None:
    """The noise holds the errors of the dots as if they were independent between images: that part is replaced."""
    views, state = bundle(2, noise_px=0.0)
    some = np.isin(np.arange(88), [0, 10, 44, 50, 77, 87])
    views, state = [view.take(some) for view in views], replace(state, free=("focal_px",))
    at_rest = _normal(views, state, LOOSE, 1.0)

    def moves(images: set[int], site: int, axis: int) -> np.ndarray:
        """How far the solution goes with a dot that is displaced in these images, per mm."""
        shift = STEP_MM * np.outer(views[0].site == site, np.eye(3)[axis])
        moved = [replace(v, points_mm=v.points_mm + shift) if k in images else v for k, v in enumerate(views)]
        pull = _normal(moved, state, LOOSE, 1.0).gradient - at_rest.gradient
        return np.linalg.solve(at_rest.matrix, pull) / STEP_MM

    inverse = np.linalg.inv(at_rest.matrix)
    expected = counts * inverse
    for site in views[0].site.tolist():
        for axis in (0, 1):
            common, alone = moves({0, 1}, site, axis), [moves({k}, site, axis) for k in (0, 1)]
            expected += DOT_MM**2 * (np.outer(common, common) - sum(np.outer(one, one) for one in alone))
    fit = Fit(state, 0.0, [], [], at_rest.matrix, variance, 1.0)
    found = covariance_with_tolerance(views, fit, Tolerance(dot_mm=DOT_MM))
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=2e-3)
    assert np.abs((found - counts * inverse) / np.outer(size, size)).max() > 0.1
    np.testing.assert_allclose(covariance_with_tolerance(views, fit, Tolerance(dot_mm=0.0)), variance * inverse)


def test_a_solve_begins_with_eighty_dots_from_one_end_of_the_list_to_the_other() -> None:
    views, _ = bundle(1)
    assert len(_spread(views[0])) == FEW == 80
    assert _spread(views[0]).site[[0, -1]].tolist() == [0, 87]
    few = views[0].take(np.arange(88) < 30)
    assert len(_spread(few)) == 30


def test_beginnings_are_of_both_lens_models_and_the_best_is_near_the_camera() -> None:
    """Of two exact images by a lens of three widths."""
    cameras = [
        camera_above(size_px=(400, 300), focal_px=1200, distance_mm=distance, tilt_deg=tilt)
        for distance, tilt in ((120, 3.0), (110, 25.0))
    ]
    views = [seen(camera.parameters, np.random.default_rng(0), 0.0) for camera in cameras]
    begun = rough_start(views, (400, 300), rough_prior((400, 300)))
    assert (costs := [fit.cost for fit in begun]) == sorted(costs)
    assert {fit.state.model for fit in begun} == {"brown", "fisheye"}
    assert all(fit.state.free == ("focal_px", "k1") for fit in begun)
    best = begun[0].state
    assert best.lens[0] == pytest.approx(1200, rel=0.02)
    np.testing.assert_allclose(best.poses[:, 3:], [camera.pose[3:] for camera in cameras], atol=2.0)
