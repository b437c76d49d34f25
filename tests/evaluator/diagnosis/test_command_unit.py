"""Commands in another unit than turns of the wheels per minute, told from how fast the robot moves."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread import command_unit
from evaluator.diagnosis.mistakes.misread.command_unit import Factor, share_a_factor, speed_factors
from tests.evaluator.diagnosis.marks_of_motion import TIME, moving, recorded

RADIUS_MM = 0.5
ROBOT: Any = SimpleNamespace(driving_radius_mm=RADIUS_MM)
RPM = 2.0 * 60 / (2 * np.pi * RADIUS_MM)  # at which wheels of the robot roll as fast as it moves, 2 mm/s


@pytest.fixture(autouse=True)
def _without_slip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command_unit, "_slipped", lambda data, _: np.ones(len(data)))


def runs(*shares: float, turned: float = 0.2) -> list[RunData]:
    """Runs whose wheels turn at these shares of RPM according to the file, though all move alike."""
    run = recorded(moving(TIME))
    sides = ((1 - turned) * RPM, (1 + turned) * RPM)
    return [replace(run, id=f"r{k}", left_rpm=s * sides[0], right_rpm=s * sides[1]) for k, s in enumerate(shares)]


def found(data: list[RunData]) -> list[Factor | None]:
    return speed_factors(data, [ROBOT] * len(data))


@pytest.mark.parametrize(
    ("share", "unit", "times"),
    [
        (2 * np.pi / 60, "rad/s", 60 / (2 * np.pi)),
        (6.0, "deg/s", 1 / 6),
        (1 / 60, "turns per second", 60.0),
        (2 * np.pi / 60 * RADIUS_MM, "mm/s", 60 / (2 * np.pi) / RADIUS_MM),
        (2 * np.pi / 60 * RADIUS_MM / 1000, " m/s", 6e4 / (2 * np.pi) / RADIUS_MM),
    ],
)
@pytest.mark.parametrize("slip", [1.0, 1.2])
def test_a_unit_is_named_in_one_run_and_in_all(share: float, unit: str, times: float, slip: float) -> None:
    one, *right = found(runs(slip * share, slip, slip, slip))
    assert one is not None
    assert one.times == pytest.approx(times)
    assert unit in one.unit
    assert right == [None] * 3
    every = found(runs(*[slip * share] * 4))
    assert every == [one] * 4


def test_a_radius_that_is_a_diameter_and_a_gear_are_told_only_if_all_runs_share_them() -> None:
    assert found(runs(2.0, 1.0, 1.0, 1.0)) == [None] * 4
    (first, *rest) = found(runs(2.0, 2.1, 1.9, 2.0))
    assert first is not None
    assert (first.times, "diameter" in first.unit) == (0.5, True)
    assert rest == [first] * 3
    (gear, *_) = found(runs(298.0, 298.0, 298.0))
    assert gear is not None
    assert gear.times == pytest.approx(1 / 298, rel=0.01)
    assert gear.unit == ""
    assert "before its gear" in gear.words
    assert found(runs(298.0, 298.0)) == [None] * 2  # two runs are no session


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (0.531, None),
        (0.527, "diameter"),
        (0.473, "diameter"),
        (0.467, "before its gear"),
        (1.95, None),  # an effect of the catalogue may be the cause
        (2.05, "2.05 times as fast as commanded"),
    ],
)
def test_a_factor_that_an_effect_may_cause_is_left_to_the_diagnosis(times: float, words: str | None) -> None:
    (first, *_) = found(runs(*[1 / times] * 4))
    assert (first is None) == (words is None)
    assert words is None or (first is not None and words in first.words)


def test_the_factor_is_relative_to_a_simulation_that_slips(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command_unit, "_slipped", lambda data, _: np.full(len(data), 0.9))
    (first, *_) = found(runs(*[30.0 / 0.9] * 3))
    assert first is not None
    assert first.times == pytest.approx(1 / 30, rel=1e-3)


@pytest.mark.parametrize(
    ("shares", "shared"),
    [
        ((1.4, 1.4, 1.4, 1.4), False),  # slip
        ((1.55, 1.55, 1.55, 1.55), True),
        ((1 / 1.4, 1 / 1.4, 1 / 1.4), False),
        ((1 / 1.55, 1 / 1.55, 1 / 1.55), True),
        ((2.0, 2.0, 2.0, 2.0, 3.0), True),  # four in five
        ((2.0, 2.0, 2.0, 3.0), False),
        ((2.0, 2.0, 2.0, 2.0 * 1.12), True),
        ((2.0, 2.0, 2.0, 2.0 * 1.25), False),
    ],
)
def test_a_factor_that_runs_share_is_far_from_slip_and_alike(shares: tuple[float, ...], shared: bool) -> None:
    data = runs(*shares)
    assert share_a_factor(data, [ROBOT] * len(data)) is shared


def test_turns_on_the_spot_do_not_show_the_factor_and_have_that_of_the_others() -> None:
    spot = replace(recorded(moving(TIME, speed=0.1)), left_rpm=-3 * RPM, right_rpm=3.4 * RPM)
    factors = found([*runs(6.0, 6.0, 6.0), spot])
    assert factors[3] == factors[0] is not None
    assert found([*runs(1.0, 1.0, 1.0), spot])[3] is None
    assert found([spot, spot, spot]) == [None] * 3


def test_a_run_apart_from_the_others_has_no_factor_of_theirs() -> None:
    factors = found(runs(*[2.0] * 8, 1.0))
    assert factors[8] is None
    assert all(item is not None and item.times == 0.5 for item in factors[:8])
