"""Named effects, or physics without a name: what speaks for which."""

from __future__ import annotations

from collections.abc import Mapping
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


@pytest.mark.parametrize(
    ("scores", "verdict", "chosen"),
    [
        # of a drag with the cube of the speed sideways: a third effect helps the pair to imitate it, but not by enough
        ({TRIPLE: 120.0, FREE: 116.0, PAIR: 109.4, OFFSET: 58.0, NOTHING: 0.0}, "unknown", FREE),
        ({TRIPLE: 120.0, FREE: 100.0, PAIR: 109.4, OFFSET: 58.0, NOTHING: 0.0}, "effect", PAIR),
        ({TRIPLE: 125.0, FREE: 116.0, PAIR: 109.4, OFFSET: 58.0, NOTHING: 0.0}, "effect", TRIPLE),
        # a term without a name beside two true effects, which gains as much as one of a hundred does by chance
        ({PAIR: 103.7, BESIDE: 103.1, OFFSET: 95.0, NOTHING: 0.0}, "effect", PAIR),
        ({BESIDE: 108.0, PAIR: 103.7, OFFSET: 95.0, NOTHING: 0.0}, "unknown", BESIDE),
        ({FREE: 3.0, NOTHING: 0.0}, "none", NOTHING),
        # two that undo each other: dear to part, and together no better than nothing missing
        ({PAIR: 7.5, OFFSET: 0.5, NOTHING: 0.0}, "none", NOTHING),
        ({PAIR: 8.5, OFFSET: 0.5, NOTHING: 0.0}, "effect", PAIR),
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
    monkeypatch.setattr(f"{module}._predicts", lambda _, ids, __: ids == BESIDE)
    order = sorted(scores, key=lambda ids: -scores[ids])
    search, table = cast("Search", None), Standing(tuple(order), np.array([scores[ids] for ids in order]))
    assert decide(search, table, 95, best_named(search, table, 95))[:2] == (chosen, verdict)
