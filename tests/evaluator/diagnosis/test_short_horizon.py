"""When a search begins with the first seconds of the runs, and how it goes on from there."""

from __future__ import annotations

from dataclasses import make_dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import profile_likelihood, short_horizon, strategy
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.inference.short_horizon import is_implausible
from evaluator.diagnosis.likelihood.linear.mixed_model import USUAL_SCATTER
from evaluator.diagnosis.likelihood.point import Point
from evaluator.progress import no_progress


@pytest.mark.parametrize(
    ("number", "usual", "beyond"),
    [(3, 0.29, 0.31), (3, -0.29, -0.31), (4, 0.059, 0.061), (5, -0.059, -0.061), (6, 9.9, 10.1), (0, 1e3, None)],
)
def test_friction_of_30_percent_or_a_wheel_of_6_percent_hides_a_misfit(
    number: int, usual: float, beyond: float | None
) -> None:
    """A run's own numbers: x, y, heading of its start, friction, gains of left and right, start of motion."""
    own = np.zeros((5, 7))
    own[2, number] = usual
    assert not is_implausible(Point(own, {}, {}))
    if beyond is not None:
        own[2, number] = beyond
        assert is_implausible(Point(own, {}, {}))


def runs_of(seconds: float, *, horizon_s: float = np.inf) -> Any:
    """A problem whose longest run lasts so many seconds after its start."""
    run = SimpleNamespace(time_s=np.array([0.0, 0.5 + seconds]), start_s=0.5)
    return SimpleNamespace(data=[run], horizon_s=horizon_s, open_ground=False, watch=SimpleNamespace())


def shortened(problem: Any, point: Any, horizon_s: float) -> Any:
    """Stands for the problem of the first seconds of each run; the point at which its noise is estimated is noted."""
    return SimpleNamespace(**vars(problem) | {"horizon_s": horizon_s, "noise_at": point})


@pytest.mark.parametrize(
    ("seconds", "fails_at", "reached"), [(9.0, None, 4.0), (3.0, None, 2.0), (9.0, 4.0, 2.0), (0.9, None, 0.0)]
)
def test_a_far_start_is_fitted_to_longer_and_longer_beginnings_each_from_the_one_before(
    seconds: float, fails_at: float | None, reached: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fit_model(problem: Any, begin: float, terms: list[Any], tolerance: Any, *, most_scatter: Any) -> Any:
        assert (begin, terms, tolerance) == (problem.noise_at, [], {"mass": 0.1})
        assert most_scatter == USUAL_SCATTER
        assert problem.horizon_s == {0.0: 1.0, 1.0: 2.0, 2.0: 4.0}[begin]
        if problem.horizon_s == fails_at:
            raise FloatingPointError
        return SimpleNamespace(point=problem.horizon_s)

    monkeypatch.setattr(short_horizon, "within_horizon", shortened)
    monkeypatch.setattr(short_horizon, "fit_model", fit_model)
    begin: Any = 0.0
    found: Any = short_horizon.recalibrated(runs_of(seconds), begin, {"mass": 0.1})
    assert found == reached


@pytest.mark.parametrize(
    ("seconds", "horizons"),
    [
        (0.9, []),
        (9.9, [1.0, 2.5]),
        (10.1, [1.0, 2.5, 6.25]),  # four times as long is too far
        (26.0, [1.0, 2.5, 6.25, 15.625]),
    ],
)
def test_horizons_go_on_until_the_whole_run_is_near(seconds: float, horizons: list[float]) -> None:
    assert short_horizon.within(runs_of(seconds), short_horizon.HORIZONS_S) == horizons


def test_the_four_best_sets_of_one_second_converged_or_not_are_carried_on_to_two_and_a_half_and_to_whole_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Sets by name with their log evidence; those of the longer beginning come in another order."""
    evidence = {1.0: {"": 0.0, "a": 60.0, "b": 50.0, "c": 40.0, "d": 30.0}, 2.5: {"": 0.0, "b": 9.0, "a": 7.0}}
    calls: list[Any] = []

    def run_search(search: Search, start: Any, nominal: Any, _: Any, seeds: list[Any]) -> None:
        horizon_s = search.problem.horizon_s
        noise_at = search.problem.noise_at  # type: ignore[attr-defined]
        calls.append((horizon_s, start, nominal, noise_at, search.most_steps, [one.name for one in seeds]))
        for name, value in evidence[horizon_s].items():
            fit: Any = SimpleNamespace(
                name=name, point=f"{name or 'none'} at {horizon_s}", posterior=SimpleNamespace(log_evidence=value)
            )
            kept = search.failed if name == "a" else search.fits  # not converged, but an initial value
            kept[frozenset(name)] = fit
        search.failed[frozenset("z")] = None

    monkeypatch.setattr(short_horizon, "within_horizon", shortened)
    monkeypatch.setattr(short_horizon, "run_search", run_search)
    terms: Any = dict.fromkeys("abcd")
    start: Any = "start"
    found: Any = short_horizon.short_horizon_fits(Search(runs_of(9.0), terms, {}, (0,)), start, no_progress)
    assert calls == [
        (1.0, "start", "start", "start", 70, []),
        (2.5, "start", "start", "a at 1.0", 70, ["a", "b", "c", "d"]),
    ]
    assert [one.name for one in found] == ["b", "a", ""]


@pytest.mark.parametrize(
    ("too_far", "noise_at", "found"), [("", "a", "z"), ("a", "b", "z"), ("ab", "c", "z"), ("abcd", None, "a")]
)
def test_the_first_seconds_are_carried_on_from_the_best_set_with_which_the_next_can_be_simulated(
    too_far: str, noise_at: str | None, found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A set that leads a run to rest at a magnet cannot; if none can, the sets of the first second are the result."""
    begun: list[Any] = []

    def within_horizon(problem: Any, point: Any, horizon_s: float) -> Any:
        if horizon_s > 1.0 and point in too_far:
            raise FloatingPointError
        return shortened(problem, point, horizon_s)

    def run_search(search: Search, *_: Any) -> None:
        begun.append(search.problem.noise_at)  # type: ignore[attr-defined]
        for rank, name in enumerate("abcd" if search.problem.horizon_s == 1.0 else "z"):
            fit: Any = SimpleNamespace(point=name, posterior=SimpleNamespace(log_evidence=-rank))
            search.fits[frozenset(name)] = fit

    monkeypatch.setattr(short_horizon, "within_horizon", within_horizon)
    monkeypatch.setattr(short_horizon, "run_search", run_search)
    terms: Any = dict.fromkeys("abcdz")
    start: Any = "start"
    fits: Any = short_horizon.short_horizon_fits(Search(runs_of(9.0), terms, {}, (0,)), start, no_progress)
    assert begun == ["start"] + [noise_at] * (noise_at is not None)
    assert fits[0].point == found


def test_fits_of_the_first_seconds_are_where_those_of_whole_runs_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is screened then, but for what is added to the best; the null has no set to begin with."""
    begun: list[Any] = []
    null: Any = SimpleNamespace(posterior=SimpleNamespace(log_evidence=0.0), converged=True, excess=9.0)
    monkeypatch.setattr(strategy, "fit_model", lambda *_: null)
    monkeypatch.setattr(strategy, "extend", lambda *_: None)
    seeds: Any = [
        SimpleNamespace(terms=frozenset(name), point=SimpleNamespace(terms={name: (0.3,)})) for name in ("", "a")
    ]

    def fit_set(search: Search, ids: frozenset[str], starts: Any, origin: Any) -> None:
        begun.append((ids, starts, origin))
        search.fits[ids] = SimpleNamespace(**vars(null) | {"posterior": SimpleNamespace(log_evidence=1.0)})  # type: ignore[assignment]

    monkeypatch.setattr(strategy, "fit_set", fit_set)
    start: Any = None
    strategy.run_search(Search(runs_of(9.0), {}, {}, (0,)), start, start, no_progress, seeds)
    assert begun == [(frozenset("a"), {"a": (0.3,)}, seeds[1])]


@pytest.mark.parametrize(("on_ground", "told"), [(False, ["a"]), (True, [])])
def test_intervals_are_profiled_on_a_plate_of_effects_with_derivatives_whose_density_is_not_normal(
    on_ground: bool, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    terms: Any = {name: SimpleNamespace(id=name, stepwise=name == "s") for name in "abs"}
    ids = frozenset(terms)
    search: Any = SimpleNamespace(problem=SimpleNamespace(open_ground=on_ground), terms=terms, fits={ids: "fit"})
    monkeypatch.setattr(
        profile_likelihood, "profile_of", lambda _, fit, term: (fit, term.id) if term.id != "b" else None
    )
    found: Any = profile_likelihood.profiles_of(search, ids)
    assert found == {name: ("fit", name) for name in told}


def test_two_changes_as_a_whole_that_promise_most_are_fitted_from_the_model_as_its_file_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Effects without a derivative alone are screened there, and begin where their offer does."""
    begun: list[Any] = []
    promised = {1: 3.0, 2: 7.0, 3: 5.0}

    def screen(_search: Any, point: Any, inside: Any, candidates: Any) -> Any:
        assert (point, inside, [term.id for term in candidates]) == ("nominal", (), ["band"])
        return SimpleNamespace(
            offers=[("band", (place,)) for place in promised],
            evidence=lambda offer: promised[offer[1][0]],
            start_of=lambda offer: offer[1],
        )

    def fit_set(_search: Any, ids: frozenset[str], starts: Any, origin: Any) -> None:
        begun.append((ids, starts, origin.point, origin.kind))

    monkeypatch.setattr(strategy, "screen", screen)
    monkeypatch.setattr(strategy, "fit_set", fit_set)
    terms: Any = {name: SimpleNamespace(id=name, stepwise=name == "band") for name in ("band", "scale")}
    null = make_dataclass("Null", ["point", "kind"])("of the null", "null")
    nominal: Any = "nominal"
    strategy._fit_whole_changes(Search(runs_of(9.0), terms, {}, (0,), {frozenset(): null}), nominal)
    assert begun == [(frozenset({"band"}), {"band": (place,)}, "nominal", "null") for place in (2, 3)]
