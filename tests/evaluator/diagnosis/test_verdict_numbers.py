"""Every number that decides a verdict, from either side."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.assessment import verdict
from evaluator.diagnosis.assessment.verdict import best_named, carries_over, decide, pays
from evaluator.diagnosis.candidates.free_form import grows_with_time
from evaluator.diagnosis.likelihood.known_to import CLOCK, RADIUS_DIFFERENCE, START
from tests.evaluator.diagnosis.ranked_sets import NONE, predicting, ranked, with_sigma

A, AB, ABC = frozenset({"a"}), frozenset({"a", "b"}), frozenset({"a", "b", "c"})
B, FREE = frozenset({"b"}), frozenset({"free:x"})


@pytest.mark.parametrize(
    ("ids", "below", "odds"),
    [(A, {NONE: 0.0}, 8.0), (AB, {A: 20.0, NONE: 0.0}, 8.0), (ABC, {AB: 40.0, A: 20.0, NONE: 0.0}, 12.0)],
    ids=["one", "two", "three"],
)
@pytest.mark.parametrize(("more", "enough"), [(0.05, True), (-0.05, False)])
def test_an_effect_stays_at_odds_that_grow_from_two_to_three(
    ids: frozenset[str], below: dict[frozenset[str], float], odds: float, more: float, enough: bool
) -> None:
    search, table = ranked({ids: max(below.values()) + odds + more, **below})
    assert pays(search, table, 95, ids) == enough
    assert (best_named(search, table, 95) == ids) == enough


@pytest.mark.parametrize(("more", "enough"), [(0.05, True), (-0.05, False)])
def test_a_single_effect_that_relieves_known_values_earns_less(more: float, enough: bool) -> None:
    """Without it four values are off by 2.9 tolerances each, together beyond chance."""
    off = dict.fromkeys(("body.mass_g", "wheels.track_mm", "wheels.radius_mm", "plane_scale"), 2.9)
    search, table = ranked({A: 6.0 + more, NONE: 0.0}, sigmas={NONE: off, A: dict.fromkeys(off, 0.0)})
    assert pays(search, table, 95, A) == enough
    search, table = ranked({FREE: 7.9, NONE: 0.0}, sigmas={NONE: off, FREE: dict.fromkeys(off, 0.0)})
    assert not pays(search, table, 95, FREE)  # a term without a name relieves nothing: it names no cause


@pytest.mark.parametrize(("more", "enough"), [(0.05, True), (-0.05, False)])
def test_a_term_without_a_name_earns_as_much_as_a_first_effect_even_beside_two(more: float, enough: bool) -> None:
    search, table = ranked({FREE: 8.0 + more, NONE: 0.0})
    assert pays(search, table, 95, FREE) == enough
    beside = FREE | {"a"}
    search, table = ranked({beside: 28.0 + more, A: 20.0, FREE: 10.0, NONE: 0.0})
    assert pays(search, table, 95, beside) == enough


@pytest.mark.parametrize(
    ("rival", "answer", "remark"),
    [
        (9.27, "effect", "no free-form term explains more"),
        (9.34, "effect", "a free-form term explains the runs as well"),
        (10.66, "effect", "a free-form term explains the runs as well"),
        (10.72, "unknown", "at least as well"),
    ],
)
def test_a_free_term_that_pays_and_is_twice_as_probable_casts_doubt_and_half_as_probable_is_mentioned(
    rival: float, answer: str, remark: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Odds of two are 0.693."""
    search, table = ranked({A: 10.0, FREE: rival, NONE: 0.0})
    predicting(monkeypatch, lambda *_: False)
    _, said, reason = decide(search, table, 95, A)
    assert (said, remark in reason) == (answer, True)


def test_a_free_term_beside_which_no_effect_was_found_is_not_compared_with_one(monkeypatch: pytest.MonkeyPatch) -> None:
    search, table = ranked({FREE: 20.0, NONE: 0.0})
    predicting(monkeypatch, lambda *_: True)
    found = decide(search, table, 95, NONE)
    assert found == (FREE, "unknown", "a free-form term explains the runs, and no effect of the catalogue does as well")


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("carries_over", [True, False])
@pytest.mark.parametrize(("least_material", "asked"), [(-np.inf, False), (5.0, True)])
def test_a_form_that_grows_with_time_beside_others_must_predict_commands_left_out_and_be_significant_on_open_ground(
    least_material: float, asked: bool, carries_over: bool, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    grows = frozenset({"free:friction.time"})
    scores = {grows | A: 40.0, A: 20.0, grows: 9.0, NONE: 0.0}
    search, table = ranked(scores, on_ground=asked)
    predicting(monkeypatch, lambda ids, other: carries_over if ids - other == grows else asked)
    with_sigma(monkeypatch, 0.1 if told else 1.0)
    monkeypatch.setattr(verdict, "mean_gain", lambda *_: -0.1)
    found = decide(search, table, 95, A, least_material)
    assert found[:2] == ((grows | A, "unknown") if carries_over and (told or not asked) else (A, "effect"))


@pytest.mark.parametrize(
    ("more", "gain", "predicts", "answer"),
    [
        (8.1, 0.1, False, "unknown"),
        (7.9, 0.1, False, "effect"),
        (8.1, -0.1, False, "effect"),
        (0.1, -0.1, True, "unknown"),
    ],
)
def test_on_open_ground_a_form_that_predicts_no_better_casts_doubt_where_it_is_more_probable_and_no_worse(
    more: float, gain: float, predicts: bool, answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rival = FREE | B
    search, table = ranked({rival: 20.0 + more, A: 20.0, B: 1.0, FREE: 1.0, NONE: 0.0}, on_ground=True)
    predicting(monkeypatch, lambda ids, other: predicts or (ids, other) != (rival, A))
    monkeypatch.setattr(verdict, "mean_gain", lambda *_: gain)
    with_sigma(monkeypatch, 0.1)
    assert decide(search, table, 95, A, 5.0)[1] == answer


@pytest.mark.parametrize(("largest", "told"), [(2.2, False), (2.3, True)])
def test_the_size_of_a_form_is_told_where_one_of_its_coefficients_is_not_nought(
    largest: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two coefficients the larger must be 2.24 of its standard deviations: 95 % for both together."""
    columns = [
        SimpleNamespace(key=key, size=size) for key, size in (("a", 0.0), ("free:x", 0.1), ("free:x", -3 * largest))
    ]
    fit = SimpleNamespace(columns=columns, point=SimpleNamespace(value=lambda column: column.size))
    monkeypatch.setattr(verdict, "covariance_over_commands", lambda *_: np.diag([1.0, 1.0, 9.0]))
    search: Any = SimpleNamespace(fits={FREE | A: fit}, problem=SimpleNamespace(data=()), tolerance={})
    assert verdict._is_significant(search, FREE | A) == told


@pytest.mark.parametrize(
    ("gain", "error", "better"), [(4.1, 2.0, True), (3.9, 0.1, False), (6.0, 3.1, False), (6.0, 2.9, True)]
)
def test_a_set_predicts_by_four_and_by_two_standard_errors(
    gain: float, error: float, better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verdict, "advantage", lambda *_: (gain, error))
    search, table = ranked({AB: 30.0, A: 20.0, FREE | A: 28.2, NONE: 0.0})
    assert decide(search, table, 95, AB)[1] == ("unknown" if better else "effect")


@pytest.mark.parametrize(
    ("below", "size", "named"),
    [(2.95, 3, B), (3.05, 3, A), (1.05, 2, A)],
    ids=["fewer parameters at nineteen to one", "beyond", "as many"],
)
def test_of_sets_that_tie_the_one_with_fewer_parameters_is_named(
    below: float, size: int, named: frozenset[str]
) -> None:
    """A spring with a far anchor, a, and a plate that is not level, b."""
    scores = {A: 30.0, B: 30.0 - below, NONE: 0.0}
    assert best_named(*ranked(scores, sizes={"a": size, "b": 2}), 95) == named
    assert best_named(*ranked(scores | {B: 29.9}, sizes={"a": 3}, at_bound=[B]), 95) == A


def test_on_open_ground_an_effect_that_does_not_carry_over_is_none_whatever_its_odds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of late motors and a drift, the drift helps some commands and harms others: the motors alone are the answer."""
    search, table = ranked({AB: 500.0, A: 400.0, NONE: 0.0}, on_ground=True)
    predicting(monkeypatch, lambda ids, other: ids - other != {"b"})
    assert best_named(search, table, 95) == A
    predicting(monkeypatch, lambda *_: False)
    assert best_named(search, table, 95) == NONE
    monkeypatch.setattr(verdict, "mean_gain", lambda one, other, *_: {AB: 0.45, A: 9.0}[one.terms] * (not other.terms))
    found = decide(search, table, 95, NONE, 9.0)
    assert found[:2] == (NONE, "insufficient")
    assert "a model with a and b fits better" in found[2]


@pytest.mark.parametrize(
    ("odds", "gain", "said"),
    [(24.1, 0.447, "insufficient"), (24.1, 0.446, "none"), (23.9, 0.447, "none")],
)
def test_on_open_ground_what_is_within_its_variation_leaves_no_verdict_open(
    odds: float, gain: float, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Forces that depend on the place gained 17 on uneven ground without an effect, and predicted 3 % better."""
    search, table = ranked({A: odds, NONE: 0.0}, on_ground=True)
    predicting(monkeypatch, lambda *_: False)
    monkeypatch.setattr(verdict, "mean_gain", lambda *_: gain)  # -2 log(1 - 0.2) = 0.4463
    assert decide(search, table, 95, NONE, 24.0)[:2] == (NONE, said)


@pytest.mark.parametrize(("more", "told"), [(8.1, True), (7.9, False)])
def test_on_open_ground_effects_beside_which_a_form_fits_better_without_predicting_better_say_so(
    more: float, *, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    search, table = ranked({FREE | A: 100.0 + more, A: 100.0, FREE: 1.0, NONE: 0.0}, on_ground=True)
    predicting(monkeypatch, lambda ids, other: ids - other != FREE)
    monkeypatch.setattr(verdict, "mean_gain", lambda *_: -0.1)
    with_sigma(monkeypatch, 0.1)
    found = decide(search, table, 95, A, 5.0)
    assert found[:2] == (A, "effect")
    assert ("a model with a and 1 free-form term fits better" in found[2]) == told
    assert ("no free-form term explains more" in found[2]) == (not told)


@pytest.mark.parametrize(("more", "said"), [(51.0, "insufficient"), (49.0, "effect")])
def test_on_open_ground_an_effect_that_a_far_better_model_does_without_is_no_finding(
    more: float, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compliant axles of a rigid robot were told as missing with a probability below 0.001."""
    search, table = ranked({FREE | B: 100.0 + more, A: 100.0, FREE: 1.0, B: 1.0, NONE: 0.0}, on_ground=True)
    predicting(monkeypatch, lambda ids, _: ids == A)
    monkeypatch.setattr(verdict, "mean_gain", lambda *_: -0.1)
    with_sigma(monkeypatch, 0.1)
    found = decide(search, table, 95, A, 5.0)
    assert found[:2] == ((A if said == "effect" else NONE), said)
    better = "a model with b and 1 free-form term fits better, but predicts held-out commands no better than chance"
    if said == "insufficient":
        named = "a predicts held-out commands better; yet"
        assert found[2] == f"{named} {better}: runs of more commands are needed"


@pytest.mark.parametrize(
    ("by", "sigmas", "said"),
    [(FREE | B, 3.1, "effect"), (FREE | B, 2.9, "insufficient"), (NONE, 3.1, "insufficient")],
)
def test_a_model_that_moves_a_known_value_in_place_of_an_effect_does_not_displace_it(
    by: Any, sigmas: float, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the model without effects moves is no help: a clock 0.3 % off for friction that faded, odds of e⁴⁵⁰."""
    mismatch, other = frozenset({"drive-speed-mismatch"}), FREE | B
    scores = {other: 200.0, mismatch: 100.0, FREE: 1.0, B: 1.0, NONE: 0.0}
    search, table = ranked(scores, on_ground=True, sigmas={by: {RADIUS_DIFFERENCE: sigmas}})
    predicting(monkeypatch, lambda ids, _: ids == mismatch)
    monkeypatch.setattr(verdict, "mean_gain", lambda *_: -0.1)
    with_sigma(monkeypatch, 0.1)
    assert decide(search, table, 95, mismatch, 5.0)[1] == said


@pytest.mark.parametrize(
    ("effect", "key", "without", "with_it", "carries"),
    [
        ("friction-across", "slip.lateral_friction", -3.1, 0.0, True),
        ("command-lag", START, 3.1, 0.0, True),
        ("command-lag", START, 2.9, 0.0, False),
        ("command-lag", START, 3.1, 3.2, False),  # as far off beside the effect
        ("command-lag", CLOCK, 3.1, 0.0, False),  # another cause's value
        ("time-base", CLOCK, -3.1, 0.0, True),
    ],
)
def test_an_effect_that_relieves_the_value_like_it_need_not_predict_commands_left_out(
    effect: str, key: str, without: float, with_it: float, carries: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    predicting(monkeypatch, lambda *_: False)
    ids = frozenset({effect})
    search, _ = ranked({ids: 9.0, NONE: 0.0}, sigmas={NONE: {key: without}, ids: {key: with_it}})
    assert carries_over(search, ids) == carries


@pytest.mark.parametrize(("free", "answer"), [(8.1, "unknown"), (7.9, "none")])
def test_a_free_term_that_predicts_must_also_gain_what_an_effect_needs(
    free: float, answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    search, table = ranked({FREE: free, NONE: 0.0})
    predicting(monkeypatch, lambda *_: True)
    found = decide(search, table, 95, NONE)
    assert found[1] == answer
    assert found[0] == (FREE if answer == "unknown" else NONE)


@pytest.mark.parametrize(
    ("free", "predicts", "answer"), [(28.2, True, "unknown"), (27.9, True, "effect"), (28.2, False, "effect")]
)
def test_a_free_term_in_place_of_an_effect_is_less_probable_and_counts_if_it_predicts_better(
    free: float, predicts: bool, answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By 30 to 28.2 it has 14 % of the probability, which is no doubt by itself."""
    search, table = ranked({AB: 30.0, A: 20.0, FREE | A: free, NONE: 0.0})
    predicting(monkeypatch, lambda *_: predicts)
    assert decide(search, table, 95, AB)[1] == answer


@pytest.mark.parametrize(("alone", "answer"), [(20.1, "unknown"), (20.3, "effect")])
def test_a_free_term_that_predicts_better_beside_an_effect_counts_only_if_it_needs_the_effect(
    alone: float, answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A jet of air at one place was told as friction that grows with time beside a ripple which paid for nothing."""
    search, table = ranked({AB: 30.0, A: 19.9, FREE | A: 28.2, FREE: alone, NONE: 0.0})
    predicting(monkeypatch, lambda ids, _: ids == FREE | A)
    assert decide(search, table, 95, AB)[1] == answer


@pytest.mark.parametrize(
    ("scores", "named", "as_well", "answer"),
    [
        ({FREE: 6.0, A: 5.0, NONE: 0.0}, NONE, A, "none"),  # an effect that does not pay predicts as well
        (
            {AB: 17.0, A: 10.0, FREE: 2.0, NONE: 0.0},
            A,
            A,
            "effect",
        ),  # the answer does, its likeliest extension does not
        ({AB: 30.0, A: 20.0, FREE | A: 28.2, NONE: 0.0}, AB, AB, "effect"),
        ({AB: 30.0, A: 20.0, FREE | A: 28.2, NONE: 0.0}, AB, B, "unknown"),
    ],
)
def test_a_free_term_must_predict_better_than_the_answer_and_than_the_likeliest_named_effects(
    scores: dict[frozenset[str], float],
    named: frozenset[str],
    as_well: frozenset[str],
    answer: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search, table = ranked(scores)
    predicting(monkeypatch, lambda _, other: other != as_well)
    assert best_named(search, table, 95) == named
    assert decide(search, table, 95, named)[1] == answer


@pytest.mark.parametrize(("other", "answer"), [(7.9, "effect"), (6.0, "unknown")])
def test_the_doubt_is_shared_with_single_effects_that_do_not_pay(
    other: float, answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 10, 10.76 and 7.9 the free term has 65.6 % of the probability, of 10, 10.76 and 6 it has 67.7 %."""
    search, table = ranked({A: 10.0, FREE: 10.76, B: other, NONE: 0.0})
    predicting(monkeypatch, lambda *_: False)
    assert decide(search, table, 95, A)[1] == answer


@pytest.mark.parametrize("carries_over", [True, False])
@pytest.mark.parametrize(
    ("form", "grows"),
    [
        ("free:friction.time", True),
        ("free:moment.one+speed.time.driving", True),
        ("free:force_plate_x.x", False),
        ("free:friction.abs_u.driving", False),
    ],
)
def test_a_form_that_grows_with_time_beside_nothing_is_unknown_physics_only_if_it_predicts_commands_left_out(
    form: str, grows: bool, carries_over: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Friction that changes with time is followed by terms that grow with time, but in no other run."""
    free = frozenset({form})
    search, table = ranked({free: 40.0, NONE: 0.0})
    predicting(monkeypatch, lambda *_: carries_over)
    unknown = carries_over or not grows
    assert decide(search, table, 95, NONE)[:2] == ((free, "unknown") if unknown else (NONE, "none"))
    assert grows_with_time(form) == grows
    assert not grows_with_time("time-base")


@pytest.mark.parametrize(("least_material", "answer"), [(19.9, "unknown"), (20.1, "effect")])
def test_on_open_ground_a_free_term_that_takes_little_of_the_residuals_is_no_answer(
    least_material: float, answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    search, table = ranked({FREE | A: 40.0, A: 20.0, NONE: 0.0}, on_ground=True)
    predicting(monkeypatch, lambda *_: True)
    with_sigma(monkeypatch, 0.1)
    assert decide(search, table, 95, A, least_material)[1] == answer
