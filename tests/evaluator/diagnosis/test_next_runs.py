"""Runs are proposed until what they tell, together with the runs at hand, keeps a rival away."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.design.candidate_runs import CandidateRun
from evaluator.diagnosis.design.next_runs import (
    ENOUGH_SIGMAS,
    MOST_RUNS,
    Information,
    hypothetical,
    runs_until_enough,
)
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.simulation import Simulated
from simulator.robot import load_robot


def of_one_parameter(differs: list[float], imitates: list[float], *, known: float, at_hand: float = 0.0) -> Information:
    """Candidates that show a difference in one feature, and a rival whose one parameter moves that feature too."""
    y, x = np.array(differs), np.array(imitates)
    return Information(y**2, (x * y)[:, None], (x**2)[:, None, None], at_hand**2, np.zeros(1), np.array([[known]]))


def test_a_separation_is_what_the_rival_cannot_imitate_within_what_is_known_of_it() -> None:
    # one feature y = 3, slope 2, prior information 5: y² - (2·3)²/(5 + 2²)
    told = of_one_parameter([3.0], [2.0], known=5.0)
    assert told.squares([])[0] == pytest.approx(9.0 - 36.0 / 9.0)
    # made twice, the two together are imitated with one parameter
    assert told.squares([0])[0] == pytest.approx(18.0 - 144.0 / 13.0)


def test_runs_at_hand_count_and_a_run_that_tells_more_is_made_until_it_is_enough() -> None:
    told = of_one_parameter([0.5, 2.0], [0.0, 0.0], known=1.0, at_hand=3.0)
    runs, sigmas = runs_until_enough([told])
    assert runs == [1] * 4  # 3² + 4·2² = 25
    assert sigmas == pytest.approx(ENOUGH_SIGMAS)


def test_a_rival_that_imitates_every_run_is_not_kept_away_by_any_number_of_them() -> None:
    told = of_one_parameter([4.0, 8.0], [40.0, 80.0], known=1.0)
    runs, sigmas = runs_until_enough([told])
    assert len(runs) == MOST_RUNS
    assert sigmas < 0.2


def test_of_two_rivals_each_gets_the_run_that_tells_of_it() -> None:
    first = of_one_parameter([6.0, 0.0], [0.0, 0.0], known=1.0)
    second = of_one_parameter([0.0, 5.5], [0.0, 0.0], known=1.0)
    runs, sigmas = runs_until_enough([first, second])
    assert sorted(runs) == [0, 1]
    assert sigmas == pytest.approx(5.5)


def test_a_candidate_run_that_cannot_be_simulated_takes_nothing_from_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def marks(_: Any, tasks: list[Any]) -> list[np.ndarray]:
        return [
            np.full((300, 4), np.nan) if task.run == 0 else np.tile([0.0, 1.5, 0.0, -1.5], (300, 1)) for task in tasks
        ]

    monkeypatch.setattr(Simulated, "marks", marks)
    run = CandidateRun(30.0, 20.0, 45.0, 1.0, 2.0, 6.0)
    nowhere = Point(np.zeros((0, 7)))
    problem, _ = hypothetical(load_robot("barrel"), {}, (Noise(0.01, 0.0, 0.1),) * 4, [run, run], [0, 1], nowhere)
    assert problem.half_distance_mm == 1.5
