"""Values and intervals of the effects of diagnosis.json, worked out on paper from fits made of stand-ins."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.assessment import cross_validation
from evaluator.diagnosis.assessment.knowledge import knowledge
from evaluator.diagnosis.assessment.model_comparison import Standing
from evaluator.diagnosis.likelihood.known_to import Quantity
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.output import effects_json
from simulator.effects.coordinates import Candidate, Coordinate


def term(name: str, *coordinates: Coordinate, **more: Any) -> Candidate:
    return Candidate(name, coordinates, lambda values: dict(zip(("first", "second"), values, strict=False)), **more)


def fitted(item: Candidate, values: tuple[float, ...], covariance: np.ndarray, **more: Any) -> Any:
    """A diagnosis that has found one effect."""
    fit = SimpleNamespace(
        columns=tuple(Column(item.id, k, item) for k in range(item.size)),
        point=Point(np.zeros((1, 7)), terms={item.id: values}),
        posterior=SimpleNamespace(covariance=covariance),
    )
    chosen = frozenset({item.id})
    problem = SimpleNamespace(open_ground=False)
    search = SimpleNamespace(problem=problem, fits={chosen: fit}, tolerance={})
    known = {"fit": fit, "profiles": {}, "search": search, "chosen": chosen, "standing": None}
    return SimpleNamespace(**known | more)


def test_a_parameter_has_the_interval_of_its_draws_within_its_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a factor 1.3 ± 0.1 and a share 0.1 ± 0.1, which is not below 0; the absent factor is 1."""
    item = term("effect", Coordinate("first", 1.0, 0.01), Coordinate("second", 0.0, 0.01, 0.0, 1.0))
    found = fitted(item, (1.3, 0.1), 0.01 * np.eye(2))
    monkeypatch.setattr(effects_json, "silent_reaches", lambda *_: {})
    said = effects_json.parameters(found, item)
    assert said["first"] == pytest.approx({"value": 1.3, "low": 1.3 - 0.196, "high": 1.3 + 0.196}, abs=0.01)
    assert said["second"] == pytest.approx({"value": 0.1, "low": 0.0, "high": 0.1 + 0.196}, abs=0.01)
    monkeypatch.setattr(effects_json, "silent_reaches", lambda *_: {0: 0.05})
    assert effects_json.parameters(found, item)["first"]["high"] == pytest.approx(1.35)
    found.profiles = {"effect": SimpleNamespace(transform=lambda draws, mean, _: mean + 2 * (draws - mean))}
    monkeypatch.setattr(effects_json, "silent_reaches", lambda *_: {})
    assert effects_json.parameters(found, item)["first"]["high"] == pytest.approx(1.3 + 0.392, abs=0.02)


@pytest.mark.parametrize(
    ("beside", "log_odds", "low", "high"),
    [
        ("other", -5.0, 1.0 - 0.196, 1.0 + 0.196),  # 27 of 4000 draws would be of that set
        ("other", -3.0, 1.0 - 0.192, 2.0 - 0.007),  # 190 draws, of which 100 are above the end
        ("other", 7.0, 1.0 - 0.1645, 2.0 + 0.1645),  # half of all
        ("free:drag.u", 7.0, 1.0 - 0.196, 1.0 + 0.196),
        ("refused", 7.0, 1.0 - 0.196, 1.0 + 0.196),
    ],
)
def test_an_interval_holds_the_value_beside_a_further_effect_that_gains_too_little_to_be_named(
    beside: str, log_odds: float, low: float, high: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    item = term("effect", Coordinate("first", 0.0, 0.01))
    found, wider = fitted(item, (1.0,), 0.01 * np.eye(1)), frozenset({"effect", beside})
    found.search.fits[wider] = fitted(item, (2.0,), 0.01 * np.eye(1)).fit
    found.standing = Standing((wider, found.chosen), np.array([log_odds, 0.0]))
    monkeypatch.setattr(effects_json, "silent_reaches", lambda *_: {})
    monkeypatch.setattr(effects_json, "may_be_right", lambda _, ids: "refused" not in ids)
    said = effects_json.parameters(found, item)["first"]
    assert said == pytest.approx({"value": 1.0, "low": low, "high": high}, abs=0.02)
    found.search.problem.open_ground, found.search.problem.data = True, ()
    monkeypatch.setattr(cross_validation, "covariance_over_commands", lambda *_: 0.01 * np.eye(1))
    found.search.tolerance = {}
    assert effects_json.parameters(found, item)["first"]["high"] == pytest.approx(1.196, abs=0.02)


def test_on_open_ground_an_interval_is_that_over_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    item = term("effect", Coordinate("first", 0.0, 0.01))
    found = fitted(item, (1.0,), np.eye(1))
    found.search.problem = SimpleNamespace(open_ground=True, data=())
    found.search.tolerance = {}
    monkeypatch.setattr(effects_json, "silent_reaches", lambda *_: {})
    monkeypatch.setattr(cross_validation, "covariance_over_commands", lambda *_: 9.0 * np.eye(1))
    assert effects_json.parameters(found, item)["first"]["high"] == pytest.approx(1.0 + 3 * 1.96, abs=0.3)


def test_so_is_that_of_a_value_known_to_a_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces of one recording share its friction: their number makes nothing more certain."""
    known = Quantity("time_base", "clock", "1", 1e-4, 1.0)
    point = SimpleNamespace(value=lambda _: 2.0)
    fit: Any = SimpleNamespace(
        point=point, columns=[Column("time_base")], posterior=SimpleNamespace(covariance=np.eye(1))
    )
    monkeypatch.setattr(cross_validation, "covariance_over_commands", lambda *_: 9.0 * np.eye(1))
    for on_ground, times in ((True, 3.0), (False, 1.0)):
        problem: Any = SimpleNamespace(open_ground=on_ground, data=())
        (said,) = knowledge([known], fit, cross_validation.covariance_of(fit, problem, {}))
        assert said.high - said.found == pytest.approx(1.96 * times * known.per_unit, rel=1e-3)
    assert knowledge([known], fit)[0].high - 2.0 * known.per_unit == pytest.approx(1.96 * known.per_unit, rel=1e-3)


def test_an_angle_has_an_interval_about_its_value() -> None:
    draws = np.concatenate([np.linspace(355.0, 360.0, 50), np.linspace(0.0, 7.0, 70)])
    said = effects_json._interval(1.0, draws, 360.0)
    assert said == pytest.approx({"value": 1.0, "low": -5.0, "high": 7.0}, abs=0.5)


def test_a_response_in_steps_is_known_between_those_that_the_runs_hardly_contradict(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    item = term("band", Coordinate("first", 0.0, 1.0), stepwise=True, between=((10.0, 30.0), (30.0, 60.0)))
    found = fitted(item, (45.0,), np.eye(1))
    found.search.tolerance = {"mass": 0.1}
    asked: list[Any] = []
    monkeypatch.setattr(effects_json, "likely_interval", lambda *said: asked.append(said) or (10.0, 60.0))
    assert effects_json.parameters(found, item) == {"first": {"value": 45.0, "low": 10.0, "high": 60.0}}
    assert asked == [(found.search.problem, found.fit, item, {"mass": 0.1})]
