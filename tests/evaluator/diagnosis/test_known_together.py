"""Values known to a tolerance, each plausible, may be off together by more than chance; and an effect may be one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from evaluator.diagnosis import search_runs
from evaluator.diagnosis.assessment.knowledge import Knowledge, together
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


def test_several_values_two_tolerances_off_are_a_finding_and_one_is_not() -> None:
    covariance = 1e-3 * np.diag(SIGMAS**2)
    off = together(fit(2.1 * SIGMAS * [1, -1, 1, 1, 0], covariance), TOLERANCE)
    assert off.square == pytest.approx(4 * 2.1**2, rel=2e-3)
    assert off.is_finding
    said = off.sentence([Quantity("plane_scale", "millimetres of the plate", "1", 1e-3, 1.0)])
    assert "more, taken together, than chance allows (probability 0.001" in said
    assert "millimetres of the plate +2.1" in said
    assert not together(fit(2.1 * SIGMAS * [1, 0, 0, 0, 9], covariance), TOLERANCE).is_finding


@pytest.mark.parametrize(("tolerances_off", "gain", "named"), [(4.0, 6.1, True), (2.9, 6.1, False), (4.0, 5.9, False)])
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
