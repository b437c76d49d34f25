"""A session whose values change between two runs has two parts; one whose values scatter, or are common, has none."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import session_diagnosis as caller
from evaluator.diagnosis.assessment.knowledge import Knowledge
from evaluator.diagnosis.changes import parted_session as module
from evaluator.diagnosis.changes.parted_session import Parted
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.fit import EXPLAINED
from evaluator.diagnosis.inference.fitted_model import Fit, prior_precision
from evaluator.diagnosis.inference.watch import SearchStoppedError, Watch
from evaluator.diagnosis.likelihood.known_to import Quantity
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.run_data import PER_RUN
from evaluator.diagnosis.result import Diagnosis

LEVEL, MASS = Column("plate_level_x_deg"), Column("body.mass_g")
TOLERANCE = {LEVEL.key: 0.3, MASS.key: 0.02}
TERMS = {f"effect {number}": None for number in range(26)}
RUNS, FEATURES = 10, 60
KNOWN = (Quantity(LEVEL.key, "level of the plate along x", "deg", 0.3, 1.0),)


def search(monkeypatch: pytest.MonkeyPatch, levels: list[float], order: list[int] | None = None) -> tuple[Any, Session]:
    """A search whose fits are exact: runs with noise of 1, to which a level of 1 degree adds ten sigmas."""
    rng = np.random.default_rng(3)
    linear = []
    for level in levels:
        common = rng.normal(size=(FEATURES, 2)) * [10.0, 1.0] / np.sqrt(FEATURES)
        own = rng.normal(size=(FEATURES, 7)) / np.sqrt(FEATURES)
        linear.append(Linearized(rng.normal(size=FEATURES) + common @ [level, 0.0], common, own[:, :3], own[:, 3:]))

    def fitted(runs: tuple[int, ...]) -> Fit:
        parts = tuple(linear[run] for run in runs)
        reduced = reduce_runs(parts)
        posterior = MixedModel(reduced, prior_precision((LEVEL, MASS), TOLERANCE)).posterior(range(2))
        values = dict(zip((LEVEL.key, MASS.key), posterior.mean.tolist(), strict=True))
        point = Point(np.zeros((RUNS, PER_RUN)), values, {})
        return Fit(frozenset(), point, (LEVEL, MASS), posterior, reduced, parts, converged=True, runs=runs)

    whole = fitted(tuple(range(len(levels))))
    places = order or range(len(levels))
    data: Any = tuple(
        SimpleNamespace(id=f"r{run}", order=place, number=run) for run, place in zip(range(RUNS), places, strict=False)
    )
    again = SimpleNamespace(fits={}, failed={}, evidence=lambda _: whole.posterior.log_evidence)

    def fit_set(search: Any, ids: frozenset[str], *_: Any) -> None:
        search.fits[ids] = whole

    def explained(session: Session, _: Any) -> Any:
        fit = fitted(tuple(run.number for run in session.data))  # type: ignore[attr-defined]
        return None if fit.excess > EXPLAINED else (("problem of", fit.runs), fit)

    def with_noise_of(problem: Any, parts: Any) -> Any:
        assert all(part == ("problem of", runs) for runs, part in parts)
        return problem

    monkeypatch.setattr(module, "fit_set", fit_set)
    monkeypatch.setattr(module, "_explained", explained)
    monkeypatch.setattr(module, "_with_noise_of", with_noise_of)
    searched = SimpleNamespace(
        runs=whole.runs, tolerance=TOLERANCE, terms=TERMS, reached=lambda ids: None if ids else whole,
        ranked=lambda: [frozenset()], problem=SimpleNamespace(data=data, open_ground=False), anew=lambda **_: again,
    )  # fmt: skip
    return searched, Session(data, (None,) * len(data), {}, known=KNOWN)  # type: ignore[arg-type]


def parted(asked: tuple[Any, Session]) -> Parted | None:
    return module.parted(*asked, Watch(), [frozenset({"effect 3"})])


def test_a_level_that_changes_after_five_runs_parts_the_session_there(monkeypatch: pytest.MonkeyPatch) -> None:
    found = parted(search(monkeypatch, [0.0] * 5 + [4.0] * 5))
    assert found is not None
    assert found.runs == ((0, 1, 2, 3, 4), (5, 6, 7, 8, 9))
    said = found.sentence([f"r{run}" for run in range(RUNS)], KNOWN)
    assert said.startswith("the runs r0 to r4 and r5 to r9 are each explained by themselves, and not together, with ")
    before, after = (fit.point.nominal[LEVEL.key] for fit in found.fits)
    assert f"values that differ: level of the plate along x off by {before:+.2g} and {after:+.2g} deg; what" in said
    assert (before, after) == (pytest.approx(0.0, abs=0.2), pytest.approx(4.0, abs=0.2))


def test_the_order_of_the_session_counts_and_not_that_of_the_list(monkeypatch: pytest.MonkeyPatch) -> None:
    found = parted(search(monkeypatch, [0.0, 4.0] * 5, order=[0, 5, 1, 6, 2, 7, 3, 8, 4, 9]))
    assert found is not None
    assert found.runs == ((0, 2, 4, 6, 8), (1, 3, 5, 7, 9))


@pytest.mark.parametrize(
    "levels",
    [
        [0.0] * RUNS,
        [0.5] * RUNS,
        [0.0, 0.0, 4.0, 0.0, 4.0, 4.0, 0.0, 4.0, 0.0, 4.0],  # no two parts are explained
        [0.0] * 8 + [4.0] * 2,  # too few on one side
        [0.0] * 2 + [4.0] * 3,  # too few at all
    ],
)
def test_a_common_level_and_one_that_changes_to_and_fro_part_no_session(
    levels: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert parted(search(monkeypatch, levels)) is None


@pytest.mark.parametrize(("by", "is_parted"), [(8.1, True), (7.9, False)])
def test_both_parts_gain_over_the_best_model_what_an_effect_must_beyond_the_prior_of_a_change(
    by: float, is_parted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, session = search(monkeypatch, [0.0] * 5 + [4.0] * 5)
    found = parted((asked, session))
    assert found is not None
    both = sum(fit.posterior.log_evidence for fit in found.fits) + np.log(0.05 / 5)
    best = asked.anew()
    assert found.gain == pytest.approx(both - best.evidence(frozenset()))
    best.evidence = lambda _: both - by
    assert (parted((asked, session)) is not None) == is_parted


@pytest.mark.parametrize(("levels", "said"), [([0.0] * 5 + [4.0] * 5, True), ([0.5] * RUNS, False)])
def test_an_unknown_disagreement_of_two_parts_is_said_to_be_one(
    levels: list[float], said: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, session = search(monkeypatch, levels)
    found = caller._in_parts(Diagnosis("unknown", "so", session, search=asked), Watch())
    assert found.verdict == "unknown"
    assert ("are each explained by themselves" in found.reason) == said
    assert (found.reason == "so") != said


def test_a_limit_of_time_leaves_the_verdict_that_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, session = search(monkeypatch, [0.0] * 5 + [4.0] * 5)

    def stopped(*_: Any) -> None:
        raise SearchStoppedError(7.0, "")

    monkeypatch.setattr(caller, "parted", stopped)
    found = Diagnosis("unknown", "so", session, search=asked)
    assert caller._in_parts(found, Watch()) == found


def found_as(values: list[tuple[float, float]]) -> tuple[Knowledge, ...]:
    """Quantities q0, q1, … with these fitted values and standard uncertainties; the first has a unit."""
    return tuple(
        Knowledge(
            Quantity(f"q{k}", f"q{k}", "deg" if k == 0 else "1", 0.3, 1.0), value, value - 1.96 * s, value + 1.96 * s
        )
        for k, (value, s) in enumerate(values)
    )


def test_values_are_named_that_differ_by_three_of_their_common_sigmas_the_surest_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = [(2.0, 0.3), (2.0, 0.3), (-0.7, 0.3), (5.0, 0.001), (1.0, 0.4), (0.0, 0.3)]
    after = [(3.9, 0.4), (2.0, 0.3), (0.7, 0.4), (5.4, 0.001), (-2.0, 0.3), (1.45, 0.4)]  # 3.8, 0, 2.8, 283, 6, 2.9
    answers = {"before": found_as(before), "after": found_as(after)}
    monkeypatch.setattr(module, "knowledge", lambda _, fit: answers[fit])
    parts: Any = Parted(("before", "after"), ((0, 1, 2), (3, 4, 5)), 9.0)  # type: ignore[arg-type]
    assert "q3 off by +5 and +5.4; q4 off by +1 and -2; q0 off by +2 and +3.9 deg; what" in parts.sentence("abcdef", ())
    answers["after"] = (*found_as(after)[:5], found_as([(0.0, 0.3)] * 5 + [(9.0, 0.4)])[5])
    assert "q0" not in parts.sentence("abcdef", ())  # three are named, of four
    answers["after"] = answers["before"]
    assert ", with values" not in parts.sentence("abcdef", ())


@pytest.mark.parametrize(
    ("excess", "gaps_mm", "explained"),
    [
        (EXPLAINED - 0.01, (0.2, 0.1), True),
        (EXPLAINED, (0.1, 0.1), False),
        (1.0, (0.21, 0.1), False),  # one run is not followed
        (None, (0.1, 0.1), False),  # nothing could be fitted
    ],
)
def test_a_part_is_explained_if_its_misfit_is_noise_and_every_run_is_followed(
    excess: float | None, gaps_mm: tuple[float, float], explained: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = SimpleNamespace(of_tracking="of tracking")
    fit = None if excess is None else SimpleNamespace(
        excess=excess, point="point", posterior=SimpleNamespace(scatter="scatter")
    )  # fmt: skip
    part = SimpleNamespace(problem=problem, runs=(0, 1))
    monkeypatch.setattr(module, "prepared", lambda session, watch, out: (session, watch, out))
    monkeypatch.setattr(
        module, "null_alone", lambda asked: (part, fit) if asked == ("session", "watch", None) else None
    )
    monkeypatch.setattr(module, "place_runs", lambda *asked: "placed" if asked[1] == "point" else None)
    monkeypatch.setattr(module, "run_gaps", lambda *asked: np.array(gaps_mm) if asked[1] == "placed" else None)
    monkeypatch.setattr(module, "farthest_followed", lambda *_: np.array([0.2, 0.2]))
    asked: Any = ("session", "watch")
    assert module._explained(*asked) == ((problem, fit) if explained else None)

    def fails(*_: Any) -> None:
        raise FloatingPointError

    monkeypatch.setattr(module, "place_runs", fails)
    assert module._explained(*asked) is None


def test_runs_have_the_noise_of_their_own_part() -> None:
    @dataclass(frozen=True)
    class Noisy:
        channels: tuple[str, ...]
        noise: tuple[str, ...]
        compressions: tuple[str, ...]

    def of(name: str, count: int) -> Any:
        return Noisy(*(tuple(f"{name}{kind}{run}" for run in range(count)) for kind in "cnp"))

    found = module._with_noise_of(of("whole", 4), [((0, 2), of("a", 2)), ((1, 3), of("b", 2))])
    assert found == Noisy(*((f"a{k}0", f"b{k}0", f"a{k}1", f"b{k}1") for k in "cnp"))  # type: ignore[comparison-overlap]
