"""Values known to a tolerance, each plausible, may be off together by more than chance; and an effect may be one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from evaluator.diagnosis import search_runs
from evaluator.diagnosis.assessment import verdict
from evaluator.diagnosis.assessment.knowledge import Knowledge, strained, together
from evaluator.diagnosis.assessment.model_comparison import Standing
from evaluator.diagnosis.assessment.verdict import may_be_right, pays
from evaluator.diagnosis.likelihood.known_to import RADIUS_DIFFERENCE, START, Quantity

KEYS = ("body.mass_g", "wheels.track_mm", "slip.lateral_friction", "plane_scale", START)
SIGMAS = np.array([0.02, 0.005, 0.05, 0.02, 0.02])
TOLERANCE = dict(zip(KEYS, SIGMAS, strict=True))


def fit(values: np.ndarray, covariance: np.ndarray) -> Any:
    """A fit that prefers these values (5,)."""
    columns = [SimpleNamespace(key=key, term=None) for key in KEYS]
    columns.insert(2, SimpleNamespace(key="effect", term="effect"))
    own = dict(zip(KEYS, values, strict=True)) | {"effect": 9.0}
    wide = np.insert(np.insert(covariance, 2, 0.0, axis=0), 2, 0.0, axis=1)
    return SimpleNamespace(
        columns=columns,
        point=SimpleNamespace(value=lambda column: own[column.key]),
        posterior=SimpleNamespace(covariance=wide),
    )


def test_the_joint_preference_of_true_laboratories_is_chi_square() -> None:
    """Drawn from the prior and measured with errors that are correlated; one quantity of which nothing is measured."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(5, 5)) * 6
    root[:, 3] = 0.0  # the scale does not show
    information = root.T @ root
    covariance = np.linalg.inv(information + np.eye(5))
    squares = []
    for _ in range(400):
        truth = rng.normal(size=5)
        seen = root @ truth + rng.normal(size=5)
        found = together(fit(covariance @ root.T @ seen * SIGMAS, covariance * np.outer(SIGMAS, SIGMAS)), TOLERANCE)
        squares.append(found.square)
        assert found.freedom == 3  # neither the scale nor the start counts
    assert stats.kstest(squares, stats.chi2(3).cdf).pvalue > 0.01


@pytest.mark.parametrize(("left", "counts"), [(0.4, True), (0.49, True), (0.51, False)])
def test_a_value_of_which_the_runs_tell_a_part_scatters_by_the_root_of_that_part(left: float, counts: bool) -> None:
    """Of a variance that is narrowed to 0.4 of the prior's, 0.6 is what preferences scatter by."""
    covariance = np.diag(SIGMAS**2) * [left, 1.0, 1.0, 1.0, 1.0]
    found = together(fit(1.2 * SIGMAS * [1, 0, 0, 0, 0], covariance), TOLERANCE)
    assert found.freedom == counts
    assert found.square == pytest.approx(1.44 / (1 - left) if counts else 0.0)


def test_a_value_that_scatters_between_commands_by_more_than_its_tolerance_is_neither_counted_nor_told() -> None:
    """A clock 4.1 tolerances off, by 2.2 of its standard errors, beside a radius 3.8 tolerances off, by 20."""
    narrow, scatter = 1e-2 * np.diag(SIGMAS**2), np.array([4.1 / 2.2, 0.05, 0.1, 0.1, 0.1])
    column = np.diag(np.insert((scatter * SIGMAS) ** 2, 2, 1.0))
    values = SIGMAS * [4.1, -3.8, 0.0, 0.0, 0.0]
    found = together(fit(values, narrow), TOLERANCE, column)
    assert found.furthest[0] == ("wheels.track_mm", pytest.approx(-3.8))
    assert KEYS[0] not in dict(found.furthest)
    assert found.square == pytest.approx(3.8**2, rel=1e-2)
    assert together(fit(values, narrow), TOLERANCE).furthest[0][0] == KEYS[0]
    for value, error, finding in ((4.1, 4.1 / 2.2, False), (-3.8, 0.19, True), (-2.9, 0.19, False)):
        half = 1.96 * error
        assert Knowledge(Quantity("", "", "", 1.0, 1.0), value, value - half, value + half).is_finding == finding


def test_several_values_two_tolerances_off_are_a_finding_and_one_is_not() -> None:
    covariance = 1e-3 * np.diag(SIGMAS**2)
    off = together(fit(2.1 * SIGMAS * [1, -1, 1, 1, 0], covariance), TOLERANCE)
    assert off.square == pytest.approx(4 * 2.1**2, rel=2e-3)
    assert off.is_finding
    said = off.sentence([Quantity("plane_scale", "millimetres of the plate", "1", 1e-3, 1.0)])
    assert "deviate jointly by more than chance (probability 0.001" in said
    assert "millimetres of the plate +2.1" in said
    assert not together(fit(2.1 * SIGMAS * [1, 0, 0, 0, 9], covariance), TOLERANCE).is_finding


KNOWN = 1e-3 * np.diag(SIGMAS**2)  # values told a thousand times better than their tolerances


def off(*tolerances: float) -> Any:
    """A fit that prefers values so many tolerances off."""
    return fit(SIGMAS * tolerances, KNOWN)


@pytest.mark.parametrize(
    ("values", "without", "far"),
    [
        ((3.1, -3.1, 2.9, -2.9, 0.0), (0.0,) * 5, {KEYS[0], KEYS[1]}),
        ((3.1, -3.1, 2.9, -2.9, 0.0), (3.1, 0.0, 9.0, 9.0, 0.0), {KEYS[1]}),  # what is off without effects too is none
        ((0.0, 0.0, 0.0, 0.0, 9.0), (0.0,) * 5, set()),  # hands that start a camera
    ],
)
def test_a_set_strains_the_values_that_it_alone_moves_beyond_three_tolerances(
    values: tuple[float, ...], without: tuple[float, ...], far: set[str]
) -> None:
    assert strained(off(*values), off(*without), TOLERANCE) == far


@pytest.mark.parametrize(("value", "excused"), [(5.9, True), (-5.9, True), (5.99, False), (-5.99, False)])
def test_on_open_ground_a_value_at_its_bound_of_six_tolerances_is_no_excuse(value: float, excused: bool) -> None:
    """What is within a thousandth of the range, 0.012 tolerances, has ended there."""
    with_it, without = off(value, 0, 0, 0, 0), off(4.0, 0, 0, 0, 0)
    effect = with_it.columns[2]
    effect.term, effect.coordinate, effect.absent = SimpleNamespace(coordinates=[SimpleNamespace(low=0, high=99)]), 0, 0
    assert strained(with_it, without, TOLERANCE) == set()
    assert (strained(with_it, without, TOLERANCE, on_ground=True) == set()) == excused


def searched(null: Any, one: Any, *, at_bounds: bool = False, unbelieved: bool = False) -> Any:
    """A search that has fitted nothing and the effect."""
    one.at_bounds, one.unbelieved = at_bounds, unbelieved
    return SimpleNamespace(
        fits={frozenset(): null, EFFECT: one},
        null=null,
        tolerance=TOLERANCE,
        problem=SimpleNamespace(open_ground=False),
    )


EFFECT = frozenset({"effect"})


def test_a_set_that_strains_two_values_or_ends_at_a_bound_is_no_answer_and_nothing_always_may_be() -> None:
    null = off(0, 0, 0, 0, 0)
    assert may_be_right(searched(null, off(9, 0, 0, 0, 0)), EFFECT)
    two = searched(null, off(4, -4, 0, 0, 0))
    assert not may_be_right(two, EFFECT)
    assert may_be_right(two, frozenset())
    for end in ({"at_bounds": True}, {"unbelieved": True}):
        assert not may_be_right(searched(null, off(0, 0, 0, 0, 0), **end), EFFECT)


@pytest.mark.parametrize(
    ("off_without", "off_with", "relieves"), [(2.1, 0.1, True), (0.1, 0.1, False), (2.1, 2.1, False)]
)
@pytest.mark.parametrize(("odds", "for_relief"), [(8.05, False), (6.05, True), (5.95, None)])
def test_an_effect_that_stands_for_what_several_values_would_be_off_by_need_earn_no_more_than_a_second_one(
    off_without: float,
    off_with: float,
    relieves: bool,
    odds: float,
    for_relief: bool | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search = searched(off(*[off_without] * 4, 0.0), off(*[off_with] * 4, 0.0))
    monkeypatch.setattr(verdict, "score", lambda _, ids, __: odds * len(ids))
    table = Standing((EFFECT, frozenset()), np.array([odds, 0.0]))
    assert pays(search, table, 95, EFFECT) == (for_relief is not None and (relieves or not for_relief))


@pytest.mark.parametrize(("tolerances_off", "gain", "named"), [(4.0, 3.1, True), (2.9, 3.1, False), (4.0, 2.9, False)])
def test_a_wheel_beyond_three_tolerances_is_a_mismatch_of_the_drive(
    tolerances_off: float, gain: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    sigma = 0.007
    quantity = Quantity(RADIUS_DIFFERENCE, "radius of the left over the right wheel", "1", sigma, sigma / 0.02)
    nothing, mismatch = frozenset[str](), frozenset({"drive-speed-mismatch"})

    def at(value: float) -> Any:
        column = SimpleNamespace(key=RADIUS_DIFFERENCE, term=None)
        return SimpleNamespace(
            columns=[column],
            point=SimpleNamespace(value=lambda _: 0.02 * value),
            posterior=SimpleNamespace(covariance=np.array([[1e-6]])),
        )

    fits = {nothing: at(tolerances_off), mismatch: at(0.1)}
    search = SimpleNamespace(
        fits=fits, terms={"drive-speed-mismatch": None}, problem=SimpleNamespace(open_ground=False)
    )
    monkeypatch.setattr(search_runs, "score", lambda _, ids, __: gain * len(ids))
    found = search_runs.name_what_is_off(search, nothing, [quantity], 95)  # type: ignore[arg-type]
    assert found == (mismatch if named else nothing)
    search.problem.open_ground = True  # on open ground what is left over moves such values
    assert search_runs.name_what_is_off(search, nothing, [quantity], 95) == nothing  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("key", "effect"),
    [
        ("green_x_mm", "mark-offset"),
        ("yellow_y_mm", "mark-offset"),
        ("center_of_gravity_x_mm", "mass-offset"),
        ("wheels.radius_mm", "drive-speed-scale"),
        (RADIUS_DIFFERENCE, "drive-speed-mismatch"),
        ("body.mass_g", None),
        (START, None),
    ],
)
def test_a_quantity_is_known_by_the_effect_that_does_the_same(key: str, effect: str | None) -> None:
    assert Knowledge(Quantity(key, "", "", 1.0, 1.0), 0.0, -1.0, 1.0).alike == effect
