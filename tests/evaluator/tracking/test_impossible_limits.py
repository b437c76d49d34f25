"""From which step on a mark cannot have come there, and what counts as rest and as one body: both sides of a limit."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from evaluator.tracking.following import jumps as module
from evaluator.tracking.following.background import on_one_body, stays, strangers, travels
from evaluator.tracking.following.jumps import _pieces, off_course

TIMES = np.arange(120) / 30.0


def driving(step_px: float) -> np.ndarray:
    """Places of a mark that moves along x."""
    return np.stack([step_px * np.arange(120.0), np.full(120, 50.0)], axis=1)


@pytest.mark.parametrize(("radius", "room"), [(2.0, 1.5), (10.0, 3.5)])  # 0.35 of the radius, and no less than 1.5
@pytest.mark.parametrize(("share", "jumps"), [(0.97, False), (1.03, True)])
def test_a_mark_at_rest_that_is_elsewhere_for_a_frame_jumps_where_two_such_steps_are_no_motion(
    radius: float, room: float, share: float, *, jumps: bool
) -> None:
    points = driving(0.0)
    points[60, 1] += share * 2 * room
    assert np.flatnonzero(off_course(TIMES, points, radius)).tolist() == ([60] if jumps else [])


@pytest.mark.parametrize(("step", "jumps"), [(8.6, False), (8.8, True)])
def test_a_mark_that_moves_jumps_by_nine_fifths_of_its_usual_step_beside_that(step: float, *, jumps: bool) -> None:
    points = driving(4.0)
    points[60, 1] += sqrt(step**2 - 4.0**2)  # 1.5 + 1.8 · 4 = 8.7
    assert np.flatnonzero(off_course(TIMES, points, 2.0)).tolist() == ([60] if jumps else [])


@pytest.mark.parametrize(("frames", "followed"), [(14, False), (16, True)])
def test_a_jump_is_worth_fifteen_frames_that_the_mark_is_followed_for(frames: int, *, followed: bool) -> None:
    points = driving(4.0)
    points[120 - frames :, 1] += 90.0
    wrong = np.flatnonzero(off_course(TIMES, points, 2.0)).tolist()
    assert wrong == ([] if followed else list(range(120 - frames, 120)))


def shaken(reach_px: float, frames: int = 40) -> np.ndarray:
    return np.stack([100.0 + reach_px * (np.arange(frames) % 2), np.full(frames, 50.0)], axis=1)


@pytest.mark.parametrize(("reach", "rests"), [(2.9, True), (3.1, False)])
def test_a_thing_rests_that_stays_within_three_pixels(reach: float, *, rests: bool) -> None:
    ((rows, found),) = stays(shaken(reach), 9.0)
    assert (len(rows), found) == (40, rests)


@pytest.mark.parametrize(("frames", "rests"), [(4, True), (3, False)])
def test_rest_shows_in_four_frames(frames: int, *, rests: bool) -> None:
    assert [found for _, found in stays(shaken(0.0, frames), 9.0)] == [rests]


@pytest.mark.parametrize(("radius", "limit"), [(6.0, 6.0), (1.0, 3.0)])
def test_rows_are_cut_at_a_step_of_a_radius_and_no_less_than_three_pixels(radius: float, limit: float) -> None:
    for share, parts in ((0.98, 1), (1.02, 2)):
        places = shaken(0.0)
        places[20:, 0] += share * limit
        assert len(stays(places, radius)) == parts


@pytest.mark.parametrize(("way", "judged"), [(17.9, False), (18.1, True)])
def test_what_rests_is_judged_once_the_other_mark_has_moved_by_three_radii(way: float, *, judged: bool) -> None:
    mover = np.stack([10.0 + way * np.linspace(0.0, 1.0, 20), np.zeros(20)], axis=1)  # away from what rests
    assert on_one_body(np.zeros(2), mover, 6.0) != judged


@pytest.mark.parametrize(("share", "apart"), [(0.59, False), (0.61, True)])
def test_two_that_part_by_three_fifths_of_their_steps_are_no_body(share: float, *, apart: bool) -> None:
    k, part = np.arange(60.0), 1.0
    along = sqrt((part / share) ** 2 - (part / 2) ** 2)  # each step: 1 / share
    one, other = (np.stack([side * (20.0 + part / 2 * k), along * k], axis=1) for side in (-1.0, 1.0))
    assert strangers(one, other, 6.0) == apart


@pytest.mark.parametrize(("turn_deg", "moves"), [(27.0, True), (31.0, False), (-27.0, True)])
def test_a_mark_that_steps_by_more_than_its_radius_travels_where_it_turns_by_28_degrees_a_frame_at_most(
    turn_deg: float, *, moves: bool
) -> None:
    """Steps of 20 px that turn so differ by half of themselves: 2·sin(14.5°)."""
    steps = 20.0 * np.exp(1j * np.radians(turn_deg) * np.arange(119))
    way = np.concatenate([[0.0], np.cumsum(steps)])
    assert travels(np.stack([way.real, way.imag], axis=1), 6.0) == moves


def test_a_track_is_cut_at_a_jump_and_where_standing_beside_it_begins_and_ends() -> None:
    """The first frame of a rest is where the mark truly was, and the first that moves again is, too."""

    def frames(jumps: list[int], still: list[int]) -> list[tuple[int, int]]:
        flags = [np.isin(np.arange(19), rows) for rows in (jumps, still)]
        return [(piece.start, piece.stop) for piece in _pieces(flags[0], flags[1])]

    assert frames([5], []) == [(0, 6), (6, 20)]
    assert frames([5], [3, 4]) == [(0, 4), (4, 6), (6, 20)]
    assert frames([5], [6, 7]) == [(0, 6), (6, 9), (9, 20)]
    assert frames([5], [3, 4, 6, 7]) == [(0, 4), (4, 6), (6, 9), (9, 20)]
    assert frames([0, 18], [1, 17]) == [(0, 1), (1, 3), (3, 18), (18, 19), (19, 20)]
    assert frames([5], [2, 9]) == [(0, 6), (6, 20)]


@pytest.mark.parametrize(("share", "stands"), [(0.2, True), (0.3, False)])
def test_a_mark_stands_that_moves_less_than_a_quarter_of_its_usual_step(
    share: float, *, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[np.ndarray] = []
    monkeypatch.setattr(module, "_pieces", lambda jumps, still: seen.append(still) or _pieces(jumps, still))
    step = np.full(119, 4.0)
    step[50:55] = share * 4.0
    step[55] = 40.0
    points = np.stack([np.concatenate([[0.0], np.cumsum(step)]), np.full(120, 50.0)], axis=1)
    off_course(TIMES, points, 2.0)
    assert seen[0][50:55].all() == seen[0].any() == stands
