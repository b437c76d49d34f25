"""Information of images against the whole normal matrix, and the poses among which the next image is chosen."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from calibration.assessment import next_image
from calibration.assessment.next_image import (
    TILT_DEG,
    TOWARD,
    Information,
    _in_view,
    _pose,
    _whole_gauge,
    gains,
    place_sigmas_mm,
)
from calibration.camera import PARAMETERS, camera_above, project
from calibration.estimation.bundle_adjustment import State, View, solve
from calibration.estimation.initial_values import rough_prior
from tests.calibration.bundles import CAMERA, FREE, GAUGE, bundle

SIZE = (400, 300)
MARK_MM = 6.5


@pytest.fixture(scope="module")
def found() -> Any:
    """Four images of the gauge, solved; the dots of one are a fifth as certain as those of the others."""
    views, state = bundle(4)
    views[3] = replace(views[3], whitening=views[3].whitening / 5)
    fit = solve(views, replace(state, face_mm=np.zeros(3)), replace(rough_prior(SIZE), face_mm=0.05))
    stated = GAUGE.model_copy(update={"tolerance": GAUGE.tolerance.model_copy(update={"flatness_mm": 0.5})})
    camera = replace(CAMERA, parameters=fit.state.parameters(0))
    return SimpleNamespace(views=tuple(views), fit=fit, camera=camera, gauge=stated, distance_mm=None)


def some_of(found: Any, images: list[int], extra: tuple[View, np.ndarray] | None = None) -> Any:
    """The calibration with some of its images only, or with one more, at the values found."""
    fit = found.fit
    views = [found.views[k] for k in images]
    poses, whitened = fit.state.poses[images], [fit.whitened[k] for k in images]
    if extra is not None:
        views, poses = [*views, extra[0]], np.vstack([poses, extra[1]])
        whitened = [*whitened, np.zeros((len(extra[0]), 2))]
    size = fit.state.shared + 6 * len(views)
    of_some = replace(fit, state=replace(fit.state, poses=poses), whitened=whitened, normal=np.zeros((size, size)))
    return SimpleNamespace(**vars(found) | {"views": tuple(views), "fit": of_some})


def test_uncertainty_of_places_is_that_of_the_whole_normal_matrix(found: Any) -> None:
    fit, shared = found.fit, found.fit.state.shared
    joint = np.linalg.inv(fit.normal) * max(fit.variance, 1.0)
    rows = [PARAMETERS.index(name) for name in (*FREE, *PARAMETERS[:6])]
    kept = [*range(len(FREE)), *range(shared, shared + 6)]
    covariance = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    covariance[np.ix_(rows, rows)] = joint[np.ix_(kept, kept)]
    expected = np.sqrt(np.mean(place_sigmas_mm(replace(found.camera, covariance=covariance), MARK_MM) ** 2))
    assert Information(found, MARK_MM).place_sigma_mm() == pytest.approx(expected, rel=1e-6)
    noisy = SimpleNamespace(**vars(found) | {"fit": replace(fit, variance=9.0)})
    assert Information(noisy, MARK_MM).place_sigma_mm() == pytest.approx(3.0 / max(fit.variance, 1) ** 0.5 * expected)


def test_an_image_is_taken_out_or_put_in_as_by_solving_without_or_with_it(found: Any) -> None:
    known = Information(found, MARK_MM)
    sigma = known.place_sigma_mm()
    without = [known.place_sigma_mm(without=k) for k in (1, 2, 3)]
    for k, other in zip((1, 2, 3), without, strict=True):
        fewer = Information(some_of(found, [i for i in range(4) if i != k]), MARK_MM)
        assert other == pytest.approx(fewer.place_sigma_mm(), rel=1e-6)
    assert gains(found, MARK_MM)[1:] == pytest.approx(np.array(without) / sigma)
    assert min(without[:2]) > without[2] > sigma  # the image of uncertain dots gives least
    assert np.isnan(gains(some_of(found, [0]), MARK_MM)).tolist() == [True]
    assert np.isnan(gains(some_of(found, [0, 1]), MARK_MM)).tolist() == [True, False]
    view, pose = found.views[2], found.fit.state.poses[2] * [1, 1, 1, 0.9, 0.9, 0.9]
    more = Information(some_of(found, [0, 1, 2, 3], (view, pose)), MARK_MM).place_sigma_mm()
    assert known.place_sigma_mm(known.of_image(view, pose)) == pytest.approx(more, rel=1e-6)
    assert more < sigma


def sides(lifted: str) -> np.ndarray:
    """Direction in the image, x right and y down, of a side by its name."""
    words = lifted.split()
    return np.array([("right" in words) - ("left" in words), ("lower" in words) - ("upper" in words)])


@pytest.mark.parametrize("lifted", TOWARD)
def test_the_side_that_is_named_comes_nearer_to_the_camera(lifted: str, found: Any) -> None:
    whole = _whole_gauge(found)
    pose = _pose(found, whole, np.array([200.0, 150.0]), TOWARD[lifted])
    depth = (whole.points_mm @ cv2.Rodrigues(pose[:3])[0].T + pose[3:])[:, 2]
    place = project(whole.points_mm, np.concatenate([pose, found.fit.state.lens]), "brown")[0] - [200.0, 150.0]
    slope = np.linalg.lstsq(place, depth - depth.mean(), rcond=None)[0]
    assert slope / np.hypot(*slope) == pytest.approx(-sides(lifted) / np.hypot(*sides(lifted)), abs=0.05)
    assert np.hypot(*slope) > 0.01  # mm a pixel


@pytest.mark.parametrize(
    ("place", "target_px", "lifted"),
    [("upper left", (66.7, 50.0), ""), ("middle", (200.0, 150.0), "right edge"),
     ("lower middle", (200.0, 250.0), "upper left corner"), ("middle right", (333.3, 150.0), "lower edge")],
)  # fmt: skip
def test_the_image_is_named_that_leaves_least_uncertainty(
    place: str, target_px: tuple[float, float], lifted: str, found: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the uncertainty is least for one place and one tilt of the gauge, these are the ones that are named."""
    center = np.append(GAUGE.positions_mm().reshape(-1, 2).mean(axis=0), 0.0)
    normal = np.append(-np.sin(np.radians(TILT_DEG)) * sides(lifted) / max(np.hypot(*sides(lifted)), 1), 0.0)
    normal[2] = -np.sqrt(1 - normal @ normal)

    class OfPose:
        def __init__(self, *_: object) -> None: ...

        def of_image(self, _: View, pose: np.ndarray) -> np.ndarray:
            return pose

        def place_sigma_mm(self, pose: np.ndarray) -> float:
            rotation = cv2.Rodrigues(pose[:3])[0]
            ray = rotation @ center + pose[3:]
            at_px = ray[:2] / ray[2] * 1200 + [199.5, 149.5]
            return float(1 + np.hypot(*(at_px - target_px)) / 100 + np.sum((rotation[:, 2] - normal) ** 2) / 10)

    monkeypatch.setattr(next_image, "Information", OfPose)
    monkeypatch.setattr(next_image, "place_sigmas_mm", lambda *_: np.full((2, 3), 9.0))
    straight = camera_above(size_px=SIZE, focal_px=1200, distance_mm=120)
    state = State(straight.pose[None], straight.lens_parameters, "brown", ())
    fit = replace(found.fit, state=state)
    best = next_image.next_image(SimpleNamespace(**vars(found) | {"camera": straight, "fit": fit}), MARK_MM)  # type: ignore[arg-type]
    assert best is not None
    assert (best.place, best.lifted, best.before_mm) == (place, lifted, 9.0)
    assert best.after_mm == pytest.approx(1.0, abs=0.03)


def test_only_dots_within_the_image_say_anything_and_the_outline_goes_round_all_of_them(found: Any) -> None:
    """At 10 px a mm from (199.5, 149.5); the image ends with its last pixels, 399 and 299."""
    places = np.array([[-19.9, 0], [-20.0, 0], [19.9, 0], [20.0, 0], [0, 14.9], [0, 15.0], [0, -14.9], [0, -15.0]])
    straight = camera_above(size_px=SIZE, focal_px=1200, distance_mm=120)
    whole = replace(_whole_gauge(found).take(np.arange(88) < 8), points_mm=np.column_stack([places, np.zeros(8)]))
    seen_by: Any = SimpleNamespace(
        camera=straight, fit=SimpleNamespace(state=State(straight.pose[None], straight.lens_parameters, "brown", ()))
    )
    seen, outline = _in_view(whole, straight.pose, seen_by)
    assert seen.points_mm[:, :2].tolist() == places[::2].tolist()
    corners = [(-20.0, -15.0), (20.0, -15.0), (20.0, 15.0), (-20.0, 15.0)]
    expected = [project(np.array([[x, y, 0.0]]), straight.parameters, "brown")[0][0] for x, y in corners]
    assert np.array(outline) == pytest.approx(np.array(expected), abs=0.06)


def test_a_gauge_that_is_not_taken_yet_has_all_its_dots_as_sharp_as_the_median_of_those_found(found: Any) -> None:
    whole = _whole_gauge(found)
    assert whole.points_mm == pytest.approx(np.column_stack([GAUGE.positions_mm().reshape(-1, 2), np.zeros(88)]))
    assert whole.radius_mm == pytest.approx(np.full(88, 0.6))
    assert whole.whitening == pytest.approx(np.tile(np.eye(2) / 0.02, (88, 1, 1)))
