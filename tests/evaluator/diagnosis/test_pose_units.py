"""Poses and commands in another unit are told by how fast robots drive and turn; a robot that slips is not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.pose_units import in_another_unit
from evaluator.diagnosis.mistakes.recognise import recognise
from simulator.robot import load_robot
from tests.evaluator.diagnosis.posed_runs import HUSKY, TIME, poses


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"positions": 1000.0}, "drives; positions were in mm"),
        ({"positions": 100.0}, "drives; positions were in cm"),
        ({"positions": 1e-3}, "drives; positions were in m and not in mm"),
        ({"headings": np.pi / 180}, "turns; headings were in radians"),
        (
            {"headings": 180 / np.pi / 8, "turn": 1.0},
            "turns; headings were in degrees",
        ),
        ({"speed": 9.0, "turn": 3.0}, "drives; commands were in rad/s"),
        (
            {"speed": 0.016, "turn": 0.006},
            "drives; commands were in deg/s and not in rad/s",
        ),
        (
            {"speed": 50.0, "turn": 20.0},
            "drives; commands were in turns per second or speeds of the wheels in m/s",
        ),
    ],
)  # fmt: skip
def test_what_is_in_another_unit_is_told_of_all_runs(wrong: dict[str, float], said: str) -> None:
    runs = [poses(number, **wrong) for number in range(6)]
    found = in_another_unit(runs, [HUSKY] * 6)
    assert [item.run for item in found] == [run.id for run in runs]
    assert {item.kind for item in found} == {"wrong-unit"}
    way, unit = said.split("; ")
    assert all(re.fullmatch(rf"{way} [\d.]+ times as fast as commanded, as if its {unit}", item.seen) for item in found)
    (mistake,) = recognise(runs, [HUSKY] * 6)
    assert (mistake.kind, mistake.everywhere) == ("wrong-unit", True)


@pytest.mark.parametrize(
    "slips", [{}, {"speed": 0.4}, {"turn": 0.05}, {"speed": 2.0, "turn": 2.0}, {"speed": 0.3, "turn": 0.04}]
)
def test_a_robot_that_slips_is_in_its_units(slips: dict[str, float]) -> None:
    assert in_another_unit([poses(number, **slips) for number in range(6)], [HUSKY] * 6) == []


def test_one_recording_of_several_in_another_unit_is_told_of_all_its_parts() -> None:
    """One of nine recordings in cm stopped a search after 180 s, which named a distortion of the measured x and y."""
    parts = [replace(poses(k), id=f"r{k // 4}@{k % 4}.0s") for k in range(12)]
    in_cm = [replace(poses(k, positions=100.0), id=f"r3@{k % 4}.0s") for k in range(12, 16)]
    found = in_another_unit([*parts, *in_cm], [HUSKY] * 16)
    assert [item.run for item in found] == [run.id for run in in_cm]
    assert "as if its positions were in cm" in found[0].seen
    said = recognise([*parts, *in_cm], [HUSKY] * 16)
    assert [item.runs for item in said] == [tuple(run.id for run in in_cm)]
    held = [replace(poses(k, speed=0.016, turn=0.006), id=f"r3@{k % 4}.0s") for k in range(12, 16)]
    assert in_another_unit([*parts, *held], [HUSKY] * 16) == []  # the robot is held or slips


def test_few_runs_runs_that_differ_and_marks_tell_no_unit() -> None:
    wrong = [poses(number, positions=1000.0) for number in range(6)]
    assert in_another_unit(wrong[:2], [HUSKY] * 2) == []
    mixed = [run if number % 2 else poses(number) for number, run in enumerate(wrong)]
    assert in_another_unit(mixed, [HUSKY] * 6) == []
    marks = [RunData(run.id, 40.0, 60.0, 0.0, None, TIME, run.marks_mm, run.order) for run in wrong]
    assert in_another_unit(marks, [HUSKY] * 6) == []
    assert in_another_unit([], []) == []


def test_commands_of_small_robots_are_left_to_their_simulation() -> None:
    barrel = load_robot("barrel")
    runs = [poses(number, speed=9.0, turn=3.0, robot=barrel) for number in range(6)]
    assert in_another_unit(runs, [barrel] * 6) == []
    runs = [poses(number, positions=1000.0, robot=barrel) for number in range(6)]
    assert len(in_another_unit(runs, [barrel] * 6)) == 6


@pytest.mark.parametrize(
    ("speed", "turn", "told"), [(0.18, 0.06, True), (0.18, 0.3, False), (0.18, 0.02, False), (0.36, 0.12, False)]
)
def test_one_recording_that_drives_and_turns_slower_by_one_factor_has_commands_in_another_unit(
    speed: float, turn: float, *, told: bool
) -> None:
    """One that only drives or only turns slower may be held; one of less than four times slower may slip."""
    slow = [replace(poses(number, speed=speed, turn=turn), id=f"r1@{3 * number}.0s") for number in range(6)]
    others = [replace(poses(number), id=f"r2@{3 * number - 18}.0s") for number in range(6, 12)]
    found = in_another_unit([*slow, *others], [HUSKY] * 12)
    assert [item.run for item in found] == [run.id for run in slow] * told
    assert all(item.seen.startswith("drives 0.18 times as fast as commanded") for item in found)
