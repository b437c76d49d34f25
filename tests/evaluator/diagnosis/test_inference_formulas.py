"""Bounds, optimum and end of a fit, worked out on paper, without a simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import fit as fits
from evaluator.diagnosis.inference import fitted_model
from evaluator.diagnosis.inference.bounds import bounds, is_at_bound
from evaluator.diagnosis.inference.descent import steps
from evaluator.diagnosis.inference.descent.linearized_optimum import optimum_of
from evaluator.diagnosis.inference.fit import _fitted, _with_shortfall, _within_bounds, fit_model
from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.fitted_model import Fit, model_columns, prior_precision
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, MixedModel, Posterior, reduce_runs
from evaluator.diagnosis.likelihood.linear.random_effects import MOST_SCATTER
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.point import Column, Point
from simulator.effects.coordinates import Candidate, Coordinate
from tests.evaluator.diagnosis.synthetic import linear_runs

TAU = np.array([0.05, 0.02, 0.02, 1.0])
WANTED = np.append(np.random.default_rng(1).normal(size=3)[:2], 0.0)  # by the runs of linear_runs with three
WIDE = (np.full(2, -np.inf), np.full(2, np.inf))
NONE = frozenset[str]()


def candidate(name: str, *coordinates: Coordinate) -> Candidate:
    return Candidate(name, coordinates, lambda values: dict(zip("xyz", values, strict=False)))


FACTOR = candidate("factor", Coordinate("factor", 1.0, 0.01, 0.5, 2.0))
LINE = candidate("line", Coordinate("size", 0.0, 1.0))


def test_a_known_value_may_move_by_six_tolerances_and_by_half_of_itself_and_an_effect_within_its_own_bounds() -> None:
    columns = (Column("wheels.track_mm"), Column("body.mass_g"), Column("factor", 0, FACTOR))
    low, high = bounds(columns, {"wheels.track_mm": 0.05, "body.mass_g": 0.1})
    assert low.tolist() == pytest.approx([-0.3, -0.5, -0.5])
    assert high.tolist() == pytest.approx([0.3, 0.5, 1.0])


@pytest.mark.parametrize(("off", "ended"), [(0.9e-5, True), (1.1e-5, False)])
def test_an_estimate_is_at_a_bound_within_a_thousandth_of_a_step(off: float, ended: bool) -> None:
    column = Column("factor", 0, FACTOR)
    assert [is_at_bound(column, end) for end in (1.0 - off, off - 0.5)] == [ended, ended]


def test_an_optimum_is_that_of_least_squares_in_all_unknowns_at_once() -> None:
    """θ, start poses and random effects, each with its prior as a row of its own."""
    runs, theta, prior = linear_runs(count=4), np.array([0.3, -0.2]), np.array([4.0, 0.25])
    per_run = np.random.default_rng(2).normal(size=(4, 4)) * TAU
    found = optimum_of(runs, reduce_runs(runs), theta, per_run, prior, TAU, WIDE)
    rows, values = [np.pad(np.diag(np.sqrt(prior)), ((0, 0), (0, 28)))], [np.zeros(2)]
    for number, run in enumerate(runs):
        at = 2 + 7 * number
        row, own = np.zeros((len(run.response), 30)), np.zeros((4, 30))
        row[:, :2], row[:, at : at + 3], row[:, at + 3 : at + 7] = run.common, run.start, run.scatter
        own[:, at + 3 : at + 7] = np.diag(1 / TAU)
        rows += [row, own]
        values += [run.response, np.zeros(4)]
    design, wanted = np.concatenate(rows), np.concatenate(values)
    best = np.linalg.lstsq(design, wanted)[0]
    np.testing.assert_allclose(found.goal, best[:2], rtol=1e-6)
    np.testing.assert_allclose(found.per_run, best[2:].reshape(4, 7)[:, 3:], rtol=1e-6)
    here = np.concatenate([theta, np.zeros(28)])
    here[2:].reshape(4, 7)[:, 3:] = per_run
    starts = [column for number in range(4) for column in range(2 + 7 * number, 5 + 7 * number)]
    left = wanted - design @ here
    left = left - design[:, starts] @ np.linalg.lstsq(design[:, starts], left)[0]
    assert found.now.sum() == pytest.approx(left @ left)
    assert found.predicted == pytest.approx(left @ left - np.sum((wanted - design @ best) ** 2))


def test_a_model_has_a_column_of_every_value_with_a_tolerance_and_of_every_coordinate() -> None:
    pair = candidate("pair", Coordinate("x", 0.0, 1.0), Coordinate("y", 0.0, 1.0, prior_sigma=2.0))
    tolerance = {"wheels.track_mm": 0.05, "body.mass_g": 0.0}
    columns = model_columns([pair, LINE], tolerance, ())
    assert [(item.key, item.coordinate) for item in columns] == [
        ("wheels.track_mm", 0),
        ("pair", 0),
        ("pair", 1),
        ("line", 0),
    ]
    np.testing.assert_allclose(prior_precision(columns, tolerance), [400.0, 0.0, 0.25, 0.0])
    changes = [Column("pair", 1, pair, start=(0.5, 0.5)), Column("pair", 1, pair, to=(0.5, 0.5))]
    np.testing.assert_allclose(prior_precision(changes, tolerance), [0.0, 0.0])  # not measured from the absent value


def test_turns_of_wheels_are_values_of_a_model_only_beside_a_ripple_within_a_turn() -> None:
    tolerance = {"wheels.track_mm": 0.05, "left_wheel_turns": 0.05}
    ripple = candidate("speed-ripple", Coordinate("x", 0.0, 1.0))
    assert "left_wheel_turns" not in [item.key for item in model_columns([LINE], tolerance, ())]
    assert "left_wheel_turns" in [item.key for item in model_columns([LINE, ripple], tolerance, ())]
    assert "left_wheel_turns" in [item.key for item in model_columns([LINE], tolerance, ["speed-ripple"])]


def test_evidence_of_values_at_their_bounds_is_that_of_runs_of_which_these_values_are_taken() -> None:
    """An effect that may go to a half of what it wants, and a known value that may go to six of its tolerances."""
    runs, shift = linear_runs(count=6, parameters=3), np.array([1.2, 1.2, 0.0]) - WANTED
    theta = np.array([0.5, 0.3, 0.0])  # at the bounds of the first two; the third is free
    columns = (Column("half", 0, candidate("half", Coordinate("size", 0.0, 1.0, -0.5, 0.5))), Column("track"))
    columns = (*columns, Column("line", 0, LINE))
    runs = [replace(run, response=run.response + run.common @ shift) for run in runs]
    reduced, prior = reduce_runs(runs), np.array([0.0, 400.0, 0.0])
    whole = MixedModel(reduced, prior).posterior(range(3))
    found = _within_bounds(whole, reduced, columns, {"track": 0.05})
    rest = [replace(run, response=run.response - run.common @ theta, common=run.common[:, 2:]) for run in runs]
    inside = MixedModel(reduce_runs(rest), np.zeros(1)).posterior(range(1))
    cost = np.log(6) + 400.0 * 0.3**2  # a number that is fitted, and the prior of the known value where it ends
    assert found.log_evidence == pytest.approx(inside.log_evidence - cost / 2)
    np.testing.assert_allclose(found.scatter, inside.scatter)
    assert found.scatter[0] > 1.05 * whole.scatter[0]  # it takes up what the bounds leave
    assert found.misfit == pytest.approx(inside.misfit)
    np.testing.assert_array_equal(found.mean, whole.mean)


@dataclass(frozen=True)
class Evidence:
    """The part of a posterior that ends of fits need."""

    log_evidence: float
    scatter: np.ndarray


def fit(evidence: float = 0.0) -> Fit:
    posterior: Any = Evidence(evidence, TAU)
    point = Point(np.zeros((1, 7)), terms={"line": (0.0,)})
    nothing: Any = None
    return Fit(NONE, point, (Column("line", 0, LINE),), posterior, nothing, (), converged=False, runs=(0,))


def test_excess_is_the_mean_square_of_what_no_number_of_a_run_takes() -> None:
    """Of twelve features eight are taken: start pose, friction, gains, start of motion, and the effect."""
    unit = np.eye(12)
    views = tuple(Linearized(size * unit[9], unit[:, 7:8], unit[:, :3], unit[:, 3:7]) for size in (2.0, 4.0))
    assert replace(fit(), linearized=views).excess == pytest.approx((4 + 16) / 8)


@pytest.mark.parametrize(("share", "beyond"), [(0.99, False), (1.01, True)])
def test_friction_gains_or_start_of_a_run_that_no_run_can_have_are_overreach(
    share: float, beyond: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(4):
        per_run = np.zeros((3, 4))
        per_run[1, number] = -share * MOST_SCATTER[number]
        monkeypatch.setattr(fitted_model, "run_effects", lambda *_, found=per_run: (found, None))
        assert replace(fit(), posterior=Posterior(0.0, np.zeros(1), np.eye(1), TAU, 0.0, 0)).overreaches == beyond


def test_a_fit_that_was_made_before_is_seen_again_as_it_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noise, given = [(Noise(0.005, 0.0, 0.1),)], frozenset[str]()
    runs: Any = SimpleNamespace(data=[None], noise=noise, fingerprint="runs", horizon_s=np.inf, given=given)
    runs.friction_wander = None
    ends = iter([replace(fit(3.0), steps=7, shortfall=2.0), FloatingPointError("falls over")])

    def fitted(*_: Any) -> Fit:
        end = next(ends)
        if isinstance(end, Exception):
            raise end
        return end

    monkeypatch.setattr(fits, "_fitted", fitted)
    monkeypatch.setattr(fits, "_viewed", lambda *_: replace(fit(10.0), converged=True))
    for again in (False, True):
        runs.fits = FitCache(tmp_path / "fits.jsonl", "key")
        found = fit_model(runs, fit().point, [LINE], {})
        assert (found.converged, found.steps, found.shortfall) == (False, 7, 2.0)
        assert found.posterior.log_evidence == (9.0 if again else 3.0)
        with pytest.raises(FloatingPointError, match="on the way" if again else "falls over"):
            fit_model(runs, fit().point, [LINE], {"wheels.track_mm": 0.1})


def test_choices_that_are_not_fitted_cost_half_the_log_of_the_runs_and_a_shortfall_half_of_itself() -> None:
    eight = replace(fit(10.0), runs=tuple(range(8)))
    assert eight.counting(2).posterior.log_evidence == pytest.approx(10.0 - np.log(8))
    short = _with_shortfall(eight, 3.0)
    assert (short.posterior.log_evidence, short.shortfall) == (8.5, 3.0)
    assert _with_shortfall(eight, -1e-6).posterior.log_evidence == 10.0


def problem(*, on_ground: bool = False) -> Any:
    return SimpleNamespace(watch=SimpleNamespace(look=lambda: None), open_ground=on_ground)


@pytest.mark.parametrize(
    ("values", "damping", "better"),
    [
        ([-1.0], 1.0, True),
        ([1.0, -1.0], 0.4, True),
        ([1.0, 1.0, -0.021], 0.12, True),  # a tenth of what counts as settled
        ([1.0, 1.0, -0.019, 1.0], 1.0, False),
        ([None, 1.0, 1.0, 1.0], 0.4, False),  # a run that cannot be simulated
        ([None] * 4, 0.0, False),
    ],
)
def test_a_line_search_goes_to_the_first_point_that_improves_or_to_the_farthest(
    values: list[float | None], damping: float, better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    optimum: Any = SimpleNamespace(
        theta=np.array([1.0]), goal=np.array([3.0]), scatter=TAU, prior=np.array([0.5]), now=np.array([2.0, 0.5])
    )
    left = iter(values)

    def settled(_: Any, there: Point, *__: Any) -> tuple[Point, np.ndarray]:
        value = next(left)
        if value is None:
            raise FloatingPointError
        (size,) = there.terms["line"]
        return there, np.array([2.5 + value - 0.5 * size**2])

    monkeypatch.setattr(steps, "settled_by_run", settled)
    point, found = steps.line_search(problem(), fit(), optimum)
    assert found == better
    assert point.terms["line"][0] == pytest.approx(1.0 + 2.0 * damping if damping else 0.0)


def test_a_full_step_that_was_tried_is_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    optimum: Any = SimpleNamespace(
        theta=np.array([1.0]), goal=np.array([3.0]), scatter=TAU, prior=np.zeros(1), now=np.array([2.0, 0.0])
    )
    tried = []

    def settled(_: Any, there: Point, *__: Any) -> tuple[Point, np.ndarray]:
        tried.append(there.terms["line"][0])
        return there, np.array([1.0])

    monkeypatch.setattr(steps, "settled_by_run", settled)
    full = fit().point, np.array([1.0, 0.0])
    point, found = steps.line_search(problem(), fit(), optimum, full=full)
    assert found
    assert tried == pytest.approx([1.8])
    assert point.terms["line"][0] == pytest.approx(1.8)


def walked(
    monkeypatch: pytest.MonkeyPatch,
    predicted: list[float],
    *,
    per_run: float = 0.0,
    better: bool = True,
    evidence: list[float] | None = None,
    now: list[float] | None = None,
    rival: float = -np.inf,
    excess: float = 3.0,
) -> Fit:
    """A fit whose steps promise these decreases; now: -2 log density at each, on open ground."""
    monkeypatch.setattr(Fit, "excess", excess)
    step = iter(range(20))
    seen = evidence or [0.0] * 20
    monkeypatch.setattr(
        fits, "_viewed", lambda _, point, *__: replace(fit(seen[int(point.per_run[0, 0])]), point=point)
    )

    def optimum(_: Any, *__: Any) -> Any:
        at = next(step)
        value = now[at] if now else 0.0
        return SimpleNamespace(
            predicted=predicted[min(at, len(predicted) - 1)], per_run=np.full((1, 4), per_run), now=np.array([value])
        )

    monkeypatch.setattr(fits, "_optimum", optimum)

    def further(_: Any, before: Fit, *__: Any) -> tuple[Point, bool]:
        return replace(before.point, per_run=before.point.per_run + 1.0), better

    monkeypatch.setattr(fits, "line_search", further)
    monkeypatch.setattr(fits, "full_step", lambda *_: None)
    monkeypatch.setattr(fits, "_carried_on", lambda *given: given[3])
    columns = (Column("line", 0, LINE),)
    return _fitted(problem(on_ground=now is not None), fit().point, columns, {}, (0,), np.array(np.inf), rival)


def test_a_fit_ends_where_little_is_promised_or_where_it_does_not_improve(monkeypatch: pytest.MonkeyPatch) -> None:
    ended = walked(monkeypatch, [9.0, 9.0, 0.19])
    assert (ended.converged, ended.steps) == (True, 3)
    assert walked(monkeypatch, [9.0, 9.0, 0.21, 0.19]).steps == 4
    assert (walked(monkeypatch, [9.0]).converged, walked(monkeypatch, [9.0]).steps) == (False, 10)
    assert walked(monkeypatch, [4.9], better=False).converged  # rough, not wrong
    assert not walked(monkeypatch, [5.1], better=False).converged


def test_a_model_that_explains_the_runs_counts_with_what_it_has_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    explains = walked(monkeypatch, [59.0], better=False, excess=1.4)
    assert (explains.converged, explains.shortfall, explains.posterior.log_evidence) == (True, 59.0, -29.5)
    assert not walked(monkeypatch, [59.0], better=False, excess=1.6).converged
    assert not walked(monkeypatch, [61.0], better=False, excess=1.13).converged
    for implausible, shortfall in ((False, 900.0), (True, 0.0)):  # residuals are noise; with friction that no run has
        monkeypatch.setattr(Fit, "overreaches", property(lambda _, implausible=implausible: implausible))
        ended = walked(monkeypatch, [900.0], better=False, excess=1.11)
        assert (ended.converged, ended.shortfall) == (not implausible, shortfall)
    assert walked(monkeypatch, [9.0], excess=1.4).shortfall == 9.0  # after the last step, too
    assert walked(monkeypatch, [4.0], better=False, excess=1.4).shortfall == 0.0


def test_a_fit_gives_up_where_only_friction_that_no_run_can_have_promises_a_little_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried = [walked(monkeypatch, [9.0, 9.0 * share, 0.0], per_run=10.0) for share in (0.49, 0.51)]
    assert [(item.converged, item.steps) for item in tried] == [(True, 3), (False, 2)]
    assert walked(monkeypatch, [9.0, 8.0, 0.0]).converged


def test_a_fit_gives_up_sixty_below_a_model_that_explains_the_runs_unless_it_halves_the_distance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    steps = [walked(monkeypatch, [9.0] * 4 + [0.0], evidence=[-500.0, *rest], rival=0.0).steps for rest in (
        [-249.0, -120.0, -61.0, 0.0],  # 120 is less than half of 249, and 61 is not of 120
        [-249.0, -120.0, -59.0, 0.0],
        [-251.0] * 4,
    )]  # fmt: skip
    assert steps == [4, 5, 2]


def test_on_open_ground_a_fit_goes_on_for_three_steps_and_returns_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    found = walked(monkeypatch, [9.0, 8.0, 7.0, 6.0, 5.0, 4.0], now=[50.0, 20.0, 30.0, 40.0, 25.0, 1.0, 0.0])
    assert (found.converged, found.steps, found.shortfall) == (True, 5, 8.0)
    assert found.posterior.log_evidence == -4.0
