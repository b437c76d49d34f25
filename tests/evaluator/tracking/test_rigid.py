from __future__ import annotations

import numpy as np
import pytest

from evaluator.tracking.uncertainty.rigid_pair import Distance, wrong_ends
from tests.evaluator.tracking.synthetic import turning_marks

SIGMA = 0.01


def measured(frames: int = 300) -> list[np.ndarray]:
    """Two marks on a circle seen at a slant, with noise: (n, 5) as the tracker keeps them."""
    rng = np.random.default_rng(1)
    marks = []
    for truth in turning_marks(frames, (200.0, 150.0), 60.0, 10.0, 0.02).values():
        seen = truth * [1.0, 0.97] / (1.0 + 1e-4 * truth[:, :1])
        noise = rng.normal(0, SIGMA, seen.shape)
        variances = np.tile([SIGMA**2, SIGMA**2, 0.0], (frames, 1))
        marks.append(np.column_stack([seen + noise, variances]))
    return marks


def test_perspective_and_slant_are_no_wrong_distance() -> None:
    one, other = measured()
    distance = Distance(one[:, :2], other[:, :2])
    assert 0.8 < distance.ratio(distance.variance(one[:, 2:], other[:, 2:])) < 1.25
    assert not np.any(wrong_ends(np.arange(300) / 60, (one, other)))


def test_two_seconds_of_a_recording_show_by_the_distance_what_the_stated_uncertainty_lacks() -> None:
    one, other = measured(60)
    distance = Distance(one[:, :2], other[:, :2])
    stated = distance.variance(one[:, 2:], other[:, 2:])
    assert 0.6 < distance.ratio(stated) < 1.5
    assert 2.4 < distance.ratio(stated / 4.0) < 6.0


@pytest.mark.parametrize("culprit", [0, 1])
def test_of_two_marks_at_a_wrong_distance_the_one_off_its_course_is_wrong(culprit: int) -> None:
    marks = measured()
    along = marks[1][:, :2] - marks[0][:, :2]
    marks[culprit][120:122, :2] += 11 * SIGMA * (along / np.hypot(*along.T)[:, None])[120:122]
    wrong = wrong_ends(np.arange(300) / 60, (marks[0], marks[1]))
    assert set(np.flatnonzero(wrong[culprit])) == {120, 121}
    assert not wrong[1 - culprit].any()


def test_both_are_wrong_where_the_courses_do_not_tell() -> None:
    marks = measured()
    for mark in marks:
        mark[115:150] = np.where(np.arange(115, 150)[:, None] == 132, mark[115:150], np.nan)
    marks[0][132, :2] += 1.0
    wrong = wrong_ends(np.arange(300) / 60, (marks[0], marks[1]))
    assert wrong[0][132]
    assert wrong[1][132]
