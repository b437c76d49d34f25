"""Images of different focal lengths: found by the misfit that they explain, and not in noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.camera import camera_above
from calibration.estimation.bundle_adjustment import Fit, View, solve
from calibration.estimation.flatness import QUADRATIC
from calibration.estimation.focal_of_images import covariance_by_focal, focal_difference
from tests.calibration.bundles import CAMERA, FREE, LOOSE, bundle

MIDDLE = CAMERA.lens_parameters[2:4]


def zoomed(views: list[View], by: dict[int, float]) -> list[View]:
    """Views as with relatively longer focal lengths of some."""
    scale = [1.0 + by.get(k, 0.0) for k in range(len(views))]
    return [
        replace(view, centers_px=(view.centers_px - MIDDLE) * times + MIDDLE)
        for view, times in zip(views, scale, strict=True)
    ]


def fitted(views: list[View], free: tuple[str, ...] = FREE, face: int = 0) -> tuple[list[View], Fit]:
    state = bundle(len(views))[1]
    return views, solve(views, replace(state, free=free, face_mm=np.zeros(face)), LOOSE)


@pytest.mark.parametrize(("image", "change"), [(1, 0.02), (3, -0.01), (4, 0.01)])
def test_a_difference_of_focal_lengths_is_found_with_about_its_size(image: int, change: float) -> None:
    assert focal_difference(*fitted(zoomed(bundle(6)[0], {image: change}))) == pytest.approx(abs(change), rel=0.4)


def test_a_difference_is_found_though_lens_and_gauge_have_taken_up_a_part() -> None:
    views = zoomed(bundle(6)[0], {1: 0.02, 4: -0.01})
    assert focal_difference(*fitted(views, (*FREE, "aspect", "k2", "p1", "p2"), QUADRATIC)) > 0.01


@pytest.mark.parametrize("seed", range(1, 6))
def test_noise_and_a_change_within_it_are_no_difference(seed: int) -> None:
    views, state = bundle(6, seed=seed)
    assert focal_difference(views, solve(views, state, LOOSE)) == 0.0
    views = zoomed(views, {2: 1e-5})
    assert focal_difference(views, solve(views, state, LOOSE)) == 0.0


def test_a_misfit_of_which_most_remains_is_not_taken_for_a_difference() -> None:
    views, fit = fitted(zoomed(bundle(6)[0], {1: 0.1}))
    of_all = sum(float(np.sum(white**2)) for white in fit.whitened)
    assert focal_difference(views, fit) > 0.05
    freedom = 2 * sum(len(view) for view in views)
    assert focal_difference(views, replace(fit, variance=of_all / freedom + 9.5)) == 0.0


def test_a_single_image_has_one_focal_length() -> None:
    assert focal_difference(*fitted(bundle(1)[0])) == 0.0


def test_lengths_above_the_plate_are_as_uncertain_as_the_focal_length_makes_its_distance() -> None:
    difference, height, distance = 0.02, 6.5, 120.0
    camera = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=distance)
    unsure = replace(camera, covariance=covariance_by_focal(difference, camera.parameters))
    assert unsure.sigma("focal_px") == pytest.approx(difference * 1200)
    assert unsure.scale_sigma(0.0) == pytest.approx(0.0, abs=1e-9)
    assert unsure.scale_sigma(height) == pytest.approx(difference * height / (distance - height), rel=0.01)
    assert not covariance_by_focal(0.0, camera.parameters).any()
