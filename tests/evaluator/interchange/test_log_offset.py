"""The offset of a log whose clock differs by any amount, or that changes all the time, from the motion alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from evaluator.interchange import log_offset as room
from evaluator.interchange.commands import RunCommand
from evaluator.interchange.log_offset import LogOffset
from evaluator.pose import Poses
from evaluator.turning.clock import command_delay
from evaluator.workflow.runs.phases import command_delay_of
from simulator.command import Command

FRAME_S, LOG_S, NEAR_S = 0.02, 0.1, 2.0
Floats = np.ndarray


def joystick(seed: int, rows: int) -> Floats:
    """Left and right rpm (rows, 2) that wander, a row every tenth of a second."""
    rng = np.random.default_rng(seed)
    smooth = np.exp(-(np.linspace(-2, 2, 21) ** 2))
    noise = rng.normal(size=(rows + 20, 2))
    return 10 * np.stack([np.convolve(part, smooth, "valid") for part in noise.T], axis=1)


def driven(command: Command, time_s: Floats, late_s: float, seed: int = 0) -> Floats:
    """Poses of a robot that follows a log late, with gains of its own and noise of 0.02 mm and 0.01 rad."""
    fine = np.arange(time_s[0], time_s[-1] + FRAME_S, FRAME_S / 10) + FRAME_S / 20
    left, right = command.at(fine - late_s)
    heading = np.cumsum(0.02 * (right - left)) * FRAME_S / 10
    way = np.cumsum(0.04 * (left + right) * np.exp(1j * heading)) * FRAME_S / 10
    heading, way = (np.r_[0, part][: 10 * len(time_s) : 10] for part in (heading, way))
    noise = np.random.default_rng(seed).normal(size=(len(time_s), 3)) * [0.02, 0.02, 0.01]
    return np.column_stack([way.real, way.imag, heading]) + noise


def log_offset(time_s: Floats, pose: Floats, command: Command, near_s: float) -> LogOffset | None:
    return room.log_offset(time_s, pose, command.at, (command.time_s[0], command.time_s[-1]), near_s)


def log(seed: int = 1, rows: int = 200) -> Command:
    return Command.held_samples(LOG_S * np.arange(rows), joystick(seed, rows), starts_at_rest=False)


@pytest.mark.parametrize("late_s", [0.0, 0.31, -1.7, 100.0, -2500.0])
def test_offset_of_any_size_is_found_within_its_interval(late_s: float) -> None:
    time = np.arange(0, 20, FRAME_S) + late_s
    found = log_offset(time, driven(log(), time, late_s), log(), NEAR_S)
    assert found is not None
    assert found.low_s < late_s < found.high_s
    assert found.high_s - found.low_s < 0.02


def test_interval_holds_the_truth_in_about_95_percent() -> None:
    time = np.arange(0, 8, FRAME_S)
    found = [log_offset(time, driven(log(seed, 80), time, 0.3, seed), log(seed, 80), NEAR_S) for seed in range(20)]
    held = [one is not None and one.low_s < 0.3 < one.high_s for one in found]
    assert sum(held) >= 17


def test_interval_is_the_jackknife_over_eighths_of_the_recording_with_students_t(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Source: Tukey (1958), Ann. Math. Stat. 29, 614."""
    without = np.random.default_rng(3).normal(0.3, 0.01, room.BLOCKS)
    values = iter([0.31, *without])
    monkeypatch.setattr(room, "_least", lambda *_: next(values))
    time = np.arange(0, 20, FRAME_S)
    found = log_offset(time, driven(log(), time, 0.3), log(), NEAR_S)
    assert found is not None
    sigma = np.sqrt(7 / 8 * np.sum((without - without.mean()) ** 2))
    half = stats.t.ppf(0.975, 7) * sigma
    assert (found.value_s, found.low_s, found.high_s) == pytest.approx((0.31, 0.31 - half, 0.31 + half))


def test_a_log_that_repeats_itself_is_not_taken_for_one_of_another_repetition() -> None:
    rows = np.tile(joystick(3, 50), (4, 1))
    command = Command.held_samples(LOG_S * np.arange(200), rows, starts_at_rest=False)
    time = np.arange(5, 10, FRAME_S)
    found = log_offset(time, driven(command, time, 0.2), command, NEAR_S)
    assert found is not None
    assert found.value_s == pytest.approx(0.2, abs=0.02)


def test_of_what_does_not_move_or_is_too_short_nothing_is_known() -> None:
    time, still = np.arange(0, 5, FRAME_S), Command.constant(0.0, 0.0)
    assert log_offset(time, np.zeros((len(time), 3)), still, NEAR_S) is None
    assert log_offset(time[:20], np.zeros((20, 3)), log(), NEAR_S) is None


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize(
    "rows", [[(0, 0, 0), (9, 20, 10)], [(0, 20, 10), (1, 0, 0), (9, 0, 0)], [(0, 5, 9), (9, 0, 0)]]
)
def test_of_a_robot_that_stands_neither_the_offset_nor_the_delay_is_known(
    rows: list[tuple[int, int, int]], noise: float
) -> None:
    times, *sides = np.array(rows, float).T
    command = Command.held_samples(times, np.column_stack(sides), starts_at_rest=False)
    time = np.arange(0, 10, FRAME_S)
    for seed in range(5):
        still = 10 + noise * np.random.default_rng(seed).normal(size=(len(time), 3)) * [0.02, 0.02, 0.01]
        assert log_offset(time, still, command, NEAR_S) is None
        assert not np.isfinite(command_delay(time, still, [1.0, 4.0, 9.0]).value_s)


def test_no_interval_is_known_where_one_eighth_of_a_recording_holds_all_that_is_commanded() -> None:
    command = Command.steps([(0.0, 0.0, 0.0), (22.3, 20.0, 10.0), (22.8, 0.0, 0.0), (40.0, 0.0, 0.0)])
    time = np.arange(0, 40, FRAME_S)
    assert log_offset(time, driven(command, time, 0.0), command, NEAR_S) is None


def test_rounding_of_products_explains_no_motion_at_offsets_at_which_a_log_turns_nowhere() -> None:
    """Products of long logs are Fourier transforms; of a robot of UTIAS -99 s were found in place of 0.17."""
    rng = np.random.default_rng(2)
    measured = np.stack([60 + rng.normal(size=8000), rng.normal(size=8000)])
    commanded = np.stack([np.full(16000, 300.0), 100 * rng.normal(size=16000)])
    commanded[1, 7500:] = 0.0
    cost = room._cost(measured, commanded)
    ahead = room._of_sums(np.stack([[[60.0]], [[1.0]], [[3601.0]]]))
    assert cost[7600:] == pytest.approx(np.full(401, ahead[0]), abs=0.01)


def test_chance_reaches_a_cost_once_in_a_thousand_of_the_offsets_that_are_tried() -> None:
    limit = 2 * np.log(100 / 1e-3) / 50
    assert room._is_chance(np.array([0.0, -0.99 * limit, np.nan]), independent=50, tried=100)
    assert not room._is_chance(np.array([0.0, -1.01 * limit, np.nan]), independent=50, tried=100)
    assert room._is_chance(np.array([np.nan, np.nan]), independent=50, tried=100)


@pytest.mark.parametrize("late_s", [0.31, 12.0])
def test_delay_of_a_run_whose_log_changes_all_the_time_or_has_another_clock(late_s: float) -> None:
    time = np.arange(0, 20, FRAME_S) + late_s
    x, y, heading = driven(log(), time, late_s).T
    blank = np.full((len(time), 3, 3), np.nan)
    poses = Poses(time, x, y, heading, blank, np.full(len(time), "ok"))
    found = command_delay_of(RunCommand(log(), starts_at_rest=False, logged=True), poses)
    assert found.low_s < late_s < found.high_s
    assert found.is_known


@pytest.mark.parametrize(
    ("cost", "least"),
    [
        ((np.arange(7) - 3.37) ** 2, 3.37),
        ((np.arange(7) - 0.4) ** 2, 0.4),  # by the parabola through the first three
        ((np.arange(7) + 0.3) ** 2, -0.3),
        (-np.abs(np.arange(7) - 3.0), 1.0),  # no bend: the second
        (np.array([9, np.nan, 4, 1, 0, 1, 4]), 4.0),
    ],
)
def test_a_cost_is_least_at_the_vertex_of_the_parabola_about_its_least_value(cost: Floats, least: float) -> None:
    assert room._least(5.0 - 0.1 * np.arange(7), cost) == pytest.approx(5.0 - 0.1 * least)


def test_a_cost_is_the_log_of_what_a_log_leaves_of_both_velocities() -> None:
    products = np.array([[3.0, -3.0, 0.0, 5.0], [2.0, 2.0, 0.0, 0.0]])
    squares = np.array([[4.0, 4.0, 0.0, 5.0], [1.0, 1.0, 0.0, 0.0]])
    own = np.array([[9.0, 9.0, 9.0, 5.0], [8.0, 8.0, 8.0, 8.0]])
    found = room._of_sums(np.stack([products, squares, own]))
    # shares of 9/36 and 4/8; motion against its command explains nothing, and what explains all leaves 1e-12
    assert found == pytest.approx([np.log(0.75) + np.log(0.5), np.log(0.5), np.nan, np.log(1e-12)], nan_ok=True)


def test_costs_at_all_offsets_are_those_of_their_sums_over_eight_blocks() -> None:
    rng = np.random.default_rng(3)
    measured, commanded = rng.normal(size=(2, 50)), rng.normal(size=(2, 60))
    cost, sums = room._cost(measured, commanded), room._sums(measured, commanded, np.arange(11))
    assert sums.shape == (8, 3, 2, 11)
    assert room._of_sums(sums.sum(axis=0)) == pytest.approx(cost)
    for shift in range(11):
        part = commanded[:, shift : shift + 50]
        shares = np.sum(measured * part, axis=1) ** 2 / np.sum(measured**2, axis=1) / np.sum(part**2, axis=1)
        shares[np.sum(measured * part, axis=1) < 0] = 0
        assert cost[shift] == pytest.approx(np.log(1 - shares).sum())
    edges = np.linspace(0, 50, 9).astype(int)
    assert sums[3, 0, 1, 4] == pytest.approx(measured[1, edges[3] : edges[4]] @ commanded[1, 4:][edges[3] : edges[4]])


def test_velocities_are_means_over_what_is_averaged_and_commands_too() -> None:
    """Of an even acceleration the mean speed is that of the middle; commands are taken at sixteen middles of parts."""
    time, times, half = np.arange(0, 4, 0.05), np.array([1.0, 2.5]), 0.2
    way = 3.0 * time + time**2
    pose = np.column_stack([5 + way * np.cos(0.7), way * np.sin(0.7), np.full(len(time), 0.7)])
    np.testing.assert_allclose(room._measured(time, pose, times, half), [3.0 + 2 * times, [0, 0]], atol=1e-9)
    turning = np.column_stack([0 * time, 0 * time, 0.4 * time])
    np.testing.assert_allclose(room._measured(time, turning, times, half), [[0, 0], [0.4, 0.4]], atol=1e-12)
    found = room._commanded(lambda at: (2 + 3 * at, 8 + at**2), times, half)
    right = 8 + times**2 + half**2 / 3 * (1 - 1 / 16**2)
    np.testing.assert_allclose(found, [(2 + 3 * times + right) / 2, right - 2 - 3 * times])


@pytest.mark.parametrize(("better", "near"), [(0.68, True), (0.70, False)])
def test_a_far_offset_is_believed_where_it_halves_what_the_near_ones_leave(
    better: float, near: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    time = np.arange(0, 4, 0.1)
    place: dict[float, int] = {}

    def cost(measured: Floats, commanded: Floats) -> Floats:
        shifts = 0.1 * np.arange(round((time[-1] - 0) / 0.1), round((time[0] - 20) / 0.1) - 1, -1)[: commanded.shape[1]]
        found = np.full(commanded.shape[1] - measured.shape[1] + 1, -0.1)
        offsets = shifts[: len(found)]
        for at, value in ((-10.0, -3.0), (0.5, better - 3.0)):
            place[at] = int(np.argmin(np.abs(offsets - at)))
            found[place[at]] = value
        return found

    asked: list[Floats] = []
    monkeypatch.setattr(room, "_cost", cost)
    monkeypatch.setattr(room, "_sums", lambda _, __, window: asked.append(window) or np.zeros((8, 3, 2, len(window))))
    monkeypatch.setattr(room, "_of_sums", lambda sums: np.zeros(sums.shape[-1]))
    pose = np.column_stack([time, 0 * time, 0 * time])
    assert room.log_offset(time, pose, lambda at: (at, at), (0.0, 20.0), NEAR_S) is not None
    assert int(np.median(asked[0])) == place[0.5 if near else -10.0]
    assert len(asked[0]) == 21  # a second to either side
