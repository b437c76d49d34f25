"""Loads of the wheels: closed forms of statics, and wheels that lift off."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.dynamics.statics import Rectangle, _stiff, wheel_loads
from simulator.errors import SimulationError

WEIGHT = 4900.0


def loads(places: list[tuple[float, float]], gravity: tuple[float, float], attraction: float = 0.0) -> np.ndarray:
    at = np.array(places)
    return wheel_loads("robot", at, WEIGHT, gravity, np.full(len(at), attraction), Rectangle.of(at))[1]


def test_three_supports_carry_by_their_levers() -> None:
    # Moments about the axle: the ball 3 mm behind it carries x/3 of the weight; about the x axis: left over right.
    found = loads([(0.0, 2.0), (0.0, -2.0), (-3.0, 0.0)], (-0.9, 0.5))
    ball = WEIGHT * 0.9 / 3
    assert found == pytest.approx(
        [(WEIGHT - ball) / 2 + WEIGHT * 0.5 / 4, (WEIGHT - ball) / 2 - WEIGHT * 0.5 / 4, ball]
    )


def test_six_supports_are_equally_stiff() -> None:
    # A rigid body on equal springs sinks as a plane: share = W·(1/6 + x·gx/Σx² + y·gy/Σy²).
    places = [(x, y) for x in (2.0, 0.0, -2.0) for y in (2.0, -2.0)]
    expected = [WEIGHT * (1 / 6 + x * 0.5 / 16 + y * 0.2 / 24) for x, y in places]
    assert loads(places, (0.5, 0.2)) == pytest.approx(expected)


def test_four_supports_on_a_rectangle_share_axle_by_axle() -> None:
    places = [(5.0, 2.0), (5.0, -2.0), (1.0, 2.0), (1.0, -2.0)]  # middle at (3, 0)
    expected = [WEIGHT / 4 * (1 + np.sign(x - 3) * 0.5) * (1 + np.sign(y) * 0.2) for x, y in places]
    assert loads(places, (4.0, 0.4)) == pytest.approx(expected)


def test_a_support_that_would_pull_lifts_off_and_the_others_carry_all() -> None:
    # With the centre of gravity over the rear axle's side, the far support in front would have to pull.
    corners = [(2.0, 2.0), (2.0, -2.0), (-2.0, 2.0), (-2.0, -2.0)]
    found = loads([*corners, (6.0, 0.0)], (-1.6, 0.0))
    assert found[4] == 0.0
    assert found[:4] == pytest.approx([WEIGHT / 4 * (1 - x * 1.6 / 4) for x, _ in corners])
    assert loads([*corners, (6.0, 0.0)], (0.5, 0.0))[4] > 0.0


def test_supports_carry_what_their_plane_sinks_at_their_places() -> None:
    """By this plane a support that has lifted off is known to press again."""
    places, gravity = np.array([(5.0, 2.0), (4.0, -3.0), (-1.0, 2.5), (-2.0, 1.0)]), np.array([1.2, 0.4])
    share, plane = _stiff(places, WEIGHT, tuple(gravity))
    assert share is not None
    assert share.sum() == pytest.approx(WEIGHT)
    assert np.column_stack([np.ones(4), places - gravity]) @ plane == pytest.approx(share)


def test_attraction_holds_a_robot_that_would_tip_over() -> None:
    places = [(0.0, 2.0), (0.0, -2.0), (-3.0, 0.0)]
    held = loads(places, (0.6, 0.0), attraction=2000.0)
    assert held == pytest.approx([WEIGHT * 1.2 / 2 + 2000, WEIGHT * 1.2 / 2 + 2000, 2000 - WEIGHT * 0.2])
    with pytest.raises(SimulationError, match=r"centre of gravity at \(0.6, 0\) mm is outside the wheels"):
        loads(places, (0.6, 0.0), attraction=0.1 * WEIGHT)


def test_wheels_on_one_line_carry_what_stands_on_the_line() -> None:
    assert loads([(0.0, 2.0), (0.0, -2.0)], (0.0, 1.0)) == pytest.approx([0.75 * WEIGHT, 0.25 * WEIGHT])
    with pytest.raises(SimulationError, match="outside"):
        loads([(0.0, 2.0), (0.0, -2.0)], (0.1, 0.0))


@given(
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=3, max_size=8, unique=True),
    st.lists(st.floats(0.05, 1.0), min_size=8, max_size=8),
)
def test_loads_balance_the_weight_and_never_pull(places: list[tuple[float, float]], weights: list[float]) -> None:
    at, share = np.array(places), np.array(weights[: len(places)])
    gravity = tuple((share @ at / share.sum()).tolist())  # within the supports
    found = loads(places, gravity)
    assert (found >= 0).all()
    assert found.sum() == pytest.approx(WEIGHT, rel=1e-6)
    assert np.allclose(found @ (at - gravity), 0, atol=1e-5 * WEIGHT)
