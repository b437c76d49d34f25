"""How far effects are apart by the runs at hand, and what held-out runs say of a fit, in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.assessment import model_comparison
from evaluator.diagnosis.assessment.model_comparison import _left_over, _odds_sigmas, confirmation, separations
from tests.evaluator.diagnosis.synthetic import column

A, NONE = frozenset({"a"}), frozenset[str]()


def test_odds_in_sigmas_are_the_root_of_twice_the_loss() -> None:
    fit: Any = SimpleNamespace(posterior=SimpleNamespace(log_evidence=10.0))
    assert _odds_sigmas(fit, 2.0) == pytest.approx(4.0)
    assert _odds_sigmas(fit, 11.0) == 0.0


def test_separation_is_the_part_of_an_effect_that_the_others_cannot_make() -> None:
    model: Any = SimpleNamespace(inner=lambda at: np.array([[[4.0, 3.0], [3.0, 9.0]]])[at], prior=np.array([0.0, 7.0]))
    assert _left_over(model, 0, [0], np.array([2.0]), []) == pytest.approx(4.0)  # two sigmas a unit, two units
    assert _left_over(model, 0, [0], np.array([2.0]), [1]) == pytest.approx(np.sqrt(16 - 36 / 16))


def separable(
    monkeypatch: pytest.MonkeyPatch,
    others: dict[frozenset[str], float],
    most: int | None = None,
    explained: float = -np.inf,
    *,
    converged: bool = True,
) -> dict[str, dict[str, float]]:
    """Effect a of 2 units of 3 sigmas, beside b, seen from two places, and c; others: evidence of other fitted sets."""
    along = {"a": [3.0, 0.0, 0.0], "b": [1.0, 1.0, 0.0], "b'": [2.0, 0.0, 1.0], "c": [0.0, 1.0, 1.0]}
    columns = np.array(list(along.values()))
    offers = ("b", (1,)), ("b", (2,)), ("c", (3,))
    view = SimpleNamespace(
        model=SimpleNamespace(
            inner=lambda at: np.array([np.zeros((4, 4)), columns @ columns.T])[at],
            prior=np.zeros(4),
            tau=np.array([[0.3, 0.1, 0.1, 1.0], TAU_FITTED]),
        ),
        columns=[column("a"), column("b"), column("b"), column("c")],
        base=(0,),
        evidence=lambda offer: 45.0 - offer[1][0],
        start_of=lambda offer: offer,
    )

    def screen(_search: Any, _point: Any, _inside: Any, candidates: Any) -> Any:
        asked = {term.id for term in candidates}
        return SimpleNamespace(**vars(view), offers=[offer for offer in offers if offer[0] in asked])

    monkeypatch.setattr(model_comparison, "screen", screen)
    values = {"a": 2.0}
    fit = SimpleNamespace(
        point=SimpleNamespace(value=lambda item: values[item.key]),
        posterior=SimpleNamespace(scatter=np.array(TAU_FITTED), log_evidence=50.0),
    )
    rest = {
        ids: SimpleNamespace(posterior=SimpleNamespace(log_evidence=value), terms=ids, point=None, converged=converged)
        for ids, value in others.items()
    }
    terms = {name: SimpleNamespace(id=name, stepwise=False) for name in "abc"} | {
        "free:x": SimpleNamespace(id="free:x")
    }
    ended: dict[frozenset[str], float] = {}
    search: Any = SimpleNamespace(fits={A: fit, **rest}, terms=terms, explained=explained, failed=ended)
    search.evidence, search.reached = lambda ids: ended.get(ids, -np.inf), search.fits.get
    return separations(search, A, most)


TAU_FITTED = [0.05, 0.02, 0.02, 1.0]


def test_separation_of_an_effect_is_what_the_nearest_view_of_another_leaves_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = separable(monkeypatch, {})["a"]
    # 6 sigmas in all; (2, 0, 1) leaves 6/√5 of it, (1, 1, 0) leaves 6/√2; (0, 1, 1) is at right angles.
    assert found == pytest.approx({"": 6.0, "b": 6 / np.sqrt(5), "c": 6.0})


def test_separation_from_what_was_fitted_instead_is_that_of_the_odds(monkeypatch: pytest.MonkeyPatch) -> None:
    found = separable(monkeypatch, {frozenset({"c"}): 42.0, frozenset({"a", "b"}): 60.0})["a"]
    assert found["c"] == pytest.approx(4.0)
    assert found["b"] == pytest.approx(6 / np.sqrt(5))


@pytest.mark.parametrize(("most", "asked"), [(None, ["b", "b"]), (1, ["b", "b"]), (0, [])])
@pytest.mark.parametrize("evidence", [None, 45.5])
def test_what_is_near_is_fitted_instead_from_each_place_where_the_set_without_either_is(
    most: int | None, asked: list[str], evidence: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """b is 2.7 sigmas away in the linear view, and 3 by its odds once fitted."""
    begun: list[Any] = []

    def fit_set(search: Any, ids: frozenset[str], starts: dict[str, Any], origin: Any, rival: float) -> Any:
        begun.append((ids, starts, origin.terms, rival))
        if evidence is None:
            return None
        search.fits[ids] = SimpleNamespace(posterior=SimpleNamespace(log_evidence=evidence))
        return search.fits[ids]

    monkeypatch.setattr(model_comparison, "fit_set", fit_set)
    found = separable(monkeypatch, {NONE: 1.0}, most)["a"]
    wanted = [(frozenset({name}), {name: (name, (place,))}, NONE, -np.inf) for place, name in enumerate(asked, 1)]
    assert sorted(begun, key=str) == sorted(wanted, key=str)
    assert found["b"] == pytest.approx(6 / np.sqrt(5) if not asked else 3.0 if evidence else np.sqrt(12))
    assert found["c"] == 6.0


def test_what_cannot_be_fitted_instead_is_as_far_as_its_best_odds_without_either_say(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(model_comparison, "fit_set", lambda *_: None)
    monkeypatch.setattr(model_comparison, "SAME_SIGMAS", 7.0)  # so that c is near, too
    found = separable(monkeypatch, {NONE: 1.0})["a"]
    assert found["b"] == pytest.approx(np.sqrt(2 * (50 - 44)))  # of 44 and 43 from its two places
    assert found["c"] == 6.0  # by odds of 42, 4 sigmas


def test_a_set_without_either_that_did_not_converge_is_no_evidence_of_a_distance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(model_comparison, "fit_set", lambda *_: None)
    assert separable(monkeypatch, {NONE: 1.0}, converged=False)["a"]["b"] == pytest.approx(6 / np.sqrt(5))


@pytest.mark.parametrize(("ends", "begun", "sigmas"), [(-10.5, "two", 11.0), (-9.5, "one", np.sqrt(12))])
def test_what_ends_far_below_instead_from_either_place_is_as_far_as_its_own_evidence(
    ends: float, begun: str, sigmas: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model explains the runs at 50: what stays 60 below is no equivalent, however near it is in the linear view."""
    origins: list[Any] = []

    def fit_set(search: Any, ids: frozenset[str], _starts: Any, origin: Any, _rival: float) -> None:
        origins.append(origin)
        search.failed[ids] = ends

    monkeypatch.setattr(model_comparison, "fit_set", fit_set)
    found = separable(monkeypatch, {NONE: 1.0}, explained=50.0)["a"]
    assert found["b"] == pytest.approx(sigmas)
    assert len({id(origin) for origin in origins}) == {"one": 1, "two": 2}[begun]


@pytest.mark.parametrize(("simulated", "gain"), [(True, 5.0), (False, np.nan)])
def test_held_out_runs_confirm_a_fit_by_their_density_over_that_of_the_null(
    simulated: bool, gain: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    part: Any = SimpleNamespace(null="null")

    def density(_part: Any, fit: Any, runs: list[int]) -> float:
        assert runs == [3, 4]
        if fit == "null" and not simulated:
            raise FloatingPointError
        return -7.0 if fit == "null" else -2.0

    monkeypatch.setattr(model_comparison, "predictive_score", density)
    found: Any = "fit"
    assert confirmation(part, found, [3, 4]) == pytest.approx(gain, nan_ok=True)
