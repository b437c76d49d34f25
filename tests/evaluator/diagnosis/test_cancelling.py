"""Two effects of one fitted model that move the marks in opposite ways: a fit that imitates a third law with them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.assessment.relevance import cancelling, without_cancelling
from evaluator.diagnosis.inference.search import Search

WAY_MM = np.linspace(0, 20, 50)
# How the effects move the robot across its way, mm, at size 1: two of them in nearly the same way.
ACROSS_MM = {"bow": np.sin(np.pi * WAY_MM / 20), "arch": 1.2 * np.sin(np.pi * WAY_MM / 20), "wave": np.sin(WAY_MM)}


@dataclass(frozen=True)
class At:
    """A point of a fit."""

    terms: dict[str, float]

    def task(self, run: int) -> Any:
        return SimpleNamespace(terms=self.terms, run=run)


def marks(tasks: list[Any]) -> list[np.ndarray]:
    """Marks 3 mm apart; the last run cannot be simulated."""
    found = []
    for task in tasks:
        across = sum((size * ACROSS_MM[effect] for effect, size in task.terms.items()), np.zeros(50))
        column = [WAY_MM, across + 1.5, WAY_MM, across - 1.5]
        found.append(np.column_stack(column) * (np.nan if task.run == 2 else 1.0))
    return found


PROBLEM: Any = SimpleNamespace(forward=SimpleNamespace(marks=marks))


def fit(log_evidence: float = 0.0, **terms: float) -> Any:
    return SimpleNamespace(runs=(0, 1, 2), point=At(terms), posterior=SimpleNamespace(log_evidence=log_evidence))


@pytest.mark.parametrize(
    ("terms", "cancels"),
    [
        ({"bow": 1.0, "arch": -1.0}, True),  # 0.2 of 1 is left
        ({"bow": 1.0, "arch": -1.3}, False),  # 0.56 of 1
        ({"bow": 1.0, "arch": 1.0}, False),
        ({"bow": 1.0, "wave": -1.0}, False),
        ({"wave": 1.0, "bow": 1.0, "arch": -1.0}, True),
        ({"bow": 1.0}, False),
        ({}, False),
    ],
)
def test_effects_cancel_if_both_change_the_paths_by_less_than_half_of_what_either_does(
    terms: dict[str, float], *, cancels: bool
) -> None:
    found = cancelling(PROBLEM, fit(**terms))
    assert (found is not None) == cancels
    if found is not None:
        assert found.effects == ("arch", "bow")
        assert found.together_mm == pytest.approx(found.alone_mm[1] / 5, rel=1e-6)
        assert found.alone_mm[0] == pytest.approx(1.2 * found.alone_mm[1], rel=0.03)  # after the best rotation


def test_sets_with_effects_that_cancel_leave_the_search_while_one_of_them_is_the_best() -> None:
    """Motors 4 % slow in seconds 4 % long were named, each with a probability above 0.999, for play in the gears."""
    made = [fit(90.0, bow=1.0, arch=-1.0), fit(80.0, bow=1.0, arch=-1.0, wave=1.0), fit(50.0, wave=1.0), fit(1.0)]
    fits = {frozenset(item.point.terms): item for item in made}
    search = Search(PROBLEM, dict.fromkeys(ACROSS_MM), {}, (0, 1, 2), fits=dict(fits))  # type: ignore[arg-type]
    kept, why = without_cancelling(search)
    assert set(kept.fits) == {frozenset({"wave"}), frozenset()}
    assert why.startswith("arch and bow fit only by cancelling each other: they move the marks by 3")
    assert set(search.fits) == set(fits)
    few = replace(search, fits={frozenset({"wave"}): made[2], frozenset(): made[3]})
    assert without_cancelling(few) == (few, "")
