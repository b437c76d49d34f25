"""A search is repeated under the noise that its best set leaves: quieter, and on open ground louder as well."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import settled_noise as module
from evaluator.diagnosis.likelihood.noise.common_drift import CommonNoise

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
    monkeypatch.setattr(module, "common_noise", lambda *_: CommonNoise(0.0, 0.0, 0.0))  # type: ignore[arg-type]
    found = SimpleNamespace(noise=[(SimpleNamespace(sigma_mm=sigma_mm),)])
    monkeypatch.setattr(module, "with_noise_of", lambda *_: found)
    for ground, repeated in ((True, on_ground), (False, on_plate)):
        problem = SimpleNamespace(data=[1], noise=[(SimpleNamespace(sigma_mm=1.0),)], open_ground=ground)
        problem.common_drift, problem.friction_wander = 0.0, 0.0
        search: Any = SimpleNamespace(fits={BEST: fit}, problem=problem)
        assert (module.settled_noise(search, BEST) is not None) == repeated


def test_noise_stays_as_it_is_if_a_held_out_run_cannot_be_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any) -> None:
        raise FloatingPointError("run r15 cannot be simulated at this point")

    monkeypatch.setattr(module, "place_runs", fails)
    monkeypatch.setattr(module, "with_noise_of", lambda *_: pytest.fail("there are no residuals"))
    fit = SimpleNamespace(point=None, posterior=SimpleNamespace(scatter=None))
    search: Any = SimpleNamespace(fits={BEST: fit}, problem=SimpleNamespace(data=[1], open_ground=True))
    assert module.settled_noise(search, BEST) is None


def test_drift_is_estimated_from_features_of_which_the_ground_is_undone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The old drift and friction are part of the whitening of a run; on a run without them there is nothing to undo."""
    asked = []

    def drift(views: Any, *given: Any) -> CommonNoise:
        assert given[-2:] == (7.0, 3)
        asked.append(views)
        return CommonNoise(0.002, 0.3, -7.0)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "changed", lambda view, undone: f"{view} {undone}")
    monkeypatch.setattr(module, "friction_shifts", lambda *_: [(None, None)] * 2)
    monkeypatch.setattr(module, "late_shifts", lambda *_: [None] * 2)
    monkeypatch.setattr(module, "prior_precision", lambda *_: None)
    monkeypatch.setattr(module, "common_drift", drift)
    parts = [SimpleNamespace(ground=ground, used=slice(None)) for ground in (None, SimpleNamespace(undone="undone"))]
    for part in parts:
        part.of_tracking = lambda _: np.zeros(1)
    problem = Sought([SimpleNamespace(time_s=np.zeros(1))] * 2, parts, 0.001, 0.3, SimpleNamespace(each=map))
    fit: Any = SimpleNamespace(runs=(0, 1), linearized=("first", "second"), columns=(), point=None)
    search: Any = SimpleNamespace(problem=problem, tolerance={})
    found = module.with_common_drift(search, fit)
    assert asked == [["first", "second undone"]]
    assert (found.common_drift, found.friction_wander) == (0.002, 0.3)
    problem = replace(problem, common_drift=0.002)
    search.problem = problem
    assert module.with_common_drift(search, fit) is problem  # unchanged


@dataclass(frozen=True)
class Sought:
    """The part of a problem that an estimate of drift needs."""

    data: list[Any]
    compressions: list[Any]
    common_drift: float
    friction_wander: float
    watch: Any
    field_of_view: float = 7.0
    drifting_axes: int = 3
