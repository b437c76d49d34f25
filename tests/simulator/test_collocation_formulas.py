"""Polynomials of a collocation step, in closed form; uncompiled, for nothing here is worth a compilation."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from simulator.integrator import collocation as module
from simulator.integrator.collocation import POINTS, POWERS, SHARES, TO_POWERS, X_RATE, Y_RATE, U, X

AT = 2.0 * np.asarray(SHARES) - 1.0  # places of the points within a step, from -1 at its start to 1 at its end
TIME, LENGTH = 3.0, 0.5
TIMES = np.array([2.9, 3.0, 3.1, 3.35, 3.5, 3.6])
INSIDE = (1, 5)


def uncompiled(kernel: Any) -> Any:
    return getattr(kernel, "py_func", kernel)


def table() -> np.ndarray:
    return np.zeros((max(POWERS + 3, U + 3, X + 3, X_RATE + 1, Y_RATE + 1), POINTS))


def test_points_run_from_start_to_end_of_a_step() -> None:
    assert (AT[0], AT[-1]) == (-1.0, 1.0)
    assert (np.diff(AT) > 0).all()


def test_values_at_the_points_become_the_coefficients_of_their_polynomial() -> None:
    coefficients = np.arange(1.0, POINTS + 1) * (-1.0) ** np.arange(POINTS)
    values = np.polynomial.polynomial.polyval(AT, coefficients)
    np.testing.assert_allclose(values @ np.asarray(TO_POWERS), coefficients, rtol=1e-9)


def test_values_at_the_points_become_their_integral_from_the_start_and_their_derivative() -> None:
    line = np.polynomial.Polynomial(np.linspace(-1.0, 2.0, POINTS - 1))
    np.testing.assert_allclose(line(AT) @ module.INTEGRAL, line.integ()(AT) - line.integ()(-1.0), atol=1e-12)
    np.testing.assert_allclose(line(AT) @ module.DERIVATIVE, line.deriv()(AT), atol=1e-9)


def test_outputs_within_a_step_are_those_of_its_polynomial() -> None:
    coefficients, out, filled = np.linspace(-1.0, 2.0, POINTS), np.full((len(TIMES), 6), np.nan), table()
    filled[POWERS + 1] = coefficients
    uncompiled(module._write)(out, 4, TIMES, INSIDE, TIME, LENGTH, filled, POWERS + 1)
    at = 2 * (TIMES[1:5] - TIME) / LENGTH - 1
    np.testing.assert_allclose(out[1:5, 4], np.polynomial.polynomial.polyval(at, coefficients))
    assert np.isnan(out[[0, 5], 4]).all()


def test_places_within_a_step_are_the_integral_of_the_rate_from_where_it_began() -> None:
    coefficients, out, filled = np.linspace(-1.0, 2.0, POINTS), np.full((len(TIMES), 6), np.nan), table()
    filled[POWERS], filled[X + 1, 0] = coefficients, 7.0
    uncompiled(module._write_integral)(out, 1, TIMES, INSIDE, TIME, LENGTH, filled, POWERS)
    whole = np.polynomial.Polynomial(coefficients).integ() * (LENGTH / 2)
    at = 2 * (TIMES[1:5] - TIME) / LENGTH - 1
    np.testing.assert_allclose(out[1:5, 1], 7.0 + whole(at) - whole(-1.0))
    assert out[1, 1] == pytest.approx(7.0)


@pytest.mark.parametrize("row", [X_RATE, Y_RATE, U + 2])
@pytest.mark.parametrize(
    ("power", "share"),
    [(POINTS - 1, 2.0 ** -(POINTS - 2)), (POINTS - 2, 0.1 * 2.0 ** -(POINTS - 3)), (POINTS - 3, 0.0)],
)
def test_what_a_rate_lacks_is_its_last_coefficient_of_chebyshev_or_a_tenth_of_the_one_before(
    row: int, power: int, share: float
) -> None:
    filled = table()
    filled[row] = -3.0 * AT**power
    lever = module.LEVER_MM if row == U + 2 else 1.0
    assert uncompiled(module.cut_off)(LENGTH, filled) == pytest.approx(3.0 * share * lever * LENGTH, abs=1e-9)


def test_a_path_begins_where_the_relaxation_ends_and_is_the_integral_of_its_velocity() -> None:
    """Left after the twist A⁻¹ (velocity at the first point - velocity at the start); from there an arc."""
    u, v, r, twist = 3.0, -0.5, 0.8, np.array([[0.1, 0.02, -0.03], [0.04, 0.2, 0.05], [-0.06, 0.01, 0.3]])
    y, pose, filled = np.array([0.0, 0.0, 0.0, 2.6, -0.4, 0.3]), np.array([5.0, -2.0, 0.7]), table()
    filled[[U, U + 1, U + 2]] = np.array([[u], [v], [r]])
    work: Any = SimpleNamespace(table=filled, y=y, inverse=twist, pose=pose)
    uncompiled(module.follow)(LENGTH, work)
    ahead, left, angle = twist @ ([u, v, r] - y[3:])
    moved = expm(np.array([[0.0, -angle, ahead], [angle, 0.0, left], [0.0, 0.0, 0.0]]))
    turned = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    start, heading = pose[:2] + turned @ moved[:2, 2], 0.7 + angle + r * LENGTH * np.asarray(SHARES)
    np.testing.assert_allclose(filled[module.HEADING], heading, atol=1e-12)
    back = np.array([[u, v], [-v, u]]) @ np.stack([np.sin(heading), np.cos(heading)]) / r  # ∫ R(heading) (u, v) dt
    np.testing.assert_allclose(
        filled[[X, X + 1]], start[:, None] + back * [[1], [-1]] - (back * [[1], [-1]])[:, :1], atol=1e-9
    )


def test_a_run_goes_on_from_the_last_point_of_its_step() -> None:
    filled = table()
    filled[[X, X + 1, X + 2]], filled[[U, U + 1, U + 2]] = np.arange(POINTS), np.arange(POINTS) + 100.0
    work = SimpleNamespace(table=filled, pose=np.zeros(3), y=np.ones(6))
    uncompiled(module.go_to_end)(work)
    assert work.pose.tolist() == [POINTS - 1.0] * 3
    assert work.y.tolist() == [0.0] * 3 + [POINTS + 99.0] * 3
