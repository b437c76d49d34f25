"""Named effects, or physics without a name: what speaks for which."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from evaluator.diagnosis.assessment.model_comparison import Standing
from evaluator.diagnosis.assessment.verdict import best_named, decide
from evaluator.diagnosis.inference.search import Search

NOTHING: frozenset[str] = frozenset()
OFFSET, PAIR = frozenset({"mark-offset"}), frozenset({"mark-offset", "motor-droop"})
TRIPLE = PAIR | {"friction-level"}
FREE, BESIDE = frozenset({"free:force_left.v_abs_v"}), PAIR | {"free:speed.sign_u.front-left"}
PLATE = cast("Search", SimpleNamespace(problem=SimpleNamespace(open_ground=False)))


@pytest.mark.parametrize(
    ("scores", "verdict", "chosen"),
    [
        # of a drag with the cube of the speed sideways: a third effect helps the pair to imitate it, but not by enough
        ({TRIPLE: 120.0, FREE: 116.0, PAIR: 109.4, OFFSET: 58.0, NOTHING: 0.0}, "unknown", FREE),
        ({TRIPLE: 120.0, FREE: 100.0, PAIR: 109.4, OFFSET: 58.0, NOTHING: 0.0}, "effect", PAIR),
        ({TRIPLE: 125.0, FREE: 116.0, PAIR: 109.4, OFFSET: 58.0, NOTHING: 0.0}, "effect", TRIPLE),
        # a term without a name beside two true effects, which gains as much as one of a hundred does by chance
        ({PAIR: 103.7, BESIDE: 103.1, OFFSET: 95.0, NOTHING: 0.0}, "effect", PAIR),
        # beside a speed mismatch on an unevenly clean plate, it predicted a little better too
        ({BESIDE: 108.0, PAIR: 103.7, OFFSET: 95.0, NOTHING: 0.0}, "effect", PAIR),
        ({BESIDE: 111.8, PAIR: 103.7, OFFSET: 95.0, NOTHING: 0.0}, "unknown", BESIDE),
        ({FREE: 3.0, NOTHING: 0.0}, "none", NOTHING),
        # under heavy-tailed noise, by chance: together with named ones less probable than nothing
        ({BESIDE: -3.4, PAIR: -3.6, OFFSET: -4.0, NOTHING: 0.0}, "none", NOTHING),
        # two that undo each other: dear to part, and together no better than nothing missing
        ({PAIR: 7.5, OFFSET: 0.5, NOTHING: 0.0}, "none", NOTHING),
        ({PAIR: 7.5, OFFSET: -5.0, NOTHING: 0.0}, "none", NOTHING),
        ({PAIR: 8.6, OFFSET: 0.5, NOTHING: 0.0}, "effect", PAIR),
        # about as probable as the named one; it must pay for itself to be the answer
        ({OFFSET: 9.0, FREE: 8.6, NOTHING: 0.0}, "unknown", FREE),
        ({OFFSET: 9.0, FREE: 7.7, NOTHING: 0.0}, "effect", OFFSET),
    ],
)
def test_what_speaks_for_named_effects_and_what_against_them(
    scores: Mapping[frozenset[str], float], verdict: str, chosen: frozenset[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "evaluator.diagnosis.assessment.verdict"
    monkeypatch.setattr(f"{module}.score", lambda _, ids, __: scores.get(ids, -np.inf))
    monkeypatch.setattr(f"{module}._strains", lambda *_: False)
    monkeypatch.setattr(f"{module}._at_bounds", lambda *_: False)
    monkeypatch.setattr(f"{module}._relieves", lambda *_: False)
    monkeypatch.setattr(f"{module}._predicts", lambda _, ids, __: ids == BESIDE)
    order = sorted(scores, key=lambda ids: -scores[ids])
    search, table = PLATE, Standing(tuple(order), np.array([scores[ids] for ids in order]))
    assert decide(search, table, 95, best_named(search, table, 95))[:2] == (chosen, verdict)


@pytest.mark.parametrize(
    ("at_bound", "verdict", "chosen"),
    [
        ({PAIR}, "effect", OFFSET),  # whatever its second effect gains, it is not what it is called
        ({PAIR, OFFSET}, "none", NOTHING),
        ({PAIR, OFFSET, FREE}, "none", NOTHING),
        ({FREE}, "effect", PAIR),
        (set(), "unknown", FREE),
    ],
)
def test_what_ends_at_a_bound_is_no_answer_however_probable(
    at_bound: set[frozenset[str]], verdict: str, chosen: frozenset[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "evaluator.diagnosis.assessment.verdict"
    scores = {PAIR: 60.0, OFFSET: 30.0, FREE: 61.0 if FREE in at_bound or not at_bound else 5.0, NOTHING: 0.0}
    monkeypatch.setattr(f"{module}.score", lambda _, ids, __: scores.get(ids, -np.inf))
    monkeypatch.setattr(f"{module}._relieves", lambda *_: False)
    monkeypatch.setattr(f"{module}._strains", lambda *_: False)
    monkeypatch.setattr(f"{module}._predicts", lambda *_: False)
    fits = {ids: SimpleNamespace(at_bounds=ids if ids in at_bound else NOTHING, unbelieved=NOTHING) for ids in scores}
    order = sorted(scores, key=lambda ids: -scores[ids])
    search = cast("Search", SimpleNamespace(fits=fits, problem=PLATE.problem))
    table = Standing(tuple(order), np.array([scores[ids] for ids in order]))
    assert decide(search, table, 95, best_named(search, table, 95))[:2] == (chosen, verdict)


@pytest.mark.parametrize(
    ("marks", "null", "on_ground", "verdict"),
    [
        ((3.1, -3.2), (0.0, 0.0), False, "none"),  # a pair that cancels, and both marks moved to make good for it
        ((3.1, -2.9), (0.0, 0.0), False, "effect"),  # one value in fifteen laboratories
        ((3.1, -3.2), (3.3, 0.0), False, "effect"),  # one of them is as far without
        ((5.9, -5.9), (6.0, 6.0), True, "effect"),
        ((6.0, -6.0), (6.0, 6.0), True, "none"),  # on ground the model without effects goes anywhere
        ((6.0, -6.0), (6.0, 6.0), False, "effect"),
    ],
)
def test_a_set_that_moves_two_values_beyond_what_is_known_is_no_answer(
    marks: tuple[float, float],
    null: tuple[float, float],
    on_ground: bool,
    verdict: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = "evaluator.diagnosis.assessment.verdict"
    scores = {PAIR: 30.0, OFFSET: 2.0, NOTHING: 0.0}
    monkeypatch.setattr(f"{module}.score", lambda _, ids, __: scores.get(ids, -np.inf))
    monkeypatch.setattr(f"{module}._relieves", lambda *_: False)
    monkeypatch.setattr(f"{module}._predicts", lambda *_: True)
    keys = ("green_y_mm", "yellow_y_mm", "start_common_s")

    def fit(*sigmas: float) -> SimpleNamespace:
        values = dict(zip(keys, (*sigmas, 9.0), strict=True))  # a start that is late by any time is no strain
        columns = [SimpleNamespace(key=key, term=None) for key in keys]
        point = SimpleNamespace(value=lambda column: 0.02 * values[column.key])
        return SimpleNamespace(columns=columns, point=point, at_bounds=NOTHING, unbelieved=NOTHING)

    fits = {PAIR: fit(*marks), OFFSET: fit(0.0, 0.0), NOTHING: fit(*null)}
    search = SimpleNamespace(
        fits=fits,
        null=fits[NOTHING],
        tolerance=dict.fromkeys(keys, 0.02),
        problem=SimpleNamespace(open_ground=on_ground),
    )
    table = Standing(tuple(scores), np.array(list(scores.values())))
    named = best_named(cast("Search", search), table, 95)
    assert named == (PAIR if verdict == "effect" else NOTHING)


@pytest.mark.parametrize(
    ("gain", "without", "with_it", "named"),
    [
        (7.0, 3.0, 0.5, OFFSET),  # four values three tolerances off each, or one effect: something is missing anyway
        (7.0, 1.0, 0.5, NOTHING),  # values off by what is usual: the effect has to pay in full
        (7.0, 3.0, 3.0, NOTHING),  # an effect beside which they are as far off explains nothing of it
        (5.9, 3.0, 0.5, NOTHING),
    ],
)
def test_one_effect_is_preferred_to_several_values_off_together(
    gain: float, without: float, with_it: float, named: frozenset[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "evaluator.diagnosis.assessment.verdict"
    scores = {OFFSET: gain, NOTHING: 0.0}
    monkeypatch.setattr(f"{module}.score", lambda _, ids, __: scores.get(ids, -np.inf))
    keys = ("body.mass_g", "wheels.track_mm", "wheels.radius_mm", "plane_scale")

    def fit(sigmas: float) -> SimpleNamespace:
        columns = [SimpleNamespace(key=key, term=None) for key in keys]
        posterior = SimpleNamespace(covariance=1e-4 * 0.02**2 * np.eye(len(keys)))
        point = SimpleNamespace(value=lambda _: 0.02 * sigmas)
        return SimpleNamespace(columns=columns, point=point, posterior=posterior, at_bounds=NOTHING, unbelieved=NOTHING)

    fits = {OFFSET: fit(with_it), NOTHING: fit(without)}
    plate = SimpleNamespace(open_ground=False)
    search = SimpleNamespace(fits=fits, null=fits[NOTHING], tolerance=dict.fromkeys(keys, 0.02), problem=plate)
    table = Standing(tuple(scores), np.array(list(scores.values())))
    assert best_named(cast("Search", search), table, 95) == named
