"""Steps of the integrator as plain Python, in small worlds whose motion is known: their order, size and end."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.simulator.plain import plain

ROSENBROCK, CONTROL = plain("rosenbrock"), plain("step_control")
EULER, MANIFOLD = plain("implicit_euler"), plain("slow_manifold")
MODEL = SimpleNamespace(rest_speed=1e-4, mass=0.02, inertia=0.3, wheels=3, lag=0.0, varies=1, wheels_vary=1)
MODEL.wheel_x, MODEL.wheel_y = np.array([2.0, -2.0, 1.0]), np.array([1.5, 1.5, -1.0])
MODEL.grip_x = np.array([1.0, 1.0, 0.0])
World = Callable[..., Any]  # accelerations (3) at u, v, r, place and time


def worked(velocity: tuple[float, float, float]) -> Any:
    """What a step works on: a robot at (1, -2), heading 0.4."""
    shapes = {"linear": (8, 3), "bent": (8, 3), "block": (3, 3), "inverse": (3, 3), "stages": (6, 6), "end": (2, 6)}
    work = SimpleNamespace(**{name: np.zeros(shape) for name, shape in shapes.items()})
    work.pose, work.y, work.spare = np.array([1.0, -2.0, 0.4]), np.array([0.0, 0.0, 0.0, *velocity]), np.zeros((8, 6))
    work.inverses, work.segment, work.contacts = np.zeros((1, 3, 3)), np.zeros(9), None
    work.tried = 0.0
    return work


def lives_in(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the forces of a world be those of the robot; its drive is the time."""

    def accelerations(u: float, v: float, r: float, drive: Any, place: Any, *_: object) -> Any:
        return np.array(world(u, v, r, place, drive[0]), dtype=float)

    def slopes(u: float, v: float, r: float, drive: Any, place: Any, *rest: Any) -> None:
        linear, at, step = rest[-1], np.array([u, v, r]), 1e-6
        linear[0] = accelerations(u, v, r, drive, place)
        for k, change in enumerate(step * np.eye(3)):
            both = accelerations(*(at + change), drive, place) - accelerations(*(at - change), drive, place)
            linear[1:4, k] = both / (2 * step)

    for module in (ROSENBROCK, EULER, MANIFOLD):
        for name, value in (("accelerations", accelerations), ("slopes", slopes)):
            monkeypatch.setattr(module, name, value, raising=False)
        monkeypatch.setattr(module, "drive_at", lambda _, time, *__: (time, time), raising=False)


def true_end(world: World, work: Any, time: float, step: float) -> np.ndarray:
    """Pose and velocity after a step, by a method of its own."""

    def rates(t: float, state: np.ndarray) -> list[float]:
        (x, y, heading), (u, v, r) = state[:3], state[3:]
        cos, sin = np.cos(heading), np.sin(heading)
        return [u * cos - v * sin, u * sin + v * cos, r, *world(u, v, r, (x, y, cos, sin, t), t)]

    start = [*work.pose, *work.y[3:]]
    return np.asarray(solve_ivp(rates, (time, time + step), start, rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1])


def windy(u: float, v: float, r: float, place: Any, time: float) -> Any:
    """Drag that is not linear, a wind that turns with the heading, a slope of the ground, motors that speed up."""
    x, y, cos, sin, _ = place
    return (
        3 * time - 2 * u - 0.3 * u * abs(u) + r * v + 2 * cos - 0.4 * x,
        -5 * v - r * u - 2 * sin + 0.3 * y,
        0.7 * u - 4 * r + 1.5 * v + 0.5 * x * sin,
    )


def test_a_step_in_a_world_of_place_heading_and_time_is_of_order_four_and_knows_its_error_to_order_three(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lives_in(windy, monkeypatch)
    errors, stated = [], []
    for step in (0.08, 0.04):
        work = worked((1.5, -0.6, 1.1))
        ROSENBROCK.linearize(0.3, True, MODEL, work)
        assert ROSENBROCK.attempt(0.3, step, MODEL, work)
        end = np.array([*ROSENBROCK.moved(work.pose, *work.end[0, :3]), *work.end[0, 3:]])
        errors.append(np.abs(end - true_end(windy, work, 0.3, step)).max())
        stated.append(np.abs(work.end[1]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5.0, abs=0.5)
    assert np.log2(stated[0] / stated[1]) == pytest.approx(4.0, abs=0.5)
    assert errors[1] < 0.3 * stated[1]


def test_derivatives_by_place_and_time_are_those_of_the_world_and_none_where_nothing_varies(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lives_in(windy, monkeypatch)
    work = worked((1.5, -0.6, 1.1))
    ROSENBROCK.linearize(0.3, True, MODEL, work)
    cos, sin = np.cos(0.4), np.sin(0.4)
    ahead, aside = np.array([cos, sin]), np.array([-sin, cos])  # of the body, in the plate frame
    by_place = np.array([[-0.4, 0.0], [0.0, 0.3], [0.5 * sin, 0.0]])
    np.testing.assert_allclose(work.linear[4:7, 0], by_place @ ahead, atol=1e-5)
    np.testing.assert_allclose(work.linear[4:7, 1], by_place @ aside, atol=1e-5)
    np.testing.assert_allclose(work.linear[4:7, 2], [-2 * sin, -2 * cos, 0.5 * cos], atol=1e-5)
    np.testing.assert_allclose(work.linear[7], [3.0, 0.0, 0.0], atol=1e-5)
    work.linear[4:] = 7.0
    ROSENBROCK.linearize(0.3, False, MODEL, work)
    assert not work.linear[4:7].any()
    still = SimpleNamespace(**vars(MODEL) | {"varies": 0})
    assert ROSENBROCK.place_after(work.pose, 1.0, 2.0, 3.0, 0.3, still) == (0.0, 0.0, 1.0, 0.0, 0.3)


K = np.array([[30.0, 4.0, -2.0], [1.0, 50.0, 6.0], [0.5, -3.0, 20.0]])
DRIVEN = np.array([2.0, -1.0, 3.0])


def rolling(u: float, v: float, r: float, _place: Any, _time: float) -> Any:
    """Forces in proportion to the velocity's distance from a steady one."""
    return DRIVEN - K @ [u, v, r]


def test_implicit_steps_of_a_linear_world_are_its_resolvents_and_differ_by_that_of_the_whole_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lives_in(rolling, monkeypatch)
    work, step = worked((1.5, -0.6, 1.1)), 0.05
    assert EULER.euler_pair(0.3, step, MODEL, work)

    def after(velocity: np.ndarray, h: float) -> np.ndarray:
        return np.linalg.solve(np.eye(3) + h * K, velocity + h * DRIVEN)

    start = work.y[3:]
    half = after(start, step / 2)
    end = after(half, step / 2)
    np.testing.assert_allclose(work.end[0, 3:], end, rtol=1e-9)
    np.testing.assert_allclose(work.end[0, :3], step / 4 * (start + 2 * half + end), rtol=1e-9)
    np.testing.assert_allclose(work.end[1, 3:], end - after(start, step), rtol=1e-8)
    assert not work.end[1, :3].any()


def test_newtons_method_needs_one_step_in_a_linear_world_and_gives_up_where_it_is_singular(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lives_in(rolling, monkeypatch)
    work, step, residual, change = worked((1.5, -0.6, 1.1)), 0.05, np.zeros(3), np.zeros(3)
    guess = np.array([0.0, 0.0, 0.0, 3.0, 2.0, -1.0])
    places, place_after = list[Any](), EULER.place_after
    monkeypatch.setattr(EULER, "place_after", lambda *said: places.append(said[1:5]) or place_after(*said))  # type: ignore[func-returns-value]
    size = EULER.excess(0.3, step, work.y, guess, MODEL, work, residual)
    assert work.tried == 1.0
    assert places == [(*(step / 2 * (work.y[3:6] + guess[3:])), 0.35)]  # the mean of both velocities on
    assert size == pytest.approx(np.linalg.norm(residual * [1.0, 1.0, 2.0]))  # a lever of 2 mm
    assert EULER.newton_change(step, residual, work, change)
    end = np.linalg.solve(np.eye(3) + step * K, work.y[3:] + step * DRIVEN)
    np.testing.assert_allclose(guess[3:] + change, end, rtol=1e-7)
    work.bent[1:4] = np.eye(3) / step
    assert not EULER.newton_change(step, residual, work, change)


def test_implicit_steps_take_the_drive_at_their_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    lives_in(lambda *said: (7.0 * said[4], 0.0, -said[3][4]), monkeypatch)
    work = worked((0.0, 0.0, 0.0))
    assert EULER.euler_pair(1.0, 0.1, MODEL, work)
    assert work.end[0, 3] == pytest.approx(0.05 * 7 * (1.05 + 1.1))
    assert work.end[0, 5] == pytest.approx(-0.05 * (1.05 + 1.1))


@pytest.mark.parametrize("force", [0.5, 1.5])
def test_a_robot_sticks_below_the_friction_that_a_bend_of_nanometres_holds_and_moves_beyond(
    force: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Friction of 1, reached within 1e-7 mm/s: after a second it stands, or has what is left of the force."""

    def sliding(u: float, v: float, r: float, *_: object) -> Any:
        return force - np.tanh(u / 1e-7), -v, -r

    lives_in(sliding, monkeypatch)
    for start in (0.3, -0.3):
        work, out = worked((start, 0.0, 0.0)), np.array([0.0, 0.0, 0.0, start, 0.0, 0.0])
        assert EULER.euler(0.0, 1.0, work.y, MODEL, work, out)
        expected = start + force - 1 if start + force > 1 else 0.0
        assert out[3] == pytest.approx(expected, abs=1e-6)
        assert out[0] == pytest.approx((start + out[3]) / 2)


def stepping(monkeypatch: pytest.MonkeyPatch, name: str, taken: list[bool], norms: list[float]) -> list[float]:
    """Steps whose success and errors are given in turn; returns the sizes tried."""
    sizes: list[float] = []

    def step(_time: float, size: float, *_: object) -> bool:
        sizes.append(size)
        return taken[min(len(sizes), len(taken)) - 1]

    monkeypatch.setattr(CONTROL, name, step)
    monkeypatch.setattr(CONTROL, "error_norm", lambda *_: norms[min(len(sizes), len(norms)) - 1])
    return sizes


@pytest.mark.parametrize(
    ("kind", "name", "power", "least", "most"),
    [("smooth_step", "attempt", 0.25, 0.15, 6.0), ("sticking_step", "euler_pair", 0.5, 0.2, 4.0)],
)
def test_a_step_is_tried_again_by_the_root_of_its_error_and_grows_by_it(
    kind: str, name: str, power: float, least: float, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    take, fast = getattr(CONTROL, kind), worked((5.0, 0.0, 0.0))

    def sizes(taken: list[bool], norms: list[float]) -> tuple[list[float], Any]:
        tried = stepping(monkeypatch, name, taken, norms)
        found = take(0.0, 1.0, 1e-6, MODEL, fast)
        return tried, found

    for norm in (1.0, 0.5, 1e-9):
        tried, found = sizes([True], [norm])
        assert tried == [1.0]
        assert found == pytest.approx((1.0, min(0.9 * norm**-power, most)), rel=1e-3)
    tried, (step, wanted) = sizes([True], [5.0, 1.02, 1e9, 0.2])
    shrunk = [1.0, 0.9 * 5.0**-power, 0.7 * 0.9 * 5.0**-power, least * 0.7 * 0.9 * 5.0**-power]
    assert tried == pytest.approx(shrunk)
    assert (step, wanted) == pytest.approx((shrunk[-1], shrunk[-1] * min(0.9 * 0.2**-power, most)))
    assert sizes([False, False, True], [0.5])[0] == pytest.approx([1.0, least, least**2])


def test_a_smooth_step_gives_up_after_four_tries_or_below_two_microseconds_but_not_at_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried = stepping(monkeypatch, "attempt", [True], [3.0])
    assert CONTROL.smooth_step(0.0, 1.0, 1e-6, MODEL, worked((5.0, 0.0, 0.0))) == (0.0, 0.0)
    assert len(tried) == 4
    tried = stepping(monkeypatch, "attempt", [True], [3.0])
    assert CONTROL.smooth_step(0.0, 4e-6, 1e-6, MODEL, worked((5.0, 0.0, 0.0))) == (0.0, 0.0)
    assert len(tried) == 2  # 2.7e-6 and 1.9e-6
    tried = stepping(monkeypatch, "attempt", [True], [3.0])
    assert CONTROL.smooth_step(0.0, 4e-6, 1e-6, MODEL, worked((0.0, 0.0, 0.0))) == (0.0, 0.0)
    assert len(tried) == 60


def test_a_sticking_step_follows_where_no_smooth_one_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def kind(name: str, tried: float) -> Callable[..., tuple[float, float]]:
        return lambda _time, step, *_: asked.append((name, step)) or (tried, 2 * tried)

    def short(smooth: float, step: float, *, sticking: bool = False) -> Any:
        asked.clear()
        monkeypatch.setattr(CONTROL, "smooth_step", kind("smooth", smooth))
        monkeypatch.setattr(CONTROL, "sticking_step", kind("sticking", 0.3))
        work.stages[:] = 1.0
        return CONTROL.short_step(0.0, step, 0.5, 1e-6, sticking, MODEL, work)

    work = worked((5.0, 0.0, 0.0))
    assert short(0.2, 0.7) == (0.2, 0.4)
    assert asked == [("smooth", 0.5)]  # what remains
    assert work.stages.all()
    assert short(0.0, 1e-7) == (0.3, 0.6)
    assert asked == [("smooth", 1e-7), ("sticking", pytest.approx(2e-6))]
    assert not work.stages.any()
    assert short(0.2, 0.4, sticking=True) == (0.3, 0.6)
    assert asked == [("sticking", 0.4)]


def test_the_end_of_a_relaxation_is_the_steady_velocity_and_the_way_that_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The rest of it is the integral of exp(-K·t)·(velocity - steady): K⁻¹ times what is left."""
    lives_in(rolling, monkeypatch)
    steady = np.linalg.solve(K, DRIVEN)
    left = np.array([2e-5, -1e-5, 3e-6])
    work = worked(tuple(steady + left))
    work.linear[0], work.linear[1:4] = -K @ left, -K
    assert MANIFOLD.near_manifold(1e-6, False, MODEL, work)
    assert MANIFOLD.settle(0.3, MODEL, work)
    np.testing.assert_allclose(work.y[3:], steady, rtol=1e-10)
    np.testing.assert_allclose(work.y[:3], np.linalg.solve(K, left), rtol=1e-5)
    far = worked(tuple(steady + left))
    far.linear[0], far.linear[1:4] = -K @ left, -K
    assert not MANIFOLD.near_manifold(1e-7, False, MODEL, far)  # 7e-7 mm are left of the way
    far.linear[1:4] = K
    assert not MANIFOLD.near_manifold(1.0, False, MODEL, far)  # not stable


def test_a_world_whose_forces_bend_on_the_way_is_not_settled(monkeypatch: pytest.MonkeyPatch) -> None:
    lives_in(lambda *_: np.array([1.0, 0.0, 0.0]), monkeypatch)  # no balance anywhere
    work = worked((0.1, 0.0, 0.0))
    work.linear[0], work.inverse[:] = [1.0, 0.0, 0.0], -0.01 * np.eye(3)
    assert not MANIFOLD.settle(0.0, MODEL, work)


def test_what_is_left_to_go_allows_for_motors_that_still_change(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(MANIFOLD, "close", lambda to_go, *_: bool(asked.append(np.array(to_go[:3]))) or True)
    work = worked((1.0, 0.0, 0.0))
    work.linear[0], work.linear[1:4], work.linear[7] = [0.3, -0.2, 0.1], -K, [5.0, 6.0, -7.0]
    assert MANIFOLD.near_manifold(1e-6, False, MODEL, work)
    by_velocity = np.linalg.inv(-K)
    np.testing.assert_allclose(asked[0], by_velocity @ (work.linear[0] + by_velocity @ work.linear[7]))
