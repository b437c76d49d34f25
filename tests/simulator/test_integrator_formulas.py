"""The parts of the integrator as plain Python: order conditions, motions of the plane, roots, steps and stops."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from tests.simulator.plain import plain

ROSENBROCK, STABILITY = plain("rosenbrock"), plain("stability")
CONTROL, EULER, MANIFOLD = plain("step_control"), plain("implicit_euler"), plain("slow_manifold")


def coefficients() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """alpha and beta = alpha + Gamma of the method as it is printed, and its weights, from the transformed tables."""
    a, c = (np.column_stack([table, np.zeros(6)]) for table in (ROSENBROCK.A, ROSENBROCK.C))
    gamma = np.linalg.inv(np.eye(6) / ROSENBROCK.GAMMA - c)
    weights = (a[5] + np.eye(6)[5]) @ gamma  # the last stage is added to its own argument
    return a @ gamma, a @ gamma + gamma, weights


def test_method_has_order_four_and_is_stiffly_accurate() -> None:
    alpha, beta, b = coefficients()
    nodes, row = alpha.sum(axis=1), beta.sum(axis=1)
    assert nodes == pytest.approx(ROSENBROCK.NODES, abs=1e-12)
    assert (beta - alpha).sum(axis=1) == pytest.approx(ROSENBROCK.D, abs=1e-12)
    conditions = {
        "1": (b.sum(), 1),
        "2": (b @ row, 1 / 2),
        "3a": (b @ nodes**2, 1 / 3),
        "3b": (b @ beta @ row, 1 / 6),
        "4a": (b @ nodes**3, 1 / 4),
        "4b": (b @ (nodes * (alpha @ row)), 1 / 8),
        "4c": (b @ beta @ nodes**2, 1 / 12),
        "4d": (b @ beta @ beta @ row, 1 / 24),
    }
    for name, (found, wanted) in conditions.items():
        assert found == pytest.approx(wanted, abs=1e-12), name
    assert b == pytest.approx(beta[5], abs=1e-12)  # so that infinitely stiff parts are gone after a step
    assert 1 - b @ np.linalg.solve(beta, np.ones(6)) == pytest.approx(0.0, abs=1e-12)


def taken(step: float) -> Any:
    """A step of y' = -2·t·y² from 1 at time 0.3, by the tables, as the kernels keep it."""
    y, t = 1.0, 0.3
    by_y, by_t, stages = -4 * t * y, -2 * y * y, np.zeros((6, 6))
    for stage in range(6):
        reached = y + ROSENBROCK.A[stage, :stage] @ stages[:stage, 0]
        memory = ROSENBROCK.C[stage, :stage] @ stages[:stage, 0] / step
        rate = -2 * (t + ROSENBROCK.NODES[stage] * step) * reached**2
        right = rate + memory + step * ROSENBROCK.D[stage] * by_t
        stages[stage, 0] = right / (1 / (ROSENBROCK.GAMMA * step) - by_y)
    end = np.zeros((2, 6))
    end[0, 0] = reached + stages[5, 0]
    return SimpleNamespace(y=np.array([y, 0, 0, 0, 0, 0]), end=end, stages=stages)


@pytest.mark.parametrize(("share", "power"), [(0.7, 4), (0.9, 4), (1.0, 5)])
def test_end_of_a_step_errs_with_its_fifth_power_and_the_course_within_it_with_the_fourth(
    share: float, power: int
) -> None:
    errors = []
    for step in (0.02, 0.01):
        work, out = taken(step), np.zeros(6)
        ROSENBROCK.between(share, work, out)
        errors.append(abs(out[0] - 1 / (0.91 + (0.3 + share * step) ** 2)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(power, abs=0.4)


def generator(x: float, y: float, angle: float) -> np.ndarray:
    return np.array([[0.0, -angle, x], [angle, 0.0, y], [0.0, 0.0, 0.0]])


def matrix(pose: tuple[float, float, float]) -> np.ndarray:
    x, y, heading = pose
    return np.array([[np.cos(heading), -np.sin(heading), x], [np.sin(heading), np.cos(heading), y], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("angle", [1.3, -0.4, 2e-4, 5e-5, 0.0])
def test_pose_after_a_twist_is_the_exponential_of_it(angle: float) -> None:
    pose = (2.0, -1.0, 0.7)
    found = ROSENBROCK.moved(pose, 0.8, -0.5, angle)
    np.testing.assert_allclose(matrix(found), matrix(pose) @ expm(generator(0.8, -0.5, angle)), atol=1e-12)
    assert found[2] == pytest.approx(0.7 + angle)


@pytest.mark.parametrize("angle", [0.9, -0.6, 1e-3])
def test_twist_grows_so_that_the_pose_moves_with_the_velocity(angle: float) -> None:
    twist, velocity, step = np.array([0.4, -0.7, angle]), np.array([1.5, 0.3, -0.8]), 1e-5
    rate = np.array([*ROSENBROCK.twisting(*twist, *velocity), velocity[2]])
    ahead, behind = (matrix(ROSENBROCK.moved((0.0, 0.0, 0.0), *(twist + way * step * rate))) for way in (1, -1))
    slope = np.linalg.inv(matrix(ROSENBROCK.moved((0.0, 0.0, 0.0), *twist))) @ (ahead - behind) / (2 * step)
    np.testing.assert_allclose(slope, generator(*velocity), atol=2e-6)


def test_inverse_of_three_by_three_and_of_the_twists_part_of_a_stage() -> None:
    rng = np.random.default_rng(0)
    a, out = rng.normal(size=(3, 3)), np.zeros((3, 3))
    assert ROSENBROCK.invert3(a, out)
    np.testing.assert_allclose(out, np.linalg.inv(a), rtol=1e-10)
    assert not ROSENBROCK.invert3(np.ones((3, 3)), out)
    y, diagonal = np.array([0.0, 0.0, 0.0, 1.5, -0.4, 0.9]), 3.0
    block = np.array([[3.0, -0.45, -0.2], [0.45, 3.0, -0.75], [0.0, 0.0, 3.0]])
    vector = np.array([0.3, -1.1, 0.6])
    assert block @ ROSENBROCK.untwist(diagonal, y, *vector) == pytest.approx(vector)


@pytest.mark.parametrize("varies", [False, True])
def test_velocity_block_of_a_stage_has_the_twist_eliminated(varies: bool) -> None:
    rng = np.random.default_rng(1)
    y, linear, step = np.array([0.0, 0.0, 0.0, 1.5, -0.4, 0.9]), rng.normal(size=(8, 3)), 0.02
    work = SimpleNamespace(y=y, linear=linear, block=np.zeros((3, 3)), inverse=np.zeros((3, 3)))
    assert ROSENBROCK.factorize(step, varies, work)
    diagonal = 1 / (0.25 * step)
    twist = np.array([[diagonal, -0.45, -0.2], [0.45, diagonal, -0.75], [0.0, 0.0, diagonal]])
    block = diagonal * np.eye(3) - linear[1:4] - (linear[4:7] @ np.linalg.inv(twist) if varies else 0.0)
    np.testing.assert_allclose(work.inverse, np.linalg.inv(block), rtol=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_stability_and_growth_are_those_of_the_eigenvalues(seed: int) -> None:
    rng = np.random.default_rng(seed)
    work = np.vstack([np.zeros(3), rng.normal(size=(3, 3)) - rng.uniform(-0.5, 2.5) * np.eye(3)])
    values = np.linalg.eigvals(work[1:4])
    assert STABILITY.characteristic(work) == pytest.approx(np.poly(work[1:4])[1:])
    assert STABILITY.is_stable(work) == (values.real.max() < 0)
    growing = [value.real for value in values if abs(value.imag) < 1e-12 and value.real > 0]
    assert STABILITY.growth_rate(work) == pytest.approx(max(growing, default=0.0), rel=2e-3)


def test_first_step_moves_a_robot_by_a_hundred_tolerances() -> None:
    linear = np.zeros((8, 3))
    linear[0] = [3.0, 4.0, 0.0]
    assert 5 * CONTROL.first_step(linear, 1e-6) ** 2 / 2 == pytest.approx(1e-4)
    linear[0] = [0.0, 0.0, 0.5]  # rad/s² at a lever of 10 mm
    assert 5 * CONTROL.first_step(linear, 1e-6) ** 2 / 2 == pytest.approx(1e-4)
    linear[0], linear[7] = 0.0, [0.0, 3.0, 0.4]
    assert 5 * CONTROL.first_step(linear, 1e-6) ** 3 / 6 == pytest.approx(1e-4)


@pytest.mark.parametrize(("tolerance", "share"), [(1e-4, 1.0), (1e-6, 1.0), (1.6e-9, 0.2), (1e-10, 0.1)])
def test_shortest_steps_shrink_with_the_fourth_root_of_a_tolerance_below_the_usual(
    tolerance: float, share: float
) -> None:
    assert CONTROL.shrinking(tolerance) == pytest.approx(share)


MODEL = SimpleNamespace(rest_speed=1e-4, mass=0.02, inertia=0.3, wheels=3)
MODEL.wheel_x, MODEL.wheel_y = np.array([2.0, -2.0, 1.0]), np.array([1.5, 1.5, -1.0])
MODEL.grip_x = np.array([1.0, 1.0, 0.0])


def stepped(velocity: float, **errors: float) -> Any:
    """A step along x at a velocity, with errors of x, angle, u; forces that make up for an error within 0.1 s."""
    end = np.zeros((2, 6))
    end[0, 3] = velocity
    for name, value in errors.items():
        end[1, ["x", "y", "angle", "u", "v", "r"].index(name)] = value
    y = np.zeros(6)
    y[3] = velocity
    linear = np.vstack([np.zeros(3), -10.0 * np.eye(3), np.zeros((4, 3))])
    return SimpleNamespace(y=y, end=end, linear=linear, inverses=np.zeros((1, 3, 3)))


@pytest.mark.parametrize(
    ("work", "norm"),
    [
        (stepped(2.0, x=3e-6), 3.0),
        (stepped(2.0, angle=3e-7), 3.0),  # times 10 mm
        (stepped(2.0, u=8e-4), 80.0 / 30),  # in the end: 0.1 s of it, 30 tolerances allowed
        (stepped(1.0, u=8e-6), 0.8 / 30),
    ],
)
def test_error_of_a_step_is_the_displacement_that_it_makes_over_the_tolerance(work: Any, norm: float) -> None:
    found = CONTROL.error_norm(1e-3, 1e-6, MODEL, work)
    assert found == pytest.approx(norm)
    turned = stepped(2.0)
    turned.end[0, 2] = -1.3
    assert CONTROL.error_norm(1e-3, 1e-6, MODEL, turned) == pytest.approx(1.3)  # a radian in one step


def test_error_of_the_velocity_may_not_spoil_a_thousandth_of_it() -> None:
    """Of a robot whose forces forget in a microsecond nothing else is left of the error."""
    work = stepped(2.0, u=1e-3)
    work.linear[1:4] = -1e6 * np.eye(3)
    assert CONTROL.error_norm(1e-9, 1e-3, MODEL, work) == pytest.approx(1e-3 / (1e-3 * 2.0 + 1e-5))


@pytest.mark.parametrize(("axis", "velocity"), [(0, 5e-4), (1, -5e-4), (2, 2e-5)])
def test_how_a_robot_leaves_rest_may_err_by_a_share_of_each_velocity_and_of_the_speed_of_rest(
    axis: int, velocity: float
) -> None:
    work = stepped(0.0)
    work.linear[1:4] = -1e6 * np.eye(3)
    work.end[1, 3 + axis] = 1e-6
    for before, after in ((0.5 * velocity, velocity), (velocity, 0.5 * velocity)):  # the larger one counts
        work.y[3 + axis], work.end[0, 3 + axis] = before, after
        allowed = CONTROL.DECIDING_SHARE * abs(velocity) + CONTROL.DECIDING_RESTS * 1e-4
        assert allowed < 1e-3 * abs(velocity) + 1e-5
        assert CONTROL.error_norm(1e-9, 1e-3, MODEL, work) == pytest.approx(1e-6 / allowed)
    work.y[3], work.end[0, 3] = 0.02, 0.02  # it has left it
    assert CONTROL.error_norm(1e-9, 1e-3, MODEL, work) == pytest.approx(1e-6 / (1e-3 * 0.02 + 1e-5))


@pytest.mark.parametrize(("speed", "resting"), [(0.99e-2, True), (1.01e-2, False)])
def test_a_robot_rests_below_a_hundred_rest_speeds(speed: float, resting: bool) -> None:
    for place in (3, 4, 5):
        state = np.zeros(6)
        state[place] = -speed
        assert CONTROL.is_resting(state, MODEL) == resting


@pytest.mark.parametrize("wheel", [0, 1, 2])
def test_impulse_on_a_wheel_stops_it_and_leaves_the_angular_momentum_about_it(wheel: int) -> None:
    start, out = np.array([0.0, 0.0, 0.0, 1.5, -0.4, 0.9]), np.zeros(6)
    EULER.stop_wheel(wheel, start, MODEL, out)
    x, y = MODEL.wheel_x[wheel], MODEL.wheel_y[wheel]
    assert (out[3] - out[5] * y, out[4] + out[5] * x) == pytest.approx((0.0, 0.0), abs=1e-12)
    # About the wheel: the spin of the body, and its momentum at the arm from there.
    spins = [MODEL.inertia * s[5] + MODEL.mass * (y * s[3] - x * s[4]) for s in (start, out)]
    assert spins[0] == pytest.approx(spins[1])


def test_slowest_wheel_is_the_one_that_moves_least_among_those_with_grip() -> None:
    start = np.array([0.0, 0.0, 0.0, 1.5, 1.8, 0.9])  # turns about (-2, 1.67): wheel 1 is nearest
    assert EULER.slowest_wheel(-1, start, MODEL) == 1
    assert EULER.slowest_wheel(1, start, MODEL) == 0  # the third has no grip


def test_each_start_of_newtons_method_is_tried_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def descend(_time: float, _step: float, _start: Any, patient: bool, _model: Any, _work: Any, out: Any) -> bool:
        tried.append((out[3:].round(9).tolist(), patient))
        return False

    monkeypatch.setattr(EULER, "descend", descend)
    start, out, stopped = (
        np.array([0.0, 0.0, 0.0, 1.5, 1.8, 0.9]),
        np.array([0.0, 0.0, 0.0, 9.0, 9.0, 9.0]),
        np.zeros(6),
    )
    assert not EULER.euler(0.0, 1.0, start, MODEL, None, out)
    expected = [([9.0, 9.0, 9.0], False)]
    for wheel in (1, 0):  # the slowest one, then the next
        EULER.stop_wheel(wheel, start, MODEL, stopped)
        expected.append((stopped[3:].round(9).tolist(), False))
    assert tried == [*expected, ([0.0, 0.0, 0.0], False), ([1.5, 1.8, 0.9], True)]


@pytest.mark.parametrize("yaw", [0.8, -2.0, 1e-6, 0.0])
def test_arc_of_a_steady_turn_is_a_circle_at_constant_velocity(yaw: float) -> None:
    work = SimpleNamespace(pose=np.array([1.0, 2.0, 0.3]), y=np.array([0.1, 0.02, 0.05, 2.0, -0.3, yaw]))
    times, out = np.array([0.0, 1.0, 1.7, 2.5]), np.zeros((4, 6))
    begin = matrix(ROSENBROCK.moved(work.pose, 0.1, 0.02, 0.05))
    MANIFOLD.write_arc(out, times, (1, 4), 1.0, 1.5, work)
    for row in (1, 2, 3):
        since = times[row] - 1.0
        expected = begin @ expm(since * generator(2.0, -0.3, yaw))
        np.testing.assert_allclose(matrix(tuple(out[row, :3])), expected, atol=1e-9)
        assert out[row, 3:] == pytest.approx([2.0, -0.3, yaw])
    assert out[0].tolist() == [0.0] * 6
    np.testing.assert_allclose(matrix(tuple(work.pose)), begin @ expm(1.5 * generator(2.0, -0.3, yaw)), atol=1e-9)
    assert work.y.tolist() == [0.0, 0.0, 0.0, 2.0, -0.3, yaw]


@pytest.mark.parametrize(
    ("to_go", "tolerance", "at_rest", "near"),
    [
        (1.9e-3, 1e-3, False, True),  # a thousandth of 2 mm/s
        (2.1e-3, 1e-3, False, False),
        (1.9e-3, 1.8e-4, False, False),  # moves the robot by a tenth of that in mm
        (1.9e-3, 2.0e-4, False, True),
    ],
)
def test_slip_has_relaxed_within_a_thousandth_of_the_velocity_and_the_tolerance(
    to_go: float, tolerance: float, at_rest: bool, near: bool
) -> None:
    work = SimpleNamespace(inverse=-0.1 * np.eye(3), spare=np.zeros((8, 6)), y=np.array([0.0, 0, 0, 2.0, 0.1, 0.0]))
    assert MANIFOLD.close(np.array([0.0, to_go, 0.0]), tolerance, at_rest, MODEL, work) == near
    turning = SimpleNamespace(inverse=-0.1 * np.eye(3), spare=np.zeros((8, 6)), y=np.array([0.0, 0, 0, 0.1, 0.0, 0.2]))
    assert MANIFOLD.close(np.array([0.0, 0.0, to_go / 10]), tolerance, at_rest, MODEL, turning) == near
    resting = SimpleNamespace(inverse=-0.1 * np.eye(3), spare=np.zeros((8, 6)), y=np.full(6, 1e-4))
    assert not MANIFOLD.close(np.zeros(3), tolerance, False, MODEL, resting)
    assert MANIFOLD.close(np.zeros(3), tolerance, True, MODEL, resting)
