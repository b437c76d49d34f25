"""Laws of effects of the observation, worked out on paper, with their signs."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from simulator.dynamics.terms import BASES, CHANNELS, Term
from simulator.effects.view import View
from simulator.observation import marks_of_run, view_of
from simulator.robot import Robot, load_robot
from tests.simulator.effect_probe import affected, marks

STATE = ("x_mm", "y_mm", "heading_rad", "u_mm_s", "v_mm_s", "yaw_rate_rad_s")
GREEN, YELLOW = np.array([-1.55, 1.83]), np.array([-1.55, -1.83])


@pytest.fixture(scope="module")
def barrel() -> Robot:
    return load_robot("barrel")


def test_marks_are_turned_about_the_robots_centre_and_then_moved(barrel: Robot) -> None:
    """A quarter turn takes (x, y) to (-y, x): green to (-1.83, -1.55), then (0.5, 0.2) on. Looking along +y at (10, 5),
    forward is +y and left is -x.
    """
    robot = affected(barrel, "mark-offset", x_mm=0.5, y_mm=0.2, angle_deg=90.0)
    assert marks(robot, (0.0, 0.0, 0.0)) == pytest.approx(np.array([[-1.33, -1.35], [2.33, -1.35]]))
    assert marks(robot, (10.0, 5.0, math.pi / 2)) == pytest.approx(np.array([[11.35, 3.67], [11.35, 7.33]]))


def test_mark_offset_by_a_small_angle_is_counter_clockwise(barrel: Robot) -> None:
    robot = affected(barrel, "mark-offset", angle_deg=1.0)
    moved = marks(robot, (0.0, 0.0, 0.0)) - np.array([GREEN, YELLOW])
    ahead_left = np.array([[-GREEN[1], GREEN[0]], [-YELLOW[1], YELLOW[0]]])  # a turn moves (x, y) along (-y, x)
    assert moved == pytest.approx(math.radians(1.0) * ahead_left, abs=4e-4)


def test_plane_scale_stretches_about_the_origin(barrel: Robot) -> None:
    robot = affected(barrel, "plane-scale", factor=1.1)
    assert marks(robot, (10.0, -5.0, 0.0)) == pytest.approx(1.1 * (np.array([10.0, -5.0]) + np.array([GREEN, YELLOW])))


def test_two_scales_multiply_and_two_keystones_and_delays_add(barrel: Robot) -> None:
    from simulator.effects.catalogue import EFFECTS

    view = View(tuple(mark.place_mm for mark in barrel.layout))
    for id_, values in (
        ("plane-scale", {"factor": 1.1}),
        ("plane-scale", {"factor": 1.2}),
        ("camera-tilt", {"per_mm_x": 0.01, "per_mm_y": -0.02}),
        ("camera-tilt", {"per_mm_x": 0.02, "per_mm_y": 0.05}),
        ("time-base", {"factor": 1.1}),
        ("time-base", {"factor": 0.5}),
        ("rolling-shutter", {"x_ms_per_mm": 1.0, "y_ms_per_mm": -2.0}),
        ("rolling-shutter", {"x_ms_per_mm": 2.0, "y_ms_per_mm": 0.5}),
    ):
        see = EFFECTS[id_].view
        assert see is not None
        see(view, values)
    assert (view.scale, view.time_factor) == pytest.approx((1.32, 0.55))
    assert view.keystone_per_mm == pytest.approx((0.03, 0.03))
    assert view.delay_s_per_mm == pytest.approx((0.003, -0.0015))


@pytest.mark.parametrize(
    ("given", "factor"),
    [
        ({"per_mm_x": 0.01, "per_mm_y": 0.0}, 1.1),
        ({"per_mm_x": 0.0, "per_mm_y": 0.01}, 0.8),
        ({"per_mm_x": -0.01, "per_mm_y": 0.002}, 0.86),
    ],
)
def test_camera_tilt_scales_by_the_place(barrel: Robot, given: dict[str, float], factor: float) -> None:
    """A point of the plane of the marks at (10, -20)."""
    point = np.array([10.0, -20.0])
    assert view_of(affected(barrel, "camera-tilt", **given)).place(point) == pytest.approx(factor * point)


def test_full_perspective_is_a_homography(barrel: Robot) -> None:
    points = np.random.default_rng(1).uniform(-40, 40, (20, 2))
    tilt = points @ [0.003, -0.002]
    seen = view_of(affected(barrel, "camera-tilt", per_mm_x=0.003, per_mm_y=-0.002, perspective=1.0)).place(points)
    assert seen == pytest.approx(points / (1 - tilt)[:, None])


def test_time_base_multiplies_measured_times(barrel: Robot) -> None:
    assert view_of(affected(barrel, "time-base", factor=1.02)).time_factor == pytest.approx(1.02)


def test_measured_times_are_the_factor_times_the_true_ones_and_places_stay(barrel: Robot) -> None:
    times = np.array([0.0, 0.5, 2.0])
    still: Any = SimpleNamespace(time_s=times, **dict.fromkeys(STATE, np.zeros(3)))
    seen = marks_of_run(affected(barrel, "time-base", factor=1.25), still)
    assert seen["time_s"].tolist() == [0.0, 0.625, 2.5]
    assert seen["green_x_mm"].tolist() == pytest.approx([GREEN[0]] * 3)


@pytest.mark.parametrize(
    ("x_ms", "y_ms", "time_s"), [(1.0, 0.0, 0.02 / 0.99), (0.0, -2.0, 0.04), (3.0, 1.0, 0.04 / 0.97)]
)
def test_a_mark_is_seen_when_its_row_is_exposed(x_ms: float, y_ms: float, time_s: float) -> None:
    """A mark at (20, -20) that moves along x by 10 mm/s: t = x_ms (20 + 10 t) / 1000 - 20 y_ms / 1000."""
    view = View(((0.0, 0.0),), delay_s_per_mm=(x_ms / 1000, y_ms / 1000))
    (seen,) = view.marks_of_path(np.array([[20.0, -20.0, 0.0, 10.0, 0.0, 0.0]]), np.zeros(1))
    assert seen[0] == pytest.approx([20 + 10 * time_s, -20], abs=1e-4)
    (seen,) = view.marks_of_path(np.array([[20.0, -20.0, 0.0, 0.0, 0.0, 0.0]]), np.zeros(1))
    assert seen[0].tolist() == [20, -20]  # at rest every row shows the same


def test_in_a_turn_marks_are_seen_further_along_their_circles() -> None:
    """A body that slides sideways turns about the origin, (2, 9.5) of its frame, under a camera that magnifies."""
    view = View((tuple(GREEN), tuple(YELLOW)), scale=1.1, delay_s_per_mm=(0.002, -0.0015))
    angle, twist = np.linspace(0, 2 * math.pi, 7), (19.0, -4.0, 2.0)

    def pose(turned: np.ndarray) -> tuple[np.ndarray, ...]:
        cos, sin = np.cos(turned), np.sin(turned)
        return 9.5 * sin - 2 * cos, -2 * sin - 9.5 * cos, turned

    states = np.column_stack([*pose(angle), *np.tile(twist, (len(angle), 1)).T])
    for number, seen in enumerate(view.marks_of_path(states, angle / 2)):
        late_s = seen @ view.delay_s_per_mm
        assert np.ptp(late_s) > 0.03
        there = view.marks(*pose(angle + 2 * late_s))[number]
        assert seen == pytest.approx(there, abs=1e-4)


@pytest.mark.parametrize("y_mm", [30.0, -30.0])
def test_a_jump_of_the_speed_is_seen_when_it_happens(y_mm: float) -> None:
    """A robot at (0, y) starts along x with 10 mm/s at 0.107 s, between two frames, and stops at 0.301 s."""
    view = View(((0.0, 0.0),), delay_s_per_mm=(0.0, 0.001))
    times = np.arange(0, 0.5, 1 / 60)
    moving = (times > 0.107) & (times < 0.301)
    zeros = np.zeros_like(times)
    states = np.column_stack([_way(times), zeros + y_mm, zeros, 10.0 * moving, zeros, zeros])
    (seen,) = view.marks_of_path(states, times)
    assert seen[:, 0] == pytest.approx(_way(times + y_mm / 1000), abs=1e-9)


def _way(time_s: np.ndarray) -> np.ndarray:
    return 10 * (np.clip(time_s, 0.107, 0.301) - 0.107)


@pytest.mark.parametrize(
    ("basis", "size"),
    [("x", 3.0), ("y", -2.0), ("x_r_squared", 3.0 * 13), ("y_r_squared", -2.0 * 13), ("time", 5.0)],
)
@pytest.mark.parametrize("axis", [0, 1])
def test_error_of_a_measured_coordinate_is_a_coefficient_times_what_it_depends_on(
    basis: str, size: float, axis: int
) -> None:
    """A point at (3, -2), 13 mm² from the origin, seen after 5 s; the scale of the image does not act on the error."""
    term = Term(CHANNELS["camera_x"] + axis, BASES[basis], 0.01)
    seen = View(((0.0, 0.0),), scale=2.0, errors=(term, term)).place(np.array([3.0, -2.0]), 5.0)
    expected = np.array([6.0, -4.0])
    expected[axis] += 2 * 0.01 * size
    assert seen == pytest.approx(expected)


@pytest.mark.parametrize(
    ("view", "plain", "bends"),
    [
        (View((), scale=1.1, time_factor=0.9), True, False),
        (View((), keystone_per_mm=(0.0, 1e-4)), False, True),
        (View((), keystone_per_mm=(1e-4, 0.0)), False, True),
        (View((), errors=(Term(CHANNELS["camera_x"], BASES["y"], 0.01),)), False, False),
        (View((), errors=(Term(CHANNELS["camera_y"], BASES["y_r_squared"], 1e-6),)), False, True),
    ],
)
def test_a_view_is_plain_but_for_a_scale_and_bends_paths_where_its_error_is_not_linear(
    view: View, plain: bool, bends: bool
) -> None:
    assert (view.is_plain, view.bends_with_place) == (plain, bends)
    path = np.array([[0.0, 0.0], [3.0, 1.0], [4.0, 5.0]])
    here, there = view.place(path), view.place(path + np.array([20.0, 30.0]))
    assert (np.abs((here - here[0]) - (there - there[0])).max() > 1e-6) == bends
