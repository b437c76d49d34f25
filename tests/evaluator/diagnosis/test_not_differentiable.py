"""A run at a fold of the model is taken as it is; the others say where the parameters lie."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from evaluator.diagnosis.inference import fit as fitting
from evaluator.diagnosis.inference.fit_cache import End, FitCache
from evaluator.diagnosis.inference.not_differentiable import most_slopeless, without_slopes
from evaluator.diagnosis.likelihood.mixed_model import Linearized


def view(response: float, slope: float) -> Linearized:
    """A run of four features, the first of which a parameter moves."""
    features = np.zeros((4, 1))
    features[0] = slope
    return Linearized(np.array([response, 0.0, 0.0, 0.0]), features, np.eye(4)[:, 1:], np.zeros((4, 4)))


def test_a_run_that_is_not_differentiable_keeps_its_misfit_and_has_no_slopes() -> None:
    views = [view(3.0, 1.0), view(5.0, 100.0)]
    first, second = without_slopes(views, np.array([0.02]), (1,))
    assert first is views[0]
    assert second.response[0] == pytest.approx(3.0)  # 5 less 100 · 0.02: what is left at 0.02, wherever the fit goes
    assert not second.common.any()


def test_one_run_in_eight_may_be_without_slopes_on_ground_and_none_on_a_plate() -> None:
    assert [most_slopeless(runs, 100.0) for runs in (4, 8, 16, 26)] == [1, 1, 2, 3]
    assert most_slopeless(26, 1.0) == 0


def test_a_step_is_judged_without_slopeless_runs_and_the_worst_run_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs of three come nearer by any step; the other jumps to another motion, however short the step."""
    fit = cast("Any", SimpleNamespace(point="here", columns=(), runs=(0, 1, 2), slopeless=(), linearized=()))
    problem = cast("Any", SimpleNamespace(watch=SimpleNamespace(look=lambda: None)))
    after = np.array([4.0, 200.0, 4.0])
    monkeypatch.setattr(fitting, "_at", lambda *_: "there")
    monkeypatch.setattr(fitting, "settled_by_run", lambda *_: ("moved", after))
    known = (np.zeros(1), np.ones(1), np.zeros(1), np.ones(4), np.array([5.0, 6.0, 5.0, 0.0]))
    assert fitting._line_search(problem, fit, *known) == (None, 1)
    fit.slopeless = (1,)
    assert fitting._line_search(problem, fit, *known) == ("moved", 0)


def test_a_cached_fit_remembers_which_runs_are_slopeless(tmp_path: Any) -> None:
    path = tmp_path / "fits"
    FitCache(path, "key")["question"] = End(np.zeros((2, 7)), {}, {"a": (1.0,)}, True, 4, 2.5, (1,))
    assert (FitCache(path, "key")["question"] or End(np.zeros(0), {}, {}, False)).slopeless == (1,)
