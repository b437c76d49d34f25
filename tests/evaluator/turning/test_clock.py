"""How much later than its log a run moves: found from exact arcs before and after every change, with its interval."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from evaluator.turning.clock import (
    RISES_S,
    UNEVEN,
    CommandDelay,
    _changes_mm_s,
    _fewest,
    _independent,
    _longest,
    _misfit,
    _reach,
    _windows,
    command_delay,
    most_late_s,
)
from evaluator.turning.motion.velocity_change import left_over

FRAME_S = 0.05
Twist = tuple[float, float, float]  # forward and leftward mm/s, yaw rad/s
STRAIGHT, TURN, BACK = (4.0, 0.3, 0.0), (3.0, -0.5, 1.2), (-2.0, 0.4, -0.7)


def moved(start: np.ndarray, twist: Twist, time_s: float) -> np.ndarray:
    """Pose after a constant twist: an arc."""
    u, v, r = twist
    steps = np.linspace(0, time_s, 2001)
    heading = start[2] + r * steps
    path = (u + 1j * v) * np.exp(1j * heading)
    way = np.trapezoid(path, steps)
    return np.array([start[0] + way.real, start[1] + way.imag, heading[-1]])


def driven(time: np.ndarray, changes_s: list[float], *twists: Twist) -> np.ndarray:
    """Poses of a run whose twist changes at some times, (n, 3)."""
    starts, begin = [np.array([1.0, -2.0, 0.4])], [float(time[0]), *changes_s]
    for k in range(len(changes_s)):
        starts.append(moved(starts[-1], twists[k], begin[k + 1] - begin[k]))
    part = np.searchsorted(changes_s, time, side="right")
    return np.array([moved(starts[k], twists[k], t - begin[k]) for k, t in zip(part, time, strict=True)])


def noisy(pose: np.ndarray, seed: int, share: float = 0.0) -> np.ndarray:
    """Poses with noise of 0.02 mm and 0.01 rad; share: of each frame's that the next one keeps."""
    rng, noise = np.random.default_rng(seed), np.zeros_like(pose)
    fresh = rng.normal(size=pose.shape)
    noise[0] = fresh[0]
    for k in range(1, len(pose)):
        noise[k] = share * noise[k - 1] + np.sqrt(1 - share**2) * fresh[k]
    return pose + noise * [0.02, 0.02, 0.01]


@pytest.mark.parametrize("late", [-0.4, 0.0, 0.73])
def test_lateness_common_to_all_changes_is_found_whatever_its_sign(late: float) -> None:
    time, changes = np.arange(0, 9, FRAME_S), [2.5, 6.0]
    pose = driven(time, [change + late for change in changes], STRAIGHT, TURN, BACK)
    found = command_delay(time, noisy(pose, 1), [-5.0, *changes, 40.0])
    assert found.value_s == pytest.approx(late, abs=0.01)
    assert found.low_s < late < found.high_s
    assert found.is_known


@pytest.mark.parametrize("rise", [0.24, 0.6])
def test_lateness_is_that_of_the_beginning_of_a_change_that_takes_time(rise: float) -> None:
    """As of a heavy robot that slides until it has come up to speed; without a rise time 0.12 and 0.3 s too late."""
    late = 0.2
    found = delay_of_rising(rise, late)
    assert found.low_s < late < found.high_s
    assert 0 < found.high_s - found.low_s - 2 * UNEVEN * found.rise_s < 0.1
    assert found.rise_s == pytest.approx(rise, rel=0.4)
    assert found.settled_s == pytest.approx(late + rise, abs=0.2)


def test_interval_holds_the_delay_with_and_without_half_of_a_rise_that_is_too_short_to_be_seen() -> None:
    found = delay_of_rising(0.05, 0.2)
    assert found.rise_s == 0
    assert found.value_s == pytest.approx(0.225, abs=0.01)
    assert 0.15 < found.low_s < 0.2
    assert found.high_s > 0.225
    assert 0.05 < found.hidden_rise_s < 0.15
    assert found.settled_s > 0.25


def test_wheels_that_grip_half_as_well_as_on_ice_hide_no_longer_rise() -> None:
    """A wheel a millimetre from the middle changes by 7.8 mm/s, which takes 8 ms at a tenth of gravity."""
    assert delay_of_rising(0.05, 0.2, reach_mm=1.0).hidden_rise_s == pytest.approx(7.8 / 980, rel=0.05)


def test_changes_of_different_size_at_one_acceleration_do_not_move_the_delay() -> None:
    """With one rise time for both the delay came out 0.03 s too early, in an interval of 0.2 s."""
    late, twists = 0.2, ((8.0, 0.0, 1.0), (4.0, 0.3, 0.0), (-8.0, 0.3, -1.0))
    sizes = [sum(abs(b - a) for a, b in zip(*pair, strict=True)) for pair in pairwise(twists)]  # of a wheel 1 mm off
    found = delay_of_rising(0.6, late, (sizes[0] / sizes[1], 1.0), twists, reach_mm=1.0)
    assert found.low_s < late < found.high_s
    assert found.high_s - found.low_s - 2 * UNEVEN * found.rise_s < 0.04
    assert found.rise_s == pytest.approx(0.6, rel=0.1)


def test_interval_holds_the_beginning_of_a_change_that_fades_as_that_of_a_motor_with_lag() -> None:
    """A change that is steady, which is fitted, begins 0.05 s too early to be alike."""
    found = delay_of_rising(0.1, 0.2, fades=True)
    assert found.value_s < 0.19
    assert found.low_s < 0.2 < found.high_s


def delay_of_rising(
    rise: float,
    late: float,
    shares: tuple[float, float] = (1.0, 1.0),
    driven_at: tuple[Twist, ...] = (STRAIGHT, TURN, BACK),
    reach_mm: float = np.inf,
    *,
    fades: bool = False,
) -> CommandDelay:
    """What is found of two changes of velocity that take shares of a time, or have it as time constant."""
    changes = [2.5, 6.0]
    fine = np.arange(0, 9, FRAME_S / 20)
    twists = np.array(driven_at)
    since = [(fine - change - late) / (rise * share) for change, share in zip(changes, shares, strict=True)]
    parts = [(1 - np.exp(-np.maximum(part, 0)) if fades else np.clip(part, 0, 1))[:, None] for part in since]
    twist = twists[0] + parts[0] * (twists[1] - twists[0]) + parts[1] * (twists[2] - twists[1])
    heading = np.cumsum(twist[:, 2]) * FRAME_S / 20
    way = np.cumsum((twist[:, 0] + 1j * twist[:, 1]) * np.exp(1j * heading)) * FRAME_S / 20
    pose = np.column_stack([way.real, way.imag, heading])[::20]
    return command_delay(fine[::20], noisy(pose, 1), changes, reach_mm)


def test_constant_velocities_on_either_side_of_a_change_leave_nothing_of_their_arcs() -> None:
    since = np.arange(-1, 1, FRAME_S)
    headings, places = left_over(since, driven(since, [0.0], TURN, BACK))
    assert np.abs(headings).max() < 1e-9
    assert np.abs(places).max() < 1e-5  # of the arcs drawn above
    assert np.abs(left_over(since, driven(since, [0.2], TURN, BACK))[1]).max() > 0.05


@pytest.mark.parametrize("times", [2.0, 100.0])
def test_misfit_grows_with_the_square_of_the_noise_and_has_no_other_part(times: float) -> None:
    """Of two changes; of noise that is alike from frame to frame by 0.6 what is left over is alike, too."""
    time, changes = np.arange(0, 9, FRAME_S), [2.5, 6.0]
    exact = driven(time, changes, STRAIGHT, TURN, BACK)
    noise = 1e-4 * (noisy(exact, 4, 0.6) - exact)
    windows = [(change, np.abs(time - change) <= 1.0) for change in changes]
    less, freedom, alike = _misfit(time, exact + noise, windows, 0.0)
    more, _, _ = _misfit(time, exact + times * noise, windows, 0.0)
    assert more / less == pytest.approx(times**2, rel=1e-3)
    assert freedom == 2 * (3 * 41 - 9)
    assert alike == pytest.approx(0.55, abs=0.15)


def scatter(share: float, runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors of some runs, and the parts of their intervals above; below, a rise time may hide."""
    time = np.arange(0, 3, FRAME_S)
    pose = driven(time, [1.62], STRAIGHT, TURN)
    found = [command_delay(time, noisy(pose, seed, share), [1.5]) for seed in range(runs)]
    return np.array([one.value_s - 0.12 for one in found]), np.array([one.high_s - one.value_s for one in found])


def test_interval_is_that_of_95_percent_and_wider_where_noise_lasts() -> None:
    error, half = scatter(0.0, 12)
    assert (np.abs(error) < half).sum() >= 9
    assert half.mean() == pytest.approx(1.96 * error.std(), rel=0.5)  # of twelve, known to a fifth
    _, lasting = scatter(0.7, 6)
    assert lasting.mean() > 1.15 * half.mean()


@pytest.mark.parametrize("late", [1.9, -1.9, 2.1, -2.1])
def test_delays_of_two_seconds_are_found_and_larger_ones_unknown(late: float) -> None:
    time, changes = np.arange(0, 20, FRAME_S), [6.0, 13.0]
    pose = driven(time, [change + late for change in changes], STRAIGHT, TURN, BACK)
    found = command_delay(time, noisy(pose, 1), changes)
    assert found.value_s == pytest.approx(late, abs=0.01) if abs(late) < 2 else np.isnan(found.value_s)


@pytest.mark.parametrize("frames", [11, 14])
def test_a_change_needs_six_frames_in_half_of_its_distance_to_the_beginning(frames: int) -> None:
    time, changes = FRAME_S * np.arange(60), [(frames - 0.5) * FRAME_S]
    late = command_delay(time, noisy(driven(time, changes, STRAIGHT, TURN), 3), changes)
    assert late.value_s == pytest.approx(0.0, abs=0.02) if frames > 12 else np.isnan(late.value_s)


@pytest.mark.parametrize(("changes", "late"), [([2.5, 6.0, 8.7], 0.25), ([0.2, 6.0], 0.5), ([0.2, 6.0], 0.0)])
def test_a_change_just_before_an_end_of_the_recording_does_not_move_the_delay(
    changes: list[float], late: float
) -> None:
    """At some delays it has too few frames; misfits with and without them are not comparable."""
    time, twists = np.arange(0, 9, FRAME_S), [(0.0, 0.0, 0.0), TURN, BACK, STRAIGHT]
    pose = driven(time, [change + late for change in changes], *twists[: len(changes) + 1])
    found = command_delay(time, noisy(pose, 1), changes)
    assert found.value_s == pytest.approx(late, abs=0.01)
    assert found.low_s < late < found.high_s


def test_nothing_is_known_without_a_change_in_the_recording_and_little_of_a_wide_interval() -> None:
    time = np.arange(0, 3, FRAME_S)
    pose = noisy(driven(time, [1.5], STRAIGHT, STRAIGHT), 2)
    assert not command_delay(time, pose, []).is_known
    assert not command_delay(time, pose, [-1.0, 3.5]).is_known
    assert CommandDelay(0.1, -0.35, 0.64).is_known
    assert not CommandDelay(0.1, -0.35, 0.66).is_known


def test_velocity_has_settled_after_the_longest_delay_and_all_of_a_rise_or_half_of_a_hidden_one() -> None:
    assert CommandDelay(0.1, 0.05, 0.2, rise_s=0.3).settled_s == pytest.approx(0.5)
    assert CommandDelay(0.1, 0.05, 0.2, hidden_rise_s=0.3).settled_s == pytest.approx(0.35)


def test_delays_are_found_within_half_of_the_distance_of_two_changes_but_for_six_frames() -> None:
    """Half distances of 1.25, 1.75 and 1.475 s, from each of which 0.3 s: changes have room for 0.95 and 1.175 s."""
    time = np.arange(0, 9, FRAME_S)
    assert most_late_s(time, [-1.0, 2.5, 6.0, 12.0]) == pytest.approx((0.95 + 1.175) / 2)
    assert most_late_s(np.arange(0, 40, FRAME_S), [20.0]) == 2.0
    assert most_late_s(time, [2.0, 2.5, 3.0]) == 0.0
    windows, room = _windows(np.arange(0, 40, FRAME_S), [20.0], 0.3)
    seen = np.arange(0, 40, FRAME_S)[windows[0][1]]
    assert (seen[0], seen[-1]) == pytest.approx((17.0, 23.0))
    assert room == pytest.approx([19.95 / 2 - 0.3])


def test_change_of_a_wheel_is_that_of_its_whole_velocity() -> None:
    """2 mm from the middle: |1| + |0.8| + 2 · |1.2|, and |5| + |0.9| + 2 · |1.9| mm/s, whatever the heading."""
    time, changes = np.arange(0, 9, FRAME_S), [2.5, 6.0]
    pose = driven(time, changes, STRAIGHT, TURN, BACK)
    assert _changes_mm_s(time, pose, changes, changes, 2.0) == pytest.approx([4.2, 9.7], rel=1e-3)
    assert _changes_mm_s(time, pose, changes, [6.0], 2.0) == pytest.approx([9.7], rel=1e-3)
    assert _changes_mm_s(time, pose, changes, changes, np.inf).tolist() == [np.inf, np.inf]


@pytest.mark.parametrize(("most", "step"), [(0.3, 0.14 / 32), (0.01, 0.02 / 32), (0.05, 0.03 / 32), (2.0, 0.0)])
def test_longest_rise_time_is_found_to_a_thirty_second_of_the_tried_ones(most: float, step: float) -> None:
    found = _longest(lambda rise: rise <= most, [0.0, *RISES_S.tolist()])
    assert min(most, 1.0) - step <= found <= min(most, 1.0)


@pytest.mark.parametrize(("way", "distance"), [(1, 0.05), (-1, 0.1)])
def test_limits_of_a_delay_are_where_the_misfit_has_grown_to_its_limit(way: int, distance: float) -> None:
    found = _reach(lambda late: 1 + (late - 0.2) ** 2 * (4.0 if late > 0.2 else 1.0), 0.2, way, 1.01, 0.025)
    assert found == pytest.approx(distance, rel=1e-4)


def test_frames_that_are_alike_count_for_fewer() -> None:
    time = np.arange(0, 3, FRAME_S)
    pose, windows = noisy(driven(time, [1.5], STRAIGHT, TURN), 2, 0.6), [(1.5, np.abs(time - 1.5) <= 1.0)]
    _, freedom, alike = _misfit(time, pose, windows, 0.0)
    assert 0.2 < alike < 0.9
    found = _independent(time, pose, windows, 0.0, np.zeros(1))
    assert found == pytest.approx(freedom / (1 + 2 * sum(alike**k for k in range(1, 200))))


@pytest.mark.parametrize(("since", "fewest"), [([-2, -1, 0, 1, 2, 3], 2), ([-3, -2, -1, 0, 1], 1)])
def test_a_change_has_the_frames_of_its_poorer_side(since: list[float], fewest: int) -> None:
    assert _fewest(np.array(since)) == fewest
