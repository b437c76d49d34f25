"""Named effects, or physics without a name: what speaks for which."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from evaluator.diagnosis.assessment.verdict import best_named, decide
from tests.evaluator.diagnosis.ranked_sets import FAMILIES, Set, predicting, ranked

NOTHING: Set = frozenset()
OFFSET, PAIR = frozenset({"mark-offset"}), frozenset({"mark-offset", "motor-droop"})
TRIPLE = PAIR | {"friction-level"}
FREE, BESIDE = frozenset({"free:force_left.v_abs_v"}), PAIR | {"free:speed.sign_u.front-left"}


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
        ({PAIR: 107.5, OFFSET: 95.0, NOTHING: 100.0}, "none", NOTHING),  # whatever the evidence of nothing is
        ({PAIR: -91.4, OFFSET: -105.0, NOTHING: -100.0}, "effect", PAIR),
        # twice as probable as the named one, and not quite; it must pay for itself to be the answer
        ({OFFSET: 9.0, FREE: 9.8, NOTHING: 0.0}, "unknown", FREE),
        ({OFFSET: 9.0, FREE: 9.6, NOTHING: 0.0}, "effect", OFFSET),
    ],
)
def test_what_speaks_for_named_effects_and_what_against_them(
    scores: Mapping[frozenset[str], float], verdict: str, chosen: frozenset[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    predicting(monkeypatch, lambda ids, _: ids == BESIDE)
    search, table = ranked(scores)
    assert decide(search, table, FAMILIES, best_named(search, table, FAMILIES))[:2] == (chosen, verdict)


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
    predicting(monkeypatch, lambda *_: False)
    scores = {PAIR: 60.0, OFFSET: 30.0, FREE: 61.0 if FREE in at_bound or not at_bound else 5.0, NOTHING: 0.0}
    search, table = ranked(scores, at_bound=at_bound)
    assert decide(search, table, FAMILIES, best_named(search, table, FAMILIES))[:2] == (chosen, verdict)


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
    predicting(monkeypatch, lambda *_: True)

    def values(*sigmas: float) -> dict[str, float]:
        """A start that is late by any time is no strain."""
        return dict(zip(("green_y_mm", "yellow_y_mm", "start_common_s"), (*sigmas, 9.0), strict=True))

    scores = {PAIR: 30.0, OFFSET: 2.0, NOTHING: 0.0}
    sigmas = {PAIR: values(*marks), OFFSET: values(0.0, 0.0), NOTHING: values(*null)}
    search, table = ranked(scores, on_ground=on_ground, sigmas=sigmas)
    assert best_named(search, table, FAMILIES) == (PAIR if verdict == "effect" else NOTHING)


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
    gain: float, without: float, with_it: float, named: frozenset[str]
) -> None:
    keys = ("body.mass_g", "wheels.track_mm", "wheels.radius_mm", "plane_scale")
    sigmas = {OFFSET: dict.fromkeys(keys, with_it), NOTHING: dict.fromkeys(keys, without)}
    search, table = ranked({OFFSET: gain, NOTHING: 0.0}, sigmas=sigmas)
    assert best_named(search, table, FAMILIES) == named
