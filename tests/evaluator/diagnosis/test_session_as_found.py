"""What is found of a whole session does to a prediction from the start pose what it does in the fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.assessment.session_as_found import as_driven, with_session
from evaluator.diagnosis.likelihood.known_to import predicted_sigmas, quantities
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.run_data import PER_RUN, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.settings import KnownTo
from simulator.effects.entry import EffectEntry
from simulator.robot import load_robot

ROBOT = load_robot("barrel")
TIME = np.arange(240) / 60
START = (3.0, -2.0, 0.7, 0.0, 0.0, 0.0, 0.0)


BLANK = RunData("r0", 33.3, 14.4, 0.5, None, TIME, np.zeros((len(TIME), 4)), 0)
KNOWN = quantities(KnownTo(), ROBOT, [BLANK])
TURNING = ("left_wheel_turns", "right_wheel_turns")
SHARED = [item.key for item in KNOWN if "." not in item.key]


RIPPLING = ROBOT.model_copy(update={"effect": (EffectEntry.model_validate({"id": "speed-ripple", "amplitude": 0.2}),)})


@pytest.fixture(scope="module")
def turn() -> RunData:
    """Four seconds of a turn as the robot file says, without noise."""
    (marks,) = Simulated([ROBOT], [BLANK], {}).marks([Task(0, START)])
    return replace(BLANK, marks_mm=marks)


@pytest.mark.parametrize("key", SHARED)
def test_a_quantity_of_the_session_moves_predicted_marks_as_in_the_fit(key: str, turn: RunData) -> None:
    item = next(item for item in KNOWN if item.key == key)
    nominal = {key: 2 * item.tolerance}
    nominal_robot = RIPPLING if key in TURNING else ROBOT
    forward = Simulated([nominal_robot], [turn], {}, predicted_sigmas(KNOWN))
    before, fitted = forward.marks([Task(0, START), Task(0, START, nominal)])
    point = Point(np.zeros((1, PER_RUN)), nominal)
    robot = with_session(nominal_robot, BLANK, KNOWN, point)
    predicted = Simulated([robot], as_driven([turn], KNOWN, point), {}).marks([Task(0, START)])[0]
    moved = float(np.abs(fitted - before).max())
    assert moved > 1e-4
    if key.startswith(("green", "yellow")):  # as one rigid shift: the distance of the marks stays
        fitted, predicted = (np.column_stack([m[:, :2] + m[:, 2:], _line(m)]) for m in (fitted, predicted))
    assert np.abs(predicted - fitted).max() < max(0.02 * moved, 2e-5)


@pytest.mark.parametrize(("key", "side"), [(key, side) for side, key in enumerate(TURNING)])
def test_wheels_that_turn_faster_at_an_equal_surface_speed_show_by_their_ripple_alone(
    key: str, side: int, turn: RunData
) -> None:
    """A motor that is 1 % slow was taken for a smaller wheel, whose ripple it turns out of phase: no known physics."""
    sizes, nominal = predicted_sigmas(KNOWN), {key: next(item.tolerance for item in KNOWN if item.key == key)}
    plain = Simulated([ROBOT], [turn], {}, sizes).marks([Task(0, START, nominal)])[0]
    np.testing.assert_allclose(plain, turn.marks_mm, atol=2e-5)
    speeds = [1 / 1.01 if number == side else 1.0 for number in (0, 1)]
    slips = {
        "drive-speed-mismatch": {"left_over_right": speeds[0] / speeds[1]},
        "drive-speed-scale": {"factor": sum(speeds) / 2},
    }
    entries = tuple(EffectEntry.model_validate({"id": name, **values}) for name, values in slips.items())
    smaller = RIPPLING.model_copy(update={"effect": (*RIPPLING.effect, *entries)})
    gains = (*START[:4], *(0.01 * (number == side) for number in (0, 1)), 0.0)  # of the motors of one run
    by_motor = Simulated([smaller], [turn], {}).marks([Task(0, gains)])[0]
    before, found = Simulated([RIPPLING], [turn], {}, sizes).marks([Task(0, START), Task(0, START, nominal)])
    moved = np.abs(found - before).max()
    assert moved > 0.005
    assert np.abs(by_motor - found).max() < 0.01 * moved


@pytest.mark.parametrize("key", ["plane_scale", "green_x_mm", "green_y_mm", "yellow_y_mm"])
def test_what_is_only_seen_moves_predicted_marks_alike_whatever_the_noise_of_those_measured(
    key: str, turn: RunData
) -> None:
    """Marks moved along their measured line explained the noise of its direction: a lie in straight runs."""
    nominal = {key: 5 * next(item.tolerance for item in KNOWN if item.key == key)}
    noise = np.random.default_rng(1).normal(0, 0.2, turn.marks_mm.shape)
    found = []
    for run in (turn, replace(turn, marks_mm=turn.marks_mm + noise)):
        found += Simulated([ROBOT], [run], {}, predicted_sigmas(KNOWN)).marks([Task(0, START, nominal)])
    assert np.abs(found[0] - turn.marks_mm).max() > 1e-3
    np.testing.assert_array_equal(*found)


def _line(marks: np.ndarray) -> np.ndarray:
    """Direction of the line through the marks, rad."""
    return np.unwrap(np.arctan2(marks[:, 1] - marks[:, 3], marks[:, 0] - marks[:, 2]))


def test_an_effect_that_the_session_has_too_stands_once_and_does_what_both_do() -> None:
    """Found at first by a robot named as tilted on a plate off level: the prediction was no number at all."""
    deviation = {item.key: 2 * item.tolerance for item in KNOWN if item.key in ("plate_level_x_deg", "time_base")}
    level = next(2 * item.sigma for item in KNOWN if item.key == "plate_level_x_deg")
    clock = next(2 * item.sigma for item in KNOWN if item.key == "time_base")
    given = {"plate-tilt": {"angle_deg": 4.0, "azimuth_deg": 90.0}, "time-base": {"factor": 1.01}}
    entries = tuple(EffectEntry.model_validate({"id": name, **values}) for name, values in given.items())
    tilted = ROBOT.model_copy(update={"effect": entries})
    robot = with_session(tilted, BLANK, KNOWN, Point(np.zeros((1, PER_RUN)), deviation))
    found = {entry.id: entry.given for entry in robot.effect}
    assert len(found) == len(robot.effect) == 2
    assert found["time-base"]["factor"] == pytest.approx(1.01 * (1 + clock))
    assert found["plate-tilt"]["angle_deg"] == pytest.approx(np.hypot(4.0, level))
    assert found["plate-tilt"]["azimuth_deg"] == pytest.approx(np.degrees(np.arctan2(4.0, level)))


def test_a_session_as_its_files_say_changes_nothing(turn: RunData) -> None:
    point = Point(np.zeros((1, PER_RUN)))
    assert with_session(ROBOT, BLANK, KNOWN, point) == ROBOT
    assert as_driven([turn], KNOWN, point) == (turn,)


def test_a_run_of_a_session_that_starts_late_starts_later_by_as_much(turn: RunData) -> None:
    late = next(item for item in KNOWN if item.key == "start_common_s")
    point = Point(np.zeros((1, PER_RUN)), {late.key: 2 * late.tolerance})
    (moved,) = as_driven([turn], KNOWN, point)
    assert moved.start_s == pytest.approx(turn.start_s + 2 * late.tolerance * late.per_unit)
    assert moved.run_command.command.at(moved.start_s - 1e-6) == (0.0, 0.0)
