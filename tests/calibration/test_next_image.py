"""What an image gives, and the next one to take: predicted from a solved calibration, against solving again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.assessment.next_image import (
    TILT_DEG,
    Advice,
    NextImage,
    _pose,
    _whole_gauge,
    advise,
    image_notes,
    place_sigmas_mm,
)
from calibration.camera import PARAMETERS, Camera, camera_above, project
from calibration.estimation.calibrate import Calibration, calibrate
from tests.calibration.drawing import draw_gauge, gauge_of, posed, random_poses

MARK_MM = 6.5
GAUGE = gauge_of(columns=11, rows=8, pitch_tolerance_percent=0.0)
CAMERA = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=4, tilt_azimuth_deg=30, k1=-0.3)
VIEWS = random_poses(CAMERA, 4, np.random.default_rng(4), tilt_deg=25, shift_mm=3)


def solved(views: Sequence[Camera]) -> Calibration:
    rng = np.random.default_rng(7)
    return calibrate([draw_gauge(view, GAUGE, rng=rng, snr=50) for view in views], GAUGE)


def rms_mm(found: Calibration) -> float:
    return float(np.sqrt(np.nanmean(place_sigmas_mm(found.camera, MARK_MM) ** 2)))


@pytest.fixture(scope="module")
def found() -> Calibration:
    return solved(VIEWS)


@pytest.fixture(scope="module")
def advice(found: Calibration) -> Advice:
    return advise(found, MARK_MM)


def test_uncertainty_without_an_image_is_that_of_solving_without_it(found: Calibration, advice: Advice) -> None:
    assert np.isnan(advice.gains[0])  # the image of the plate is needed
    for k in (1, 2, 3):
        without = solved([view for i, view in enumerate(VIEWS) if i != k])
        assert advice.gains[k] == pytest.approx(rms_mm(without) / rms_mm(found), rel=0.25)
        assert advice.gains[k] > 1.0


def test_proposed_image_when_taken_gives_what_was_foretold(found: Calibration, advice: Advice) -> None:
    best = advice.next
    assert best is not None
    assert best.before_mm == pytest.approx(rms_mm(found), rel=0.02)
    assert best.after_mm < 0.9 * best.before_mm
    taken = solved([*VIEWS, seen_in(best)])
    assert rms_mm(taken) == pytest.approx(best.after_mm, rel=0.25)


@pytest.mark.parametrize("direction", [(0, 0), (1, 0), (1, -1)])
def test_a_proposed_pose_has_its_middle_where_it_is_asked_for_and_is_tilted_as_asked(
    found: Calibration, direction: tuple[int, int]
) -> None:
    whole = _whole_gauge(found)
    whole = replace(whole, points_mm=whole.points_mm + np.array([2.0, 1.0, 0.0]))  # its origin is not in its middle
    center_mm = (whole.points_mm.max(axis=0) + whole.points_mm.min(axis=0)) / 2
    pose = _pose(found, whole, np.array([150.0, 180.0]), direction)
    state = found.fit.state
    middle = project(center_mm[None], np.concatenate([pose, state.lens]), state.model)[0]
    np.testing.assert_allclose(middle, [[150.0, 180.0]], atol=0.01)
    normal = cv2.Rodrigues(pose[:3])[0][:, 2]  # toward the camera
    assert np.degrees(np.arccos(-normal[2])) == pytest.approx(TILT_DEG if any(direction) else 0.0, abs=1e-5)
    across = np.array([normal[1], -normal[0]]) @ direction
    assert across == pytest.approx(0.0, abs=1e-4)


def test_proposed_outline_is_where_the_gauge_is_seen(advice: Advice) -> None:
    assert advice.next is not None
    camera = seen_in(advice.next)
    low, high = GAUGE.positions_mm().min(axis=(0, 1)), GAUGE.positions_mm().max(axis=(0, 1))
    corners = [[low[0], low[1], 0.0], [high[0], low[1], 0.0], [high[0], high[1], 0.0], [low[0], high[1], 0.0]]
    drawn = draw_gauge(camera, GAUGE)
    assert drawn.min() < 60  # dots are in view
    seen = project(np.array(corners), camera.parameters, camera.lens)[0]
    assert np.abs(seen - advice.next.outline_px).max() < 8


def test_lifted_side_is_nearer_to_the_camera_and_seen_larger(advice: Advice) -> None:
    best = advice.next
    assert best is not None
    assert best.lifted
    outline = np.array(best.outline_px)
    middle = outline.mean(axis=0)
    toward = np.array(["left" in best.lifted, "upper" in best.lifted]) * -1.0 + [
        "right" in best.lifted,
        "lower" in best.lifted,
    ]
    sides = [(outline[i], outline[(i + 1) % 4]) for i in range(4)]
    length = [float(np.hypot(*(b - a))) for a, b in sides]
    ahead = [float(((a + b) / 2 - middle) @ toward) for a, b in sides]
    opposite = {i: (i + 2) % 4 for i in range(4)}
    near = int(np.argmax(ahead))
    assert length[near] > length[opposite[near]]


def test_image_from_far_away_adds_less_than_any_other() -> None:
    far = posed(CAMERA, np.eye(3), np.array([0.0, 0.0, -60.0]))
    gains = advise(solved([*VIEWS, far]), MARK_MM).gains
    assert 1.0 <= gains[4] < min(gains[1:4])


def test_image_without_which_places_are_as_certain_is_said_to_add_nothing() -> None:
    advice = Advice((float("nan"), 1.2, 1.0004), None)
    assert [advice.adds_nothing(k) for k in range(3)] == [False, False, True]
    names = ["plate.png", "tilted.png", "far.png"]
    assert image_notes(advice, names) == ("far.png adds nothing: the uncertainty is the same without it",)
    assert image_notes(Advice((float("nan"), 1.2, 1.1), None), names) == ()


def test_single_image_has_no_gain_but_a_next_image() -> None:
    advice = advise(solved(VIEWS[:1]), MARK_MM)
    assert len(advice.gains) == 1
    assert not advice.adds_nothing(0)
    assert advice.next is not None
    assert "tilted by 30 degrees" in advice.next.sentence
    assert advice.next.after_mm < 0.5 * advice.next.before_mm


def seen_in(best: NextImage) -> Camera:
    """The true camera before a gauge in the proposed pose."""
    parameters = np.concatenate([best.pose, CAMERA.lens_parameters])
    assert len(parameters) == len(PARAMETERS)
    return replace(CAMERA, parameters=parameters)
