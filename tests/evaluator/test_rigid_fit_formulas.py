"""A rigid body laid on points: which point is odd, and from how many frames its places are learnt."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest

from calibration.frames import plate_from_body
from evaluator.rigid_fit import fitted_poses, learnt_places, odd_points, pose_jacobian
from evaluator.robust import robust_sigma

PLACES = np.array([[0.0, 0.0], [4.0, 0.0], [2.0, 10.0]])
GIVEN = PLACES + np.array([[0.0, 0.0], [0.0, 0.0], [0.3, -0.2]])  # of a robot file whose third place is wrong
EQUAL = np.ones(3)


def motion(frames: int) -> np.ndarray:
    """Points (frames, 3, 2) of a body that turns as it moves."""
    k = np.arange(frames)[:, None]
    return plate_from_body(np.broadcast_to(PLACES, (frames, 3, 2)), 0.5 * k, 2.0 - 0.1 * k, 0.4 + 0.07 * k)


@pytest.mark.parametrize(("whole", "learnt"), [(12, True), (11, False)])
def test_places_are_learnt_from_twelve_frames_that_show_all_points(whole: int, *, learnt: bool) -> None:
    points = motion(whole + 3)
    points[whole:, 2] = np.nan
    found = learnt_places(points, GIVEN, EQUAL)
    if not learnt:
        np.testing.assert_array_equal(found, GIVEN)
        return
    apart = np.linalg.norm(found[:, None] - found, axis=2)
    np.testing.assert_allclose(apart, np.linalg.norm(PLACES[:, None] - PLACES, axis=2), atol=1e-9)
    np.testing.assert_allclose(found.mean(axis=0), GIVEN.mean(axis=0), atol=1e-9)  # the middle stays as given
    poses = fitted_poses(points, found, EQUAL)
    steps = np.diff(poses[:, 2])
    np.testing.assert_allclose(steps, 0.07, atol=1e-9)  # no jump where the third point goes


def test_places_are_left_where_every_frame_shows_all_points() -> None:
    np.testing.assert_array_equal(learnt_places(motion(30), GIVEN, EQUAL), GIVEN)


def test_a_point_that_is_off_from_both_others_is_the_odd_one() -> None:
    points = motion(9)
    points[4, 1] += [0.5, 0.5]
    wrong, refused = odd_points(points, 6.0, 0.01)
    assert np.argwhere(wrong).tolist() == [[4, 1]]
    assert refused == {}


def test_two_points_that_are_off_from_each_other_alone_leave_the_frame_without_an_answer() -> None:
    points = np.broadcast_to(PLACES, (9, 3, 2)).copy()
    points[4, 0, 0] -= 0.05  # across the way to the third: its distances stay within 0.01
    points[4, 1, 0] += 0.05
    wrong, refused = odd_points(points, 6.0, 0.01)
    assert not wrong.any()
    assert refused == {4: pytest.approx((4.1, 4.0))}


def test_a_point_that_keeps_nearly_its_distance_from_one_of_the_others_is_the_odd_one() -> None:
    points = np.broadcast_to(PLACES, (9, 3, 2)).copy()
    points[4, 1] += [-0.2, -0.08]  # 0.2 nearer to the first, 0.04 farther from the third; limit 0.06
    wrong, refused = odd_points(points, 6.0, 0.01)
    assert np.argwhere(wrong).tolist() == [[4, 1]]
    assert refused == {}


def test_distances_beyond_their_limit_decide_before_those_beyond_half_of_it() -> None:
    """The second point is off by 1.5 limits from both others, which are 0.7 limits too far from each other."""
    points = np.broadcast_to(PLACES, (9, 3, 2)).copy()
    points[4, 2, 1] += 0.0428
    points[4, 1] += [0.09, -0.031]
    off = np.linalg.norm(points[4] - points[4][[1, 2, 0]], axis=1) - np.linalg.norm(PLACES - PLACES[[1, 2, 0]], axis=1)
    assert off / 0.06 == pytest.approx([1.5, 1.5, 0.7], abs=0.02)
    wrong, refused = odd_points(points, 6.0, 0.01)
    assert np.argwhere(wrong).tolist() == [[4, 1]]
    assert refused == {}


@pytest.mark.parametrize(("away", "odd"), [(0.059, False), (0.061, True)])
def test_a_distance_is_odd_beyond_so_many_sigmas_of_the_least(away: float, *, odd: bool) -> None:
    points = np.broadcast_to(PLACES[:2], (9, 2, 2)).copy()
    points[4, 1, 0] += away
    assert bool(odd_points(points, 6.0, 0.01)[1]) == odd


@pytest.mark.parametrize(("frames", "known"), [(2, False), (3, True)])
def test_a_usual_distance_needs_three_frames(frames: int, *, known: bool) -> None:
    points = np.broadcast_to(PLACES[:2], (frames, 2, 2)).copy()
    points[0, 1, 0] += 1.0
    assert bool(odd_points(points, 6.0, 0.01)[1]) == known


def test_robust_sigma_of_a_gaussian_is_its_standard_deviation() -> None:
    quantiles = [NormalDist(5.0, 3.0).inv_cdf((k + 0.5) / 999) for k in range(999)]
    assert robust_sigma(np.array(quantiles)) == pytest.approx(3.0, rel=2e-3)


def test_a_frame_without_a_heading_has_no_derivatives_and_an_unseen_point_none_of_its_own() -> None:
    places = np.array([[1.0, 0.0], [-1.0, 0.5], [0.0, -2.0]])
    points = np.tile(places, (3, 1, 1))
    points[1, 2] = np.nan
    found = pose_jacobian(points, np.array([0.0, 0.0, np.nan]), places, np.full(3, 1 / 3))
    assert np.isfinite(found[:2]).all()
    assert found[1, 2].tolist() == [[0.0, 0.0]] * 3
    assert np.isnan(found[2]).all()
