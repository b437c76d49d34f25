"""Where forces balance, and how those on the body alone vary, as plain Python in small worlds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.simulator.plain import plain
from tests.simulator.test_integrator_steps import MODEL, World, lives_in, windy, worked

ROSENBROCK, BALANCE = plain("rosenbrock"), plain("balance")


def test_where_no_friction_varies_derivatives_are_those_of_the_forces_on_the_body(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of steady motors, whose drive adds nothing to the change in time."""

    def on_body(u: float, v: float, r: float, place: Any, *_: object) -> Any:
        return windy(u, v, r, place, place[4])

    lives_in(windy, monkeypatch)
    monkeypatch.setattr(ROSENBROCK, "body_forces", on_body)
    monkeypatch.setattr(ROSENBROCK, "accelerated", lambda x, y, yaw, _model: (x, y, 2.0 * yaw))
    by_all, by_body = worked((1.5, -0.6, 1.1)), worked((1.5, -0.6, 1.1))
    by_all.linear[7] = by_body.linear[7] = 9.0
    by_body.segment[2] = 1.0
    ROSENBROCK.linearize(0.3, True, MODEL, by_all)
    ROSENBROCK.linearize(0.3, True, SimpleNamespace(**vars(MODEL) | {"wheels_vary": 0}), by_body)
    np.testing.assert_allclose(by_body.linear[4:7], by_all.linear[4:7] * [[1.0], [1.0], [2.0]], atol=1e-5)
    np.testing.assert_allclose(by_body.linear[7], by_all.linear[7] * [1.0, 1.0, 2.0], atol=1e-5)
    ROSENBROCK.linearize(0.3, False, SimpleNamespace(**vars(MODEL) | {"wheels_vary": 0}), by_body)
    assert not by_body.linear[4:].any()


def test_newtons_method_finds_where_forces_balance_or_says_that_there_is_no_such_velocity(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Friction that bends within 0.05 mm/s, from where a whole step of Newton's leads far beyond it."""
    model = SimpleNamespace(**vars(MODEL) | {"speed": np.array([0.05, 0.05])})
    work = worked((0.0, 0.0, 0.0))
    work.contacts = np.zeros((40, 3))
    monkeypatch.setattr(BALANCE, "new_work", lambda _model: [work])

    def bends(u: float, v: float, r: float, _place: Any, left: float) -> Any:
        return 0.5 * left - 2 * np.tanh((u - 0.3) / 0.05), 0.2 - np.tanh((v + r) / 0.05), r - 3 * v - 0.1

    def balance(world: World, left: float, start: tuple[float, float, float]) -> tuple[bool, np.ndarray]:
        lives_in(world, monkeypatch)
        for name in ("accelerations", "slopes"):
            monkeypatch.setattr(BALANCE, name, getattr(ROSENBROCK, name))
        velocity, linear = np.array(start), np.zeros((4, 3))
        return BALANCE.newton(model, left, 7.0, velocity, linear), velocity

    found, velocity = balance(bends, 2.0, (0.38, 0.04, 0.0))
    assert found
    assert velocity[0] == pytest.approx(0.3 + 0.05 * np.arctanh(0.5))
    aside = 0.05 * np.arctanh(0.2)
    assert velocity[1:] == pytest.approx([(aside - 0.1) / 4, aside - (aside - 0.1) / 4])
    assert not balance(bends, 5.0, (0.38, 0.04, 0.0))[0]  # pushed harder than friction holds
    assert not balance(lambda *_: (1.0, 0.0, 0.0), 2.0, (0.1, 0.0, 0.0))[0]
    size = BALANCE.unbalance(model, 2.0, 7.0, np.array([0.1, 0.2, 0.3]), out := np.zeros(3))
    assert out.tolist() == [1.0, 0.0, 0.0]
    assert size == 1.0
