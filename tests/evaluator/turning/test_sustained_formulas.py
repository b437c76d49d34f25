"""The parts of the smallest sustained radius, each on numbers worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from evaluator.turning import sustained
from evaluator.turning.motion.curvature import Curvature
from evaluator.turning.motion.fit import fit_turn, fit_turns, part, scaled_poses
from evaluator.turning.sustained import (
    QUARTER_TURN_RAD,
    Sustained,
    _between,
    _jumping,
    _known_to,
    _mean_of,
    _one_curvature,
    _only,
    _pieces,
    _shrunk,
    _wander,
    _with_change,
    sustained_turn,
)

from .synthetic import winding_poses


def pieces_of(turned_rad: float, frames: int, finer: int = 1, *, steady: bool = True) -> list[np.ndarray]:
    """Pieces of one region of even turning."""
    region, none = np.ones(frames, dtype=bool), np.zeros(frames, dtype=bool)
    regions = [none, region, none] if steady else [region, none, none]
    return _pieces(np.linspace(0.3, 0.3 + turned_rad, frames), regions, finer)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize(("quarters", "pieces"), [(0.5, 4), (4.0, 4), (4.9, 4), (5.0, 5), (8.0, 8)])
def test_steady_turn_is_cut_into_quarter_turns_and_four_at_least(sense: int, quarters: float, pieces: int) -> None:
    found = pieces_of(sense * quarters * QUARTER_TURN_RAD, 800)
    assert len(found) == pieces
    assert sum(piece.sum() for piece in found) >= 799  # each frame in one of them
    assert max(piece.sum() for piece in found) - min(piece.sum() for piece in found) <= 2


def test_pieces_are_finer_when_asked_and_never_shorter_than_sixteen_frames() -> None:
    assert len(pieces_of(5 * QUARTER_TURN_RAD, 800, finer=4)) == 20
    assert len(pieces_of(5 * QUARTER_TURN_RAD, 64, finer=4)) == 4
    assert len(pieces_of(QUARTER_TURN_RAD, 7)) == 0


@pytest.mark.parametrize(("quarters", "pieces"), [(0.9, 0), (1.0, 1), (2.5, 2)])
def test_before_and_after_the_steady_turn_only_quarter_turns_count(quarters: float, pieces: int) -> None:
    assert len(pieces_of(quarters * QUARTER_TURN_RAD, 200, steady=False)) == pieces


def test_frames_between_shares_of_a_turn_hold_both_ends_and_eight_at_least() -> None:
    heading = np.linspace(0, -2.0, 41)
    inside = np.arange(41)
    first, second = _between(heading, inside, [(0.0, 0.25), (0.5, 1.0)])
    assert np.flatnonzero(first).tolist() == list(range(11))
    assert np.flatnonzero(second).tolist() == list(range(20, 41))
    assert _between(heading, inside, [(0.0, 0.16)]) == []  # seven frames
    assert len(_between(heading, inside, [(0.0, 0.176)])) == 1  # eight


def test_frames_that_noise_puts_beyond_the_ends_of_a_turn_are_of_its_first_and_last_part() -> None:
    heading = np.linspace(0, 2.0, 41)
    heading[3], heading[38] = -0.1, 2.1
    first, last = _between(heading, np.arange(41), [(0.0, 0.25), (0.75, 1.0)])
    assert np.flatnonzero(first).tolist() == list(range(11))
    assert np.flatnonzero(last).tolist() == list(range(30, 41))


def test_frames_rejected_by_fits_are_left_out() -> None:
    region = np.array([False, True, True, False, True])
    used = np.array([True, False, True])
    assert _only(region, used).tolist() == [False, True, False, False, True]
    assert region.sum() == 3
    fits: list[Any] = [SimpleNamespace(used=used)]
    assert _jumping([region], fits).tolist() == [False, False, True, False, False]


def test_a_quarter_turn_is_known_to_its_noise_its_systematic_part_and_a_millionth() -> None:
    assert _known_to(Curvature(0.2, 0.1, 0.3, 0.03, 0.04)) == pytest.approx(0.05)
    assert _known_to(Curvature(-0.2, -0.2, -0.2, 0.0)) == pytest.approx(2e-7)


def test_p_value_of_one_curvature_is_that_of_chi_squared_about_the_weighted_mean() -> None:
    fits: list[Any] = [
        SimpleNamespace(curvature=lambda v=value: Curvature(v, v, v, 0.01)) for value in (0.20, 0.21, 0.24)
    ]
    test = _one_curvature(fits)
    squares = ((np.array([0.20, 0.21, 0.24]) - 0.65 / 3) ** 2).sum() / 1e-4
    assert test.p_value == pytest.approx(stats.chi2.sf(squares, 2), rel=1e-4)
    assert test.sigmas == pytest.approx(np.full(3, 0.01), rel=1e-6)


def test_mean_of_quarter_turns_is_weighted_by_noise_and_spread_with_students_bounds() -> None:
    mean = _mean_of(np.array([0.2, 0.3]), np.array([0.3, 0.0]), 0.4)
    weight = np.array([1 / 0.25, 1 / 0.16])
    assert mean.value == pytest.approx((weight @ [0.2, 0.3]) / weight.sum())
    assert mean.sigma == pytest.approx(weight.sum() ** -0.5)
    assert mean.high - mean.value == pytest.approx(stats.t.ppf(0.975, 1) * mean.sigma)
    assert mean.value - mean.low == pytest.approx(stats.t.ppf(0.975, 1) * mean.sigma)


def test_uncertainty_of_the_mean_enters_a_shrunk_value_by_the_share_that_is_shrunk() -> None:
    shrunk = _shrunk(Curvature(20.0, 14.0, 26.0, 3.0), Curvature(10.0, 8.0, 12.0, 1.0), 4.0)
    assert shrunk.value == pytest.approx(10 + 10 * 16 / 25)
    assert shrunk.sigma == pytest.approx(np.hypot(3 * 4 / 5, 9 / 25))
    assert shrunk.high - shrunk.value == pytest.approx(1.96 * shrunk.sigma)


def test_change_inside_a_window_widens_its_bounds_by_the_square_of_its_share_of_the_turn() -> None:
    fit: Any = SimpleNamespace(
        curvature=lambda: Curvature(-0.2, -0.2, -0.2, 0.0),
        change_rad=np.array([0.3, 0.4]),
        motion=SimpleNamespace(turn_rad=2.0),
    )
    wide = _with_change(fit)
    reach = 0.25 / 4.0 * 0.2
    assert (wide.low, wide.high) == pytest.approx((-0.2 - reach, -0.2 + reach))


def test_centre_wanders_by_its_scatter_less_what_noise_explains() -> None:
    places = [(0.0, 0.0), (2.0, 0.0), (1.0, 3.0)]
    fits: list[Any] = [
        SimpleNamespace(center_mm=lambda p=place: (np.array(p), np.diag([0.3, 0.2]))) for place in places
    ]
    # Squares about the mean (1, 1): 2 + 2 + 4 = 8, half of it is the variance, less 0.5 of noise.
    assert _wander(fits) == pytest.approx(np.sqrt(4 - 0.5))
    loud: list[Any] = [SimpleNamespace(center_mm=lambda: (np.zeros(2), np.eye(2)))] * 3
    assert _wander(loud) == 0.0


def measured(curvature: np.ndarray, sense: int = 1, systematic: float = 0.0) -> tuple[np.ndarray, Sustained]:
    """The sustained turn of a path of this curvature, (n,), in steps of 0.04 mm, with noise of 1 µm."""
    pose = winding_poses(sense * curvature, 0.04)
    pose = pose + np.random.default_rng(0).normal(size=pose.shape) * [1e-3, 1e-3, 5e-4]
    time = np.arange(len(pose)) / 50
    shifts = None
    if systematic:  # an error of the camera's scale
        shifts = systematic * np.stack([pose[:, :1], pose[:, 1:2], 0 * pose[:, :1]], axis=1)
    scaled = scaled_poses(pose, np.tile(np.diag([1e-6, 1e-6, 2.5e-7]), (len(pose), 1, 1)), shifts)
    steady = np.ones(len(pose), dtype=bool)
    regions = [~steady, steady, ~steady]
    return time, sustained_turn(time, scaled, regions, fit_turn(time, part(scaled, steady)))


@pytest.mark.parametrize("sense", [1, -1])
def test_tightest_quarter_turn_of_two_arcs_is_in_the_tighter_one_and_found_when_it_was_driven(sense: int) -> None:
    tight, wide = np.full(round(np.pi / 0.25 / 0.04), 0.25), np.full(round(np.pi / 0.2 / 0.04), 0.2)
    time, found = measured(np.concatenate([wide, tight, wide, wide[:4]]), sense)
    assert found.varies
    assert found.tightest.value == pytest.approx(sense * 0.25, rel=2e-3)
    assert abs(found.tightest.value - sense * 0.25) < 3 * found.tightest.sigma
    assert found.tightest.high - found.tightest.low == pytest.approx(2 * 1.96 * found.tightest.sigma, rel=0.01)
    assert time[len(wide) - 5] <= found.from_s < found.to_s <= time[len(wide) + len(tight) + 5]
    assert found.to_s - found.from_s == pytest.approx(len(tight) / 2 / 50, rel=0.05)  # a quarter of its half turn
    # Four quarter turns of 0.2 and two of 0.25: mean 0.2167, standard deviation 0.0258.
    assert found.mean.value == pytest.approx(sense * 0.2167, rel=2e-3)
    assert found.spread_per_mm == pytest.approx(0.0258, rel=0.02)
    assert found.p_value < 1e-3


def test_one_radius_is_that_of_the_whole_with_all_its_bounds() -> None:
    _, found = measured(np.full(800, 0.2))
    assert not found.varies
    assert found.tightest is found.mean
    assert found.spread_per_mm == 0.0
    assert 1e-3 < found.p_value <= 1.0
    assert found.wander_mm < 0.01


def test_error_of_the_camera_is_the_same_share_of_the_tightest_curvature_as_of_the_whole() -> None:
    half = np.full(round(np.pi / 0.2 / 0.04), 0.2)
    _, found = measured(np.concatenate([half, 1.2 * half, half]), systematic=0.01)
    assert found.tightest.systematic == pytest.approx(0.01 * 0.24, rel=0.05)
    assert found.mean.systematic == pytest.approx(0.01 * 0.213, rel=0.05)


def test_run_too_short_for_a_quarter_turn_is_that_of_the_whole_known_no_better_than_it_changes() -> None:
    _, found = measured(np.concatenate([np.full(90, 0.18), np.full(90, 0.22)]))
    assert found.varies
    assert found.tightest.value == pytest.approx(0.2, rel=0.01)
    assert found.tightest.high - found.tightest.value == pytest.approx(1.96 * found.spread_per_mm, rel=0.02)
    assert found.spread_per_mm == pytest.approx(0.0231, rel=0.1)


def test_quarter_turns_weigh_by_their_inverse_variance_whatever_their_sense() -> None:
    mean = _mean_of(np.array([-0.2, -0.3, -0.3]), np.array([0.01, 0.02, 0.02]), 0.0)
    assert mean.value == pytest.approx((-0.2 * 4 - 0.3 - 0.3) / 6)
    assert mean.sigma == pytest.approx(0.02 / np.sqrt(6))


def test_frames_that_jump_in_a_piece_are_no_part_of_the_tightest_window() -> None:
    """Thirty frames that the pieces reject would bend a quarter turn by per cents."""
    tight, wide = np.full(round(np.pi / 0.25 / 0.04), 0.25), np.full(round(np.pi / 0.2 / 0.04), 0.2)
    pose = winding_poses(np.concatenate([wide, tight, wide, wide[:4]]), 0.04)
    pose = pose + np.random.default_rng(0).normal(size=pose.shape) * [1e-3, 1e-3, 5e-4]
    pose[500:508, :2] += 0.3
    time = np.arange(len(pose)) / 50
    scaled = scaled_poses(pose, np.tile(np.diag([1e-6, 1e-6, 2.5e-7]), (len(pose), 1, 1)))
    steady = np.ones(len(pose), dtype=bool)
    found = sustained_turn(time, scaled, [~steady, steady, ~steady], fit_turn(time, part(scaled, steady)))
    assert found.tightest.value == pytest.approx(0.25, rel=4e-3)


@pytest.mark.parametrize(("aside", "looked_at"), [(0.05, False), (0.15, True)])
def test_frames_rejected_by_the_fit_to_the_whole_are_in_no_piece_unless_they_are_a_tenth_of_all(
    monkeypatch: pytest.MonkeyPatch, aside: float, looked_at: bool
) -> None:
    pose = winding_poses(np.full(400, 0.2), 0.04)
    scaled = scaled_poses(pose, np.tile(np.diag([1e-6, 1e-6, 2.5e-7]), (len(pose), 1, 1)))
    time, steady = np.arange(len(pose)) / 50, np.ones(len(pose), dtype=bool)
    used = np.arange(len(pose)) >= aside * len(pose)
    whole = replace(fit_turn(time, part(scaled, steady)), used=used)
    pieces: list[np.ndarray] = []

    def noted(time_s: np.ndarray, poses: Any, windows: list[np.ndarray], **said: Any) -> Any:
        pieces.extend(windows)
        return fit_turns(time_s, poses, windows, **said)

    monkeypatch.setattr(sustained, "fit_turns", noted)
    sustained_turn(time, scaled, [~steady, steady, ~steady], whole)
    assert np.any(pieces, axis=0)[~used].any() == looked_at
    assert np.any(pieces, axis=0)[used].all()


@pytest.mark.parametrize(("chance", "varies"), [(0.9e-3, True), (1.1e-3, False)])
def test_a_run_of_one_radius_varies_once_in_a_thousand(
    monkeypatch: pytest.MonkeyPatch, chance: float, varies: bool
) -> None:
    """Pieces of three sizes are tested: each has a third of the probability."""
    pose = winding_poses(np.full(400, 0.2), 0.04)
    scaled = scaled_poses(pose, np.tile(np.diag([1e-6, 1e-6, 2.5e-7]), (len(pose), 1, 1)))
    time, steady = np.arange(len(pose)) / 50, np.ones(len(pose), dtype=bool)
    whole = fit_turn(time, part(scaled, steady))
    tested = sustained._one_curvature
    sizes: list[int] = []

    def by_chance(fits: Any) -> Any:
        sizes.append(len(fits))
        return replace(tested(fits), p_value=chance / 3)

    monkeypatch.setattr(sustained, "_one_curvature", by_chance)
    assert sustained_turn(time, scaled, [~steady, steady, ~steady], whole).varies == varies
    assert len(sizes) == 3


def test_tightest_quarter_turn_is_found_where_it_lies_between_two_coarse_steps() -> None:
    """One of 0.25 after two and a quarter of 0.2: half steps hold three quarters of it, 0.2375 in the mean."""
    quarter = np.pi / 2 / 0.2 / 0.04
    before, after = np.full(round(2.25 * quarter), 0.2), np.full(round(2.75 * quarter), 0.2)
    time, found = measured(np.concatenate([before, np.full(round(0.8 * quarter), 0.25), after]))
    assert found.tightest.value > 0.245
    assert found.from_s == pytest.approx(time[len(before)], abs=0.15 * quarter / 50)


def test_tightest_window_of_a_run_that_tightens_to_its_end_is_its_last_quarter_turn() -> None:
    """A window beyond the end would hold less than a quarter turn, and be tighter than any that the run sustains."""
    curvature = np.linspace(0.15, 0.3, 500)
    time, found = measured(curvature)
    heading = np.cumsum(curvature * 0.04)
    last = heading >= heading[-1] - QUARTER_TURN_RAD
    assert found.to_s == time[-1]
    assert found.from_s == pytest.approx(time[last][0], abs=0.03)
    assert found.tightest.value == pytest.approx(curvature[last].mean(), rel=2e-3)
