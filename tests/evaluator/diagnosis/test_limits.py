"""Limits of effects that the model lacks: their distribution within bounds, and which parameters have one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from evaluator.diagnosis.inference import limits as module
from evaluator.diagnosis.inference.limits import Limit, limits
from evaluator.diagnosis.likelihood.linear.mixed_model import MixedModel, reduce_runs
from evaluator.report.diagnosis.limits import limits_section
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate, Scene
from tests.evaluator.diagnosis.synthetic import linear_runs

Floats = np.ndarray
TERMS = {id_: effect.candidate(Scene(60.0, (15.0, 30.0, 45.0))) for id_, effect in EFFECTS.items()}


def view_of(terms: list[Candidate], mean: dict[str, list[float]], sigma: dict[str, list[float]]) -> Any:
    """A screening whose columns are independent, with these means and standard deviations; 0: no response."""
    offers, at, spread, column = [], [], [], 0
    for term in terms:
        offers.append((term.id, tuple(range(column, column + term.size))))
        at += mean.get(term.id, [0.0] * term.size)
        spread += sigma.get(term.id, [1.0] * term.size)
        column += term.size
    wide = np.array(spread)
    beyond = SimpleNamespace(
        whole=np.diag((wide > 0).astype(float)),
        redundant=np.zeros((1, column), dtype=bool),
        posterior=lambda keep: SimpleNamespace(mean=np.array(at)[keep], covariance=np.diag(wide[keep] ** 2)),
    )
    return SimpleNamespace(offers=tuple(offers), beyond=beyond)


def limited(
    monkeypatch: pytest.MonkeyPatch, ids: list[str], mean: dict[str, list[float]], sigma: dict[str, list[float]]
) -> dict[tuple[str, str], Limit]:
    """Limits of these effects beside a set that has none."""
    monkeypatch.setattr(module, "screen", lambda *given: view_of(list(given[-1]), mean, sigma))
    search: Any = SimpleNamespace(
        problem=SimpleNamespace(open_ground=False),
        terms={id_: TERMS[id_] for id_ in ids},
        fits={frozenset[str](): SimpleNamespace(point=None)},
    )
    return {(item.effect, item.parameter): item for item in limits(search, frozenset())}


def test_a_two_sided_size_has_the_middle_of_its_distribution_and_a_drag_the_part_that_is_not_negative(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = limited(
        monkeypatch,
        ["time-base", "rolling-drag"],
        {"time-base": [0.004], "rolling-drag": [-0.01]},
        {"time-base": [0.002], "rolling-drag": [0.02]},
    )
    clock, drag = found["time-base", "factor"], found["rolling-drag", "coefficient"]
    assert clock.low == 1.0  # the runs lean to one side, and the effect may be absent all the same
    assert clock.high == pytest.approx(1.004 + 1.96 * 0.002, abs=2e-4)
    even = limited(monkeypatch, ["time-base"], {"time-base": [0.001]}, {"time-base": [0.002]})["time-base", "factor"]
    assert (even.low, even.high) == pytest.approx((1.001 - 1.96 * 0.002, 1.001 + 1.96 * 0.002), abs=2e-4)
    above = stats.norm.sf(0.0, -0.01, 0.02)
    assert drag.low is None
    assert drag.high == pytest.approx(stats.norm.isf(0.05 * above, -0.01, 0.02), rel=0.03)


def test_a_limit_of_the_motors_is_at_least_something(monkeypatch: pytest.MonkeyPatch) -> None:
    sigma = {"acceleration-limit": [1e-4, 1e-4, 1e-4]}  # s per rpm
    found = limited(monkeypatch, ["acceleration-limit"], {}, sigma)["acceleration-limit", "ahead_rpm_s"]
    assert found.high is None
    assert found.low == pytest.approx(1e4 / 1.96, rel=0.03)


def test_a_tilt_has_the_limit_of_its_angle_and_none_of_its_direction(monkeypatch: pytest.MonkeyPatch) -> None:
    found = limited(monkeypatch, ["plate-tilt"], {}, {"plate-tilt": [0.3, 0.3]})
    assert set(found) == {("plate-tilt", "angle_deg")}
    assert found["plate-tilt", "angle_deg"].high == pytest.approx(0.3 * stats.rayleigh.isf(0.05), rel=0.03)


def test_what_has_no_response_or_no_place_has_no_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    ids = ["tether-spring", "camera-tilt", "command-lag", "stray-magnet", "dead-band", "mass-offset", "speed-limit"]
    found = limited(
        monkeypatch,
        ids,
        {},
        {
            "tether-spring": [0.001, 0.1, 0.1],
            "camera-tilt": [1e-5, 2e-5, 0.0],  # its perspective changes nothing without a tilt
            "command-lag": [0.01, 0.0],
            "mass-offset": [0.05, 1.5],  # the second is about as uncertain as it can be
            "speed-limit": [0.0, 0.0, 0.0],
        },
    )
    assert set(found) == {
        ("tether-spring", "stiffness_mN_mm"),
        ("camera-tilt", "per_mm_x"),
        ("camera-tilt", "per_mm_y"),
        ("command-lag", "dead_time_s"),
        ("mass-offset", "x_mm"),
    }


def test_a_size_beyond_what_a_linearization_says_is_not_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    step = TERMS["wheel-toe"].coordinates[0].step
    found = limited(monkeypatch, ["wheel-toe"], {}, {"wheel-toe": [0.1 * step, 30 * step]})
    assert set(found) == {("wheel-toe", "left_deg")}


def test_limits_cover_the_truth_of_random_linear_physics(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two parameters with known truth, in 60 experiments: 95 % within three standard errors."""
    term, hits = TERMS["wheel-toe"], []
    for seed in range(60):
        truth = np.random.default_rng(seed).normal(size=2)
        model = MixedModel(reduce_runs(linear_runs(6, 2, seed)), np.zeros(2))
        view = SimpleNamespace(offers=((term.id, (0, 1)),), beyond=model)
        monkeypatch.setattr(module, "screen", lambda *_, shown=view: shown)
        search: Any = SimpleNamespace(
            problem=SimpleNamespace(open_ground=False),
            terms={term.id: term},
            fits={frozenset(): SimpleNamespace(point=0)},
        )
        for item, true in zip(limits(search, frozenset()), truth, strict=True):
            assert item.low is not None
            hits.append(item.low <= true <= item.high)
    assert 0.95 - 3 * np.sqrt(0.95 * 0.05 / 120) <= np.mean(hits)


def test_the_report_has_a_row_for_each_limit_and_names_what_has_none() -> None:
    content = {
        "limits": [
            {"id": "plate-tilt", "parameter": "angle_deg", "low": None, "high": 0.3127},
            {"id": "time-base", "parameter": "factor", "low": 0.99273, "high": 1.0133},
            {"id": "plate-tilt"},  # of another program
        ],
        "effects": [{"id": "wheel-toe"}],
        "not_tried": ["speed-drift"],
    }
    section = limits_section(content)
    assert section is not None
    assert section.tables[0].rows == (
        ("the plate is not level", "angle", "°", "0", "up to 0.31"),
        ("seconds are off by a factor", "factor", "", "1", "0.993 to 1.013"),
    )
    assert "stray-magnet" in section.text[0]
    assert not any(id_ in section.text[0] for id_ in ("plate-tilt", "wheel-toe", "speed-drift"))
    assert limits_section({}) is None
