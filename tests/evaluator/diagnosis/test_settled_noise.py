"""A search is repeated under the noise that its best set leaves: quieter, and on open ground louder as well."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis.inference import settled_noise as module

BEST = frozenset({"lag"})


@pytest.mark.parametrize(
    ("sigma_mm", "on_ground", "on_plate"),
    [(0.85, True, True), (0.95, False, False), (1.05, False, False), (1.2, True, False)],
)
def test_a_search_is_repeated_under_quieter_noise_and_on_ground_under_louder(
    sigma_mm: float, on_ground: bool, on_plate: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = SimpleNamespace(point=None, posterior=SimpleNamespace(scatter=None))
    monkeypatch.setattr(module, "place_runs", lambda *_: None)
    monkeypatch.setattr(module, "with_common_drift", lambda search, _: search.problem)
    found = SimpleNamespace(noise=[(SimpleNamespace(sigma_mm=sigma_mm),)])
    monkeypatch.setattr(module, "with_noise_of", lambda *_: found)
    for ground, repeated in ((True, on_ground), (False, on_plate)):
        problem = SimpleNamespace(data=[1], noise=[(SimpleNamespace(sigma_mm=1.0),)], open_ground=ground)
        search: Any = SimpleNamespace(fits={BEST: fit}, problem=problem)
        assert (module.settled_noise(search, BEST) is not None) == repeated
