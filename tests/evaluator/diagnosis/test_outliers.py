"""Marks that jump and return are left out, also in the first and the last frame; ordinary noise and motion stay."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.noise.outliers import (
    APART_SHARE,
    CHANNELS,
    without_outliers,
    without_wrong_pairs,
)

SIGMA_MM = 0.003


def path(speed_mm_s: float = 3.0, begins_s: float = 0.0, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    time = np.arange(300) / 60
    driven = speed_mm_s * np.maximum(time - begins_s, 0)
    marks = np.column_stack([driven, np.sin(time), driven, np.sin(time) + 3.66])
    return np.asarray(marks + SIGMA_MM * rng.normal(size=marks.shape))


def test_jumps_of_a_tracker_are_left_out_and_nothing_else() -> None:
    marks = path()
    marks[[50, 120, 121], 0] += 0.4
    lost = np.isnan(without_outliers(marks))
    assert lost[[50, 120, 121], 0].all()
    assert lost[:, 2:].sum() == 0
    assert lost[:, 0].sum() <= 5


@pytest.mark.parametrize("frames", [(14,), (5, 22)])
def test_jumps_in_a_run_of_few_frames_do_not_pass_for_its_motion(frames: tuple[int, ...]) -> None:
    marks = path()[:30]
    marks[list(frames), 1] += 0.4
    assert np.flatnonzero(np.isnan(without_outliers(marks)[:, 0])).tolist() == list(frames)


@pytest.mark.parametrize("frame", [0, 1, 2, 5, -1, -2])
def test_a_jump_at_an_end_does_not_judge_itself(frame: int) -> None:
    marks = path()
    marks[frame, 3] -= 0.4
    lost = np.isnan(without_outliers(marks))
    assert lost[frame, 2:].all()
    assert lost[:, :2].sum() == 0


@pytest.mark.parametrize("begins_s", np.arange(8) / 60)
def test_the_beginning_of_motion_is_no_jump(begins_s: float) -> None:
    assert not np.isnan(without_outliers(path(6.0, begins_s))).any()


@pytest.mark.parametrize(("away_mm", "lost"), [(0.0, 0), (0.0044, 0), (0.0046, 2)])
def test_marks_without_noise_may_bend_by_nine_times_half_a_micrometre(away_mm: float, lost: int) -> None:
    still = np.tile([1.0, 2.0, 3.0, 4.0], (60, 1)) + 1e-7 * np.eye(60, 4)  # rounding is no jump
    still[30, 2] += away_mm
    assert np.isnan(without_outliers(still)[30, 2:]).sum() == np.isnan(without_outliers(still)).sum() == lost


@pytest.mark.parametrize("frame", [0, 150])
def test_a_jump_that_the_motion_hides_shows_in_what_a_model_leaves_over(frame: int) -> None:
    marks = path(20.0)
    marks[frame, 0] += 0.1
    assert not np.isnan(without_outliers(marks)).any()
    left = marks - path(20.0, seed=4)
    lost = np.isnan(without_outliers(left, CHANNELS))
    assert lost[frame, :2].all()
    assert lost.sum() == 2


@pytest.mark.parametrize("away", [(0.5, 2.0), (-3.0, 0.3)])
def test_a_reflection_taken_for_a_mark_in_many_frames_is_told_by_its_distance(away: tuple[float, float]) -> None:
    """One frame in eight, some in a row: a run was set aside as moved by a hand, and another as pushed."""
    rng, marks = np.random.default_rng(5), path()
    wrong = np.sort(rng.choice(300, 30, replace=False))
    wrong = np.union1d(wrong, [200, 201, 202, 0, 299])
    marks[wrong, :2] += np.array(away) + rng.normal(0.0, 0.2, (len(wrong), 2))
    lost = np.isnan(without_wrong_pairs(marks))
    assert (lost.any(axis=1) == lost.all(axis=1)).all()
    assert np.flatnonzero(lost[:, 0]).tolist() == wrong.tolist()


def test_a_distance_that_changes_slowly_or_little_is_that_of_the_camera() -> None:
    marks = path()
    marks[:, 3] += 0.08 * np.sin(np.arange(300) / 60)  # 2 % nearer and farther
    assert not np.isnan(without_wrong_pairs(marks)).any()
    for share, lost in ((0.8, False), (1.2, True)):
        exact = np.tile([1.0, 2.0, 1.0, 2.0 + 3.66], (60, 1))
        exact[30, 3] += share * APART_SHARE * 3.66
        assert np.isnan(without_wrong_pairs(exact)[30]).all() == lost
    noisy = path() + 0.02 * np.random.default_rng(1).normal(size=(300, 4))
    assert not np.isnan(without_wrong_pairs(noisy)).any()
    noisy[30, 1] += 0.1  # three standard deviations
    assert not np.isnan(without_wrong_pairs(noisy)).any()


def test_frames_without_marks_and_short_runs_stay_as_they_are() -> None:
    marks = path()
    marks[40:60] = np.nan
    marks[100, 1] += 2.0
    lost = np.isnan(without_wrong_pairs(marks))
    assert np.flatnonzero(lost[:, 0]).tolist() == [*range(40, 60), 100]
    short = path()[:12]
    short[5] += [2.0, 0.0, 0.0, 0.0]
    assert not np.isnan(without_wrong_pairs(short)).any()


@pytest.mark.parametrize("frames", [6, 9, 12])
def test_residuals_that_move_during_a_short_ramp_are_kept(frames: int) -> None:
    """A model without a ramp of its motors is off by it: frames of the ramp were outliers, and its duration 2 % off.

    Its residuals rest before and afterwards; a jump on the way is an outlier nevertheless.
    """
    rng = np.random.default_rng(4)
    since = np.clip((np.arange(240) - 60) / frames, 0.0, 1.0)
    way = (since - since**2 / 2) * 0.3 * frames  # of a robot that drives at once ahead of one that speeds up
    values = np.column_stack([way, 0.2 * way, np.zeros(240), np.zeros(240)]) + rng.normal(0, 0.003, (240, 4))
    kept = np.isfinite(without_outliers(values, CHANNELS))
    assert kept.all()
    values[[30, 60 + frames // 2, 150], 0] += 3.0
    seen = np.isfinite(without_outliers(values, CHANNELS)[:, 0])
    assert np.flatnonzero(~seen).tolist() == [30, 60 + frames // 2, 150]
    cleaned = without_outliers(np.column_stack([way, 0.2 * way, *np.zeros((2, 240))]), CHANNELS, corners=True)
    assert 55 <= np.flatnonzero(np.isnan(cleaned[:, 0]))[0] <= 60  # on open ground a path that turns at once is
