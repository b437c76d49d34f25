"""Rules by which a run is cut into phases, on numbers worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.turning.motion.curvature import Curvature
from evaluator.turning.motion.fit import Scaled
from evaluator.turning.phase_table import Kind, Phase, _cuts, _measured, _Piece, _same, phase_table, several_motions

LENGTH_MM, FRAMES, FRAME_S = 2.0, 100, 0.02


@pytest.mark.parametrize(("step", "cuts"), [(1.33, []), (1.39, [50])])
def test_a_change_of_mean_is_cut_where_it_saves_ten_times_the_logarithm_of_the_samples(
    step: float, cuts: list[int]
) -> None:
    """Two halves of 50 apart by d save 25·d²; ten logarithms of 100 are 46.05, d = 1.357."""
    samples = np.zeros((100, 3))
    samples[50:] = step * np.array([0.6, 0.0, -0.8])
    assert _cuts(samples) == cuts


def test_every_change_is_cut_and_a_short_one_back_is_not() -> None:
    samples = np.zeros((200, 3))
    samples[60:140, 1] = 3.0
    samples[140:, 2] = -3.0
    samples[30, 0] = 5.0  # a sample of a hundred and more costs two pieces
    assert _cuts(samples) == [60, 140]
    assert _cuts(samples[:1]) == []
    samples[:] = [[50.0, 0.0, 0.0], *[[0.0] * 3] * 198, [0.0, 50.0, 0.0]]
    assert _cuts(samples) == [1, 199]  # also of one sample, at either end


@pytest.mark.parametrize(("change_rad", "motions"), [(0.016, 1), (0.025, 2)])
def test_a_motion_ends_where_its_direction_changes_by_a_fiftieth(change_rad: float, motions: int) -> None:
    """From straight ahead to a wide turn: the change is the curvature times the length of the heading.

    Of 200 samples, halves apart by d save 50·(d / 0.02)²; ten logarithms of 200 are 53, d = 0.0206.
    """
    heading = np.concatenate([np.zeros(200), change_rad / LENGTH_MM * 0.04 * np.arange(200)])
    way = np.cumsum(0.04 * np.exp(1j * heading))
    pose = np.column_stack([way.real, way.imag, heading])
    pose += 1e-5 * np.random.default_rng(0).normal(size=pose.shape) * [1, 1, 1 / LENGTH_MM]
    scaled = Scaled(pose, np.tile(1e-10 * np.eye(3), (400, 1, 1)), np.zeros(2), LENGTH_MM, 1e-5)
    stretched = pose * [1, 1, LENGTH_MM]
    found = phase_table(FRAME_S * np.arange(400), scaled, stretched, np.ones(400, bool))
    assert len([one for one in found if one.kind != "transient"]) == motions


def piece(kind: Kind, value: float | None = None, half: float = 0.01, speed: float = 2.0) -> _Piece:
    curvature = None if value is None else Curvature(value, value - half, value + half, half / 2)
    return _Piece(0, 1, Phase(0.0, 1.0, kind, speed_mm_s=speed, turned_deg=90.0), curvature)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (piece("rest"), piece("rest"), True),
        (piece("rest"), piece("transient"), False),
        (piece("rest"), piece("turn", 0.2), False),
        (piece("turn", 0.2), piece("turn", 0.24), True),
        (piece("turn", 0.2), piece("turn", 0.26), False),  # beyond five quarters
        (piece("turn", -0.26), piece("turn", -0.2), False),
        (piece("turn", 0.2), piece("turn", -0.2), False),
        (piece("turn", 0.2), piece("turn", 0.2, speed=-2.0), False),
        (piece("straight", 0.0), piece("straight", 0.02), True),
        (piece("spot", 5.0), piece("spot", 50.0), True),
        (piece("spot", 5.0), piece("turn", 4.5), True),
        (piece("straight", 0.0, 0.09), piece("turn", 0.2), False),  # may be bent by 0.09, not by half of 0.2
        (piece("straight", 0.0, 0.11), piece("turn", 0.2), True),
        (piece("turn", -0.2), piece("straight", 0.0, 0.11), True),
        (piece("turn", 0.2), piece("straight", 0.15, 0.02), True),  # more than half as bent, for sure
        (piece("turn", 0.2), piece("straight", -0.15, 0.02), False),
    ],
)
def test_neighbours_are_one_motion_where_their_curvatures_may_be_alike(one: _Piece, other: _Piece, same: bool) -> None:
    assert _same(one, other) == same
    assert _same(other, one) == same


def phase(kind: Kind, seconds: float, turned_deg: float = 0.0, speed: float = 2.0) -> Phase:
    return Phase(0.0, seconds, kind, speed_mm_s=speed, turned_deg=turned_deg)


@pytest.mark.parametrize(
    ("second", "several"),
    [
        (phase("turn", 0.9, 44.0), False),  # 9 % of the time, and less than half a right angle
        (phase("turn", 0.9, 46.0), True),
        (phase("turn", 0.9, -46.0), True),
        (phase("turn", 1.2, 5.0), True),
        (phase("straight", 5.0, 3.0), False),
        (phase("straight", 5.0, speed=-2.0), True),  # back
        (phase("rest", 30.0), False),
        (phase("transient", 30.0, 90.0), False),
    ],
)
def test_a_motion_counts_from_a_tenth_of_the_time_or_half_a_right_angle_on(second: Phase, several: bool) -> None:
    assert (several_motions((phase("straight", 9.0), second)) != "") == several


@pytest.mark.parametrize(
    ("start_s", "stop_s", "several"),
    [(None, None, True), (None, 9.5, True), (None, 9.2, False), (9.0, None, False), (9.0, 9.5, False)],
)
def test_what_a_robot_does_before_its_start_and_after_its_stop_is_no_motion_of_the_run(
    start_s: float | None, stop_s: float | None, *, several: bool
) -> None:
    """Driven 9 s ahead and back by a turn of 90 degrees in 1 s, of which half is one of 45."""
    ahead, back = phase("straight", 9.0), replace(phase("turn", 10.0, 91.0, speed=-2.0), start_s=9.0)
    assert (several_motions((ahead, back), start_s, stop_s) != "") == several
    assert back.within(9.5, 9.75) == replace(back, start_s=9.5, stop_s=9.75, turned_deg=91 / 4)
    assert ahead.within(9.0, 9.5) is None


def test_turns_to_both_sides_are_two_motions_and_motions_are_counted_in_words() -> None:
    left, right, spot = phase("turn", 3.0, 90.0), phase("turn", 3.0, -90.0), phase("spot", 3.0, 90.0)
    assert several_motions((left, left)) == ""
    said = "several motions (3 turn, 1 turn on the spot): no single radius or speed; see the phases"
    assert several_motions((left, right, left, spot)) == said


def driven(radius_mm: float, speed: float, offset_mm: tuple[float, float] = (-1.5, 0.4)) -> tuple[Scaled, np.ndarray]:
    """Poses of a point beside the centre of a robot on a circle, and its twists: forward, left, length · yaw rate."""
    yaw = speed / radius_mm
    heading = yaw * FRAME_S * np.arange(FRAMES)
    cos, sin = np.cos(heading), np.sin(heading)
    x = radius_mm * sin + cos * offset_mm[0] - sin * offset_mm[1]
    y = -radius_mm * cos + sin * offset_mm[0] + cos * offset_mm[1]
    noise = 1e-4 * np.random.default_rng(0).normal(size=(FRAMES, 3))
    scaled = Scaled(
        pose=np.column_stack([x, y, heading]) + noise * [1, 1, 1 / LENGTH_MM],
        covariance=np.tile(1e-8 * np.eye(3), (FRAMES, 1, 1)),
        offset_mm=np.array(offset_mm),
        length_mm=LENGTH_MM,
        sigma_mm=1e-4,
    )
    twist = np.array([speed - yaw * offset_mm[1], yaw * offset_mm[0], LENGTH_MM * yaw])
    return scaled, np.tile(twist, (FRAMES, 1))


def measured(scaled: Scaled, twist: np.ndarray, moving: np.ndarray, first: int = 0, stop: int = FRAMES) -> _Piece:
    return _measured(FRAME_S * np.arange(FRAMES), scaled, twist, moving, first, stop, 5)


@pytest.mark.parametrize(("radius", "speed"), [(5.0, 3.0), (5.0, -3.0), (-8.0, 2.0)])
def test_a_piece_of_a_circle_has_the_radius_and_speed_of_the_robots_centre(radius: float, speed: float) -> None:
    found = measured(*driven(radius, speed), np.ones(FRAMES, bool)).phase
    assert found.kind == "turn"
    assert found.radius_mm == pytest.approx(abs(radius), rel=1e-3)
    assert found.radius_low_mm < found.radius_mm < found.radius_high_mm
    assert found.speed_mm_s == pytest.approx(speed)
    assert found.turned_deg == pytest.approx(np.degrees(speed / radius * FRAME_S * 99), abs=0.05)
    assert (found.start_s, found.stop_s) == pytest.approx((0.0, 99 * FRAME_S))


@pytest.mark.parametrize(("radius", "kind"), [(0.38, "spot"), (0.42, "turn"), (1e6, "straight")])
def test_on_the_spot_is_a_radius_below_a_fifth_of_half_the_distance_of_the_marks(radius: float, kind: Kind) -> None:
    assert measured(*driven(radius, 1.0), np.ones(FRAMES, bool)).phase.kind == kind


def test_a_piece_at_rest_for_half_of_its_frames_is_rest_and_one_of_few_frames_is_in_between() -> None:
    scaled, twist = driven(5.0, 3.0)
    assert measured(scaled, twist, np.arange(FRAMES) < 49).phase.kind == "rest"
    assert measured(scaled, twist, np.arange(FRAMES) < 51).phase.kind == "turn"
    every = np.ones(FRAMES, bool)
    # Where a piece begins or ends within a run, half a window of five frames is the neighbour's.
    kinds = [measured(scaled, twist, every, *ends).phase.kind for ends in ((0, 20), (0, 21), (20, 45), (20, 46))]
    assert kinds == ["transient", "turn", "transient", "turn"]


def test_a_short_piece_late_in_a_run_keeps_half_of_its_frames() -> None:
    """Half a window of 20 frames at either end would leave nothing of 40: a quarter of the piece is enough."""
    scaled, twist = driven(5.0, 3.0)
    found = _measured(FRAME_S * np.arange(FRAMES), scaled, twist, np.ones(FRAMES, bool), 50, 90, 20).phase
    assert (found.kind, found.radius_mm) == ("turn", pytest.approx(5.0, rel=1e-3))
