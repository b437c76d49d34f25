"""The reference against the paper's numbers, its own symmetries, and SciPy's solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.laboratory import motion
from tests.laboratory.motion import Motion, simulate, simulate_in_full
from tests.laboratory.reference import Array, Robot, World

WEIGHT_MN = 4.9
TIRE = Robot(
    width_mm=5.0,
    friction_x=0.3,
    friction_y=0.3,
    shape_x=1.2,
    shape_y=1.2,
    stiffness_x=10.0,
    stiffness_y=10.0,
    stiffness_basis="weight",
)


def drive(world: World, left_rpm: float, right_rpm: float, lasts_s: float = 4.0) -> Motion:
    return simulate(world, np.array([[left_rpm], [right_rpm]]), np.zeros((3, 1)), np.array([lasts_s]))


def radius_mm(driven: Motion, at_s: float = 3.5) -> float:
    u, v, spin = driven.velocity[int(np.argmin(np.abs(driven.time_s[:, 0] - at_s))), :, 0]
    return float(np.hypot(u, v) / abs(spin))


@pytest.mark.parametrize(
    ("case", "driving", "driven", "published"),
    [
        ("9a", 0.0, 0.5, 52.52),
        ("9b", 0.25, 0.25, 46.32),
        ("9c", 0.5, 0.0, 17.97),
        ("10a", 0.0, 0.0, 52.05),
        ("10c", 4.75, 0.0, 15.63),
    ],
)
def test_radii_are_those_of_the_notes_on_the_paper(case: str, driving: float, driven: float, published: float) -> None:
    robot = replace(TIRE, driving_attraction_mN=driving * WEIGHT_MN, driven_attraction_mN=driven * WEIGHT_MN)
    assert radius_mm(drive(World(robot), 70, 100)) == pytest.approx(published, abs=0.006), case


def test_forward_and_backward_turns_have_one_radius() -> None:
    forward, backward = drive(World(), 33.3, 14.4), drive(World(), -33.3, -14.4)
    assert radius_mm(backward) == pytest.approx(radius_mm(forward), rel=1e-3)


def test_straight_speed_is_that_of_equation_10() -> None:
    driven = drive(World(), 60, 60)
    assert driven.velocity[-40, 0, 0] == pytest.approx(0.0524 * 60 + 0.00007, rel=1e-3)


def test_radius_follows_equation_11() -> None:
    for slower in (0.3, 0.5):
        found = radius_mm(drive(World(), 40, 40 * (1 - slower)))
        assert found == pytest.approx(2.5735 * slower**-1.5141, rel=0.04)


def test_steps_agree_with_radau_on_the_full_equations() -> None:
    commands, lasts = np.array([[33.3, -60.0, 20.0], [14.4, -22.0, -30.0]]), np.array([3.0, 2.5, 2.0])
    driven = simulate(World(), commands, np.zeros((3, 3)), lasts)
    for run in range(3):
        full = simulate_in_full(World(), tuple(commands[:, run]), np.zeros(3), lasts[run])
        assert driven.pose_at(run, lasts[run : run + 1])[:, 0] == pytest.approx(full, abs=3e-4)


def test_neither_steps_nor_the_rounding_at_rest_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    def end(world: World) -> Array:
        return drive(world, 60, 25, 3.0).pose_at(0, np.array([3.0]))[:, 0]

    base = end(World())
    assert end(World(rest_mm_s=1e-3)) == pytest.approx(base, abs=1e-5)
    monkeypatch.setattr(motion, "STEP_S", motion.STEP_S / 2)
    assert end(World()) == pytest.approx(base, abs=5e-4)


def test_a_locked_wheel_is_turned_about() -> None:
    u, _, spin = drive(World(), 33, 0, 2.0).velocity[-40, :, 0]
    right_wheel = u - spin * -World().robot.track_mm / 2
    assert abs(right_wheel) < 1e-3
    assert spin < 0
