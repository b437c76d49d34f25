"""Named effects, or physics without a name: what speaks for which."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from evaluator.discrepancy.rivals import Standing
from evaluator.discrepancy.search import Search
from evaluator.discrepancy.verdict import decide

NOTHING: frozenset[str] = frozenset()
PAIR, TRIPLE = frozenset({"mark-offset", "motor-droop"}), frozenset({"friction-level", "mark-offset", "motor-droop"})
FREE = frozenset({"free:force_left.v_abs_v"})


@pytest.mark.parametrize(
    ("named", "free_score", "verdict"), [(PAIR, 116.0, "unknown"), (PAIR, 100.0, "effect"), (TRIPLE, 116.0, "effect")]
)
def test_three_effects_that_were_refused_do_not_speak_for_two_of_them(
    named: frozenset[str], free_score: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Scores of a drag with the cube of the speed sideways: the pair alone is far behind one term without a name."""
    monkeypatch.setattr("evaluator.discrepancy.verdict._foretells", lambda *_: False)
    scores = {TRIPLE: 120.0, FREE: free_score, PAIR: 109.4, NOTHING: 0.0}
    order = sorted(scores, key=lambda ids: -scores[ids])
    table = Standing(tuple(order), np.array([scores[ids] for ids in order]))
    assert decide(cast("Search", None), table, named)[1] == verdict
