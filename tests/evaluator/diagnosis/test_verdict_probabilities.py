"""Doubts about what is left beside a model, and the probabilities of sets of effects."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from evaluator.diagnosis.assessment.adequacy import Adequacy
from evaluator.diagnosis.assessment.cross_validation import Constancy
from evaluator.diagnosis.assessment.model_comparison import score, standing
from evaluator.diagnosis.assessment.verdict import doubts, undecided
from evaluator.diagnosis.inference.search import Search, log_prior
from tests.evaluator.diagnosis.ranked_sets import NONE, ranked

A, AB, ABC = frozenset({"a"}), frozenset({"a", "b"}), frozenset({"a", "b", "c"})
B, FREE = frozenset({"b"}), frozenset({"free:x"})


def left(excess: float = 1.0, sigma: float = 9.0, order_p: float = 1.0) -> Adequacy:
    return Adequacy(
        excess, sigma, np.ones(3), np.zeros((3, 4)), np.ones((3, 4)), order_p, "friction of the runs depends on order"
    )


def test_left_overs_are_doubted_beyond_an_eighth_of_the_noise_and_five_sigmas() -> None:
    assert doubts(left(), []) == ""
    assert doubts(left(1.11, 9.0), []) == doubts(left(1.5, 4.9), []) == ""
    assert doubts(left(1.13, 5.1), []) == "residuals are 1.13 times the tracking noise (5 sigmas)"
    assert doubts(left(1.13, 5.1), [], material=False) == ""
    assert doubts(left(1.5, 40.0), [], material=False, named=True) == ""
    wrong = "residuals are 1.51 times the tracking noise (40 sigmas)"  # beside which no effect is a finding
    assert doubts(left(1.51, 40.0), [], material=False, named=True) == wrong
    assert doubts(left(1.51, 40.0), [], material=False) == ""
    assert "depends on order" in doubts(left(1.13, 5.1, order_p=9e-4), [], material=False)


def test_dependence_and_inconstancy_are_doubted_below_one_in_a_thousand() -> None:
    assert doubts(left(order_p=1.1e-3), [Constancy("forward and backward", 1.1e-3)]) == ""
    assert "depends on order, significantly (probability 0.0009)" in doubts(left(order_p=9e-4), [])
    assert doubts(replace(left(), widest="friction differs"), []) == "friction differs"
    said = doubts(left(), [Constancy("slow and fast", 0.5), Constancy("left and right", 9e-4)])
    assert said == "the effect differs in size between left and right (probability 0.0009)"


def searched(evidence: dict[frozenset[str], float]) -> Search:
    fits = {ids: SimpleNamespace(posterior=SimpleNamespace(log_evidence=value)) for ids, value in evidence.items()}
    terms = dict.fromkeys(["a", "b", "c", "d", "free:x"])
    return Search(cast("Any", None), cast("Any", terms), {}, (), cast("Any", fits))


def test_score_is_evidence_with_priors_of_size_of_choice_and_of_physics_without_a_name() -> None:
    search = searched({NONE: 1.0, A: 5.0, FREE: 7.0, FREE | A: 9.0})
    assert score(search, NONE, 95) == pytest.approx(1.0 + np.log(0.5))
    assert score(search, A, 95) == pytest.approx(5.0 + np.log(0.35) - np.log(4))
    assert score(search, FREE, 95) == pytest.approx(7.0 + np.log(0.5) + np.log(0.05) - np.log(95))
    assert score(search, FREE | A, 95) == pytest.approx(9.0 + np.log(0.35 / 4) + np.log(0.05 / 95))
    assert score(search, AB, 95) == -np.inf
    assert [log_prior(size, 26) for size in (2, 3)] == pytest.approx([np.log(0.12 / 325), np.log(0.03 / 2600)])
    assert log_prior(4, 26) == log_prior(3, 26)  # three named ones with a free-form term


def test_probabilities_are_shares_of_the_exponentials() -> None:
    table = standing(searched({NONE: 0.0, A: 3.0, AB: 4.0}), 95)
    scores = np.array([table.of(ids) for ids in table.sets])
    assert (np.diff(scores) <= 0).all()
    weight = np.exp(scores)
    np.testing.assert_allclose(table.probability, weight / weight.sum())
    assert table.containing("a", table.sets) == pytest.approx(1 - weight[table.sets.index(NONE)] / weight.sum())
    assert table.containing("b", [A, AB]) == pytest.approx(1 / (1 + np.exp(table.of(A) - table.of(AB))))
    assert table.share_of([A], [A, NONE]) == pytest.approx(1 / (1 + np.exp(table.of(NONE) - table.of(A))))


@pytest.mark.parametrize(
    ("odds", "said"),
    [
        (math.log(19.9), ""),
        (math.log(20.1), "odds of 20 to 1; an effect is named from 3000 to 1 on"),
        (7.99, "odds of 2951 to 1; an effect is named from 3000 to 1 on"),
        (8.01, "an effect is named from 3000 to 1 on, which not each of them has"),
    ],
)
def test_an_effect_of_twenty_to_one_is_not_excluded(odds: float, said: str) -> None:
    search, table = ranked({NONE: 0.0, A: odds, FREE: 50.0, B: 40.0}, at_bound=[B])
    expected = f"a would make these runs more probable, but is not proven ({said})"
    assert undecided(search, table) == ((A, expected) if said else (NONE, ""))
    assert undecided(*ranked({NONE: 0.0, A: odds}, on_ground=True)) == (NONE, "")
    assert undecided(*ranked({NONE: 0.0})) == (NONE, "")


def test_what_may_act_beside_a_named_effect_is_told_with_its_odds_over_that_alone() -> None:
    """Friction 1.66 times the stated one, beside a drift of the speed, at odds of 38 to 1: no word of it was said."""
    search, table = ranked({NONE: 0.0, A: 50.0, B: 60.0, AB: 50.0 + math.log(38.1)})
    told = "b besides would make these runs more probable, but is not proven (odds of 38 to 1; an effect is named from"
    rival, why = undecided(search, table, A)
    assert (rival, why.startswith(told)) == (B, True)
    assert undecided(search, table, B) == (NONE, "")
    assert undecided(search, table, AB) == (NONE, "")
