"""Formulas by which mistakes are recognised, each with a recording in closed form on either side of its limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.disturbances import _span, disturbed_runs, standing_runs, wrong_scale
from evaluator.diagnosis.mistakes.jump import jump
from evaluator.diagnosis.mistakes.motion import displacement_over, motion_of
from evaluator.diagnosis.mistakes.spacing import spacing
from evaluator.diagnosis.mistakes.start.late_start import late_starts
from tests.evaluator.diagnosis.marks_of_motion import RATE, TIME, moving, onset_s, recorded
from tests.evaluator.diagnosis.straight_session import GREEN, ROBOT, ROLLED_MM_S, YELLOW, driven, session


def along(way: np.ndarray, angle: np.ndarray | float = 0.0, across: np.ndarray | float = 0.0) -> np.ndarray:
    """Marks 2 mm to the left and right of a robot at (way, across), turned by angle, rad, (n, 4)."""
    middle = np.column_stack([way, np.broadcast_to(across, way.shape)])
    turned = np.broadcast_to(angle, way.shape)
    left = 2 * np.column_stack([-np.sin(turned), np.cos(turned)])
    return np.concatenate([middle + left, middle - left], axis=1)


def summed(rate: np.ndarray) -> np.ndarray:
    """Integral of a rate over the frames, 0 at the first."""
    return np.concatenate([[0.0], np.cumsum(rate[:-1]) / RATE])


def happens(run: RunData) -> list[str]:
    return [item.kind for item in disturbed_runs([run], [ROBOT])]


def between(first_s: float, last_s: float) -> np.ndarray:
    return np.asarray((first_s <= TIME) & (last_s > TIME))


@pytest.mark.parametrize(("rate", "pushed"), [(0.75, False), (0.85, True), (-0.85, True)])
def test_a_robot_turned_on_its_way_is_pushed_from_three_fifths_of_its_speed_on(rate: float, pushed: bool) -> None:
    """Turned for 0.62 s while its middle goes straight on, from then at 1.5 mm/s times the cosine of half a rad."""
    angle = summed(rate * between(1.2, 1.82))
    assert happens(recorded(along(1.5 * TIME, angle))) == (["pushed"] if pushed else [])


@pytest.mark.parametrize(("share", "pushed"), [(0.5, False), (0.7, True), (-0.7, True)])
def test_a_robot_is_pushed_that_slides_aside_at_three_fifths_of_its_speed(share: float, pushed: bool) -> None:
    aside = summed(1.5 * share * between(1.5, 2.1))
    assert happens(recorded(along(1.5 * TIME, across=aside))) == (["pushed"] if pushed else [])


@pytest.mark.parametrize(("speed", "pushed"), [(-0.8, False), (-1.05, True)])
def test_a_robot_is_pushed_that_goes_back_against_its_wheels(speed: float, pushed: bool) -> None:
    """For 0.6 s, not faster than it drives: at 1.5 mm/s forward, less than at 0.9 backward is a stop."""
    found = happens(recorded(along(summed(np.where(between(1.5, 2.1), speed, 1.5)))))
    assert ("pushed" in found) == pushed


@pytest.mark.parametrize(("speed", "pushed"), [(2.2, False), (2.7, True)])
def test_a_turn_on_the_spot_is_pushed_by_its_speed_half_a_mm_from_its_centre(speed: float, pushed: bool) -> None:
    yaw = 3.0 * TIME
    heading = np.exp(1j * yaw)
    place = np.concatenate([[0], np.cumsum((heading * speed * between(1.5, 2.1))[:-1]) / RATE])
    marks = along(place.real, yaw, place.imag)
    assert happens(recorded(marks)) == (["pushed"] if pushed else [])


@pytest.mark.parametrize(("yaw", "stuck"), [(0.4, True), (0.6, False)])
def test_a_robot_that_turns_on_at_half_its_rate_does_not_stand(yaw: float, stuck: bool) -> None:
    held = between(1.5, 2.1)
    angle = summed(np.where(held, yaw, 1.0))
    path = np.concatenate([[0], np.cumsum((1.5 * ~held * np.exp(1j * angle))[:-1]) / RATE])
    assert happens(recorded(along(path.real, angle, path.imag))) == (["stuck"] if stuck else [])


@pytest.mark.parametrize(("stop_s", "found"), [(0.97, []), (1.05, ["stuck"])])
def test_less_than_three_quarters_of_a_second_at_a_command_is_not_judged(stop_s: float, found: list[str]) -> None:
    """The motors start with the first frame and have come up a quarter of a second later."""
    way = summed(np.where(between(0.4, 0.85), 0.0, 1.5))
    assert happens(replace(recorded(along(way)), stop_s=stop_s)) == found


@pytest.mark.parametrize(("at_s", "found"), [(0.35, []), (0.5, ["pushed"])])
def test_eight_frames_of_steady_motion_before_a_push_show_it(at_s: float, found: list[str]) -> None:
    """0.45 mm within 80 ms, in a run of 1.5 s, steady from a quarter of a second on."""
    aside = 0.45 * np.clip((TIME - at_s) / 0.08, 0.0, 1.0)
    assert happens(replace(recorded(along(1.5 * TIME, across=aside)), stop_s=1.45)) == found


def test_a_push_before_a_gap_is_no_ripple() -> None:
    """The motion before the gap was the push itself, and what it would lead to after the gap counted as usual."""
    share = np.clip((TIME - 1.2) / 0.3, 0.0, 1.0)
    run = recorded(along(1.5 * TIME - 1.3 * share, 0.2 * share, 0.2 * share))
    seen = (run.time_s < 1.48) | (run.time_s > 2.2)
    assert happens(replace(run, time_s=run.time_s[seen], marks_mm=run.marks_mm[seen])) == ["pushed"]


def test_a_brief_push_is_told_with_all_frames_of_the_windows_that_it_moves() -> None:
    """Pushed from 1.5 to 1.7 s: windows of 0.15 s, one every 0.075 s, whose middles are from 1.45 to 1.75 s."""
    aside = 0.6 * np.clip((TIME - 1.5) / 0.2, 0.0, 1.0)
    (found,) = disturbed_runs([recorded(along(1.5 * TIME, across=aside))], [ROBOT])
    begin, end = found.seen.removeprefix("moves unlike the rest of the run from ").removesuffix(" s").split(" to ")
    assert (float(begin), float(end)) == pytest.approx((1.375, 1.825), abs=0.03)


def test_a_push_soon_after_the_start_of_a_short_run_is_seen() -> None:
    """A run of 1.1 s that was pushed by 0.5 mm 0.6 s after its start gave the verdict "unknown"."""
    aside = 0.5 * np.clip((TIME - 0.6) / 0.06, 0.0, 1.0)
    run, seen = recorded(along(3.0 * TIME, across=aside)), TIME < 1.1
    assert happens(replace(run, time_s=run.time_s[seen], marks_mm=run.marks_mm[seen])) == ["pushed"]


def test_a_run_moves_at_its_command_from_a_quarter_of_a_second_after_its_start_to_its_stop() -> None:
    run = recorded(moving(TIME))
    assert _span(replace(run, start_s=-1.0)) == pytest.approx((0.25, TIME[-1]))
    assert _span(replace(run, start_s=0.7, stop_s=2.0)) == pytest.approx((0.95, 2.0))
    assert _span(replace(run, stop_s=9.0))[1] == TIME[-1]


@pytest.mark.parametrize(("share", "stands"), [(0.048, True), (0.052, False)])
def test_the_way_that_wheels_roll_ends_with_the_motors(share: float, stands: bool) -> None:
    way = share * ROLLED_MM_S * np.clip(TIME - 0.5, 0.0, 1.5)
    run = replace(recorded(along(way)), left_rpm=30.0, start_s=0.5, stop_s=2.0)
    assert standing_runs([run], [ROBOT]) == ({"r"} if stands else set())


def test_a_run_that_is_switched_off_before_it_is_seen_does_not_stand() -> None:
    still = recorded(along(0 * TIME))
    assert standing_runs([replace(still, start_s=-2.0, stop_s=-1.0)], [ROBOT]) == set()
    assert standing_runs([replace(still, left_rpm=0.0, right_rpm=0.0)], [ROBOT]) == set()


def gap(
    shift_mm: float = 0.0, noise_mm: float = 1e-4, speeds: tuple[float, float] = (2.0, 2.0), yaw: float = 0.0
) -> float:
    """How far a robot is carried aside over 25/60 s without frames, its speeds before and after, and its yaw after."""
    end = 105 / RATE
    middle = (79 / RATE + end) / 2
    way = speeds[0] * np.minimum(TIME, middle) + speeds[1] * np.maximum(TIME - middle, 0.0)
    angle = yaw * np.maximum(TIME - middle, 0.0)
    path = np.concatenate([[0], np.cumsum(np.diff(way) * np.exp(1j * angle[:-1]))])
    marks = along(path.real, angle, path.imag + shift_mm * (end <= TIME))
    keep = (TIME <= 79.5 / RATE) | (end <= TIME)
    run = recorded(marks[keep], TIME[keep], noise_mm)
    return displacement_over(run, (79 / RATE, end), (0.0, 3.0))


def test_a_displacement_counts_beyond_eight_sigmas_carried_over_the_gap() -> None:
    """Fifteen frames, 14/60 s, tell a velocity that is carried over 26/60 s: 2.9 times the scatter of a frame."""
    sigma = 0.03
    limit = 8 * sigma / np.sqrt(2) * (1 + 26 / 14)
    assert gap(0.5 * limit, sigma) == 0.0
    assert gap(1.6 * limit, sigma) == pytest.approx(1.6 * limit, rel=0.3)


@pytest.mark.parametrize(("away_s", "seen"), [(0.9, True), (1.2, False)])
def test_nothing_is_known_of_an_interval_beside_which_the_robot_is_out_of_view_for_a_second(
    away_s: float, *, seen: bool
) -> None:
    """A turn that leaves the view 0.15 s after a window with an odd velocity, and comes back elsewhere."""
    marks = along(2.0 * TIME + 3.0 * (TIME > 1.2))
    keep = (TIME < 1.15) | (1.15 + away_s < TIME)
    run = recorded(marks[keep], TIME[keep])
    assert (displacement_over(run, (1.0, 1.15), (0.0, 3.0)) > 2.0) == seen


def test_speeds_that_differ_across_a_gap_explain_as_much_as_they_carry_in_half_of_it() -> None:
    allowed = (5.0 - 2.0) * 13 / RATE
    for speeds in ((2.0, 5.0), (5.0, 2.0)):
        assert gap(0.0, speeds=speeds) == 0.0
        assert gap(0.8 * allowed, speeds=speeds) == 0.0
        assert gap(1.3 * allowed, speeds=speeds) == pytest.approx(1.3 * allowed, rel=0.1)
    turned = 2 * 3.0 * 13 / RATE  # 2 mm from the middle to a mark
    assert gap(0.8 * turned, yaw=3.0) == 0.0
    assert gap(1.4 * turned, yaw=3.0) > turned


def test_a_step_is_a_jump_beyond_four_of_the_usual_ones() -> None:
    for times, seen in ((3.6, False), (4.4, True)):
        way = 2.0 * TIME + (times - 1) * 2.0 / RATE * (TIME >= 1.5)
        assert (jump(recorded(along(way))) is not None) == seen


@pytest.mark.parametrize(("frame", "seen"), [(4, False), (5, True), (19, True), (20, False)])
def test_a_jump_has_five_frames_on_either_side(frame: int, seen: bool) -> None:
    way = 2.0 * TIME[:24] + 0.5 * (np.arange(24) >= frame)
    assert (jump(recorded(along(way))) is not None) == seen


def test_motion_is_told_of_four_windows_or_more() -> None:
    assert motion_of(recorded(moving(TIME[:21]))) is None  # 0.35 s: three
    motion = motion_of(recorded(moving(TIME[:24])))
    assert motion is not None
    assert len(motion.time_s) == 4


def test_motion_begins_beyond_six_sigmas_of_rest_told_by_second_differences() -> None:
    """Noise of ±a in turn in one coordinate of two has second differences of 2a in the middle of all: √6 sigmas."""
    a = 0.02
    limit = 6 * 1.4826 * 2 * a / np.sqrt(6) + 0.02
    swing = a * (-1.0) ** np.arange(180)
    for way, begins in ((limit - 0.01, False), (limit + 0.03, True)):
        run = recorded(along(way * np.maximum(TIME - 1.0, 0.0) / 2, across=swing), noise_mm=0.0)
        assert (onset_s(run) is not None) == begins


def test_onset_is_told_by_the_first_two_fifths_of_a_second_of_motion() -> None:
    since = np.maximum(TIME - 1.0, 0.0)
    faster = recorded(along(since + 5.0 * np.maximum(since - 0.43, 0.0)))
    assert onset_s(faster) == pytest.approx(1.0, abs=2e-3)


def test_onset_is_told_of_fifteen_frames_and_of_the_last_four_that_move() -> None:
    short = recorded(moving(np.maximum(TIME[:20] - 0.15, 0.0), 2.0, 0.0))
    assert onset_s(short) == pytest.approx(0.15, abs=0.01)
    assert onset_s(replace(short, time_s=TIME[:14], marks_mm=short.marks_mm[:14])) is None
    late = recorded(along(2.0 * np.maximum(TIME - 2.91, 0.0)), noise_mm=0.0)  # 0.02 mm beyond rest in the last four
    away = 2.0 * (TIME[-4:] - 2.91)
    assert away[0] > 0.02 > away[0] - 2.0 / RATE
    assert onset_s(late) == pytest.approx(2.91, abs=1e-3)


def test_starts_that_scatter_alike_are_nobodys_mistake() -> None:
    late = [0.3, 0.0, -0.3]
    runs = [driven(number, begins_s=1.0 + by, start_s=1.0) for number, by in enumerate(late)]
    assert late_starts(runs, [ROBOT] * 3) == []
    first, second = late_starts([runs[0], runs[2]], [ROBOT] * 2)  # two have no usual lag
    assert first.correction is not None
    assert second.correction is not None
    assert (first.correction.later_s, second.correction.later_s) == pytest.approx((0.3, -0.3), abs=0.03)


@pytest.mark.parametrize(("factor", "to_mm"), [(1e-3, 1e3), (0.1, 10.0), (1 / 25.4, 25.4), (1e3, 1e-3)])
def test_marks_in_another_unit_are_put_right_by_the_factor_to_mm(factor: float, to_mm: float) -> None:
    (found,) = wrong_scale(session(driven(0, scale=factor)), [ROBOT] * 8)
    assert found.correction is not None
    assert found.correction.marks_times == pytest.approx((to_mm, to_mm))
    apart = factor * np.hypot(*(GREEN - YELLOW))
    assert found.seen == f"its marks are {apart:.4g} mm apart, in the robot file {np.hypot(*(GREEN - YELLOW)):.4g} mm"


def test_spacing_is_seen_from_the_first_frame_to_the_last() -> None:
    marks = moving(TIME)
    marks[0] *= 1.5
    marks[-1] *= 2.0
    ratio = spacing(marks, 4.0).ratio
    assert (ratio[0], ratio[1], ratio[-1]) == pytest.approx((1.5, 1.0, 2.0))
