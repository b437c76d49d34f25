"""Robots from one millimetre to five metres, wheels from 1 to 10,000 rpm, and plates tilted by 20 degrees."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.command import Command
from simulator.robot import Robot, load_robot
from simulator.run import State
from simulator.simulation import simulate
from tests.simulator.effect_probe import affected


@pytest.fixture(scope="module")
def barrel() -> Robot:
    return load_robot("barrel")


def scaled(robot: Robot, size: float) -> Robot:
    """The robot with every length times size, and masses and forces of attraction as of the same materials."""
    content = robot.model_dump(exclude_unset=True)
    for table in ("body", "wheels", "marks"):
        for key, value in content[table].items():
            if key.endswith("_mm"):
                content[table][key] = (
                    [size * part for part in value] if isinstance(value, tuple | list) else size * value
                )
    content["body"]["mass_g"] *= size**3
    content["magnetic_attraction"] = {key: size**3 * value for key, value in content["magnetic_attraction"].items()}
    return Robot.model_validate(content)


@pytest.mark.parametrize("size", [0.2, 1000.0])  # 1 mm and 5 m long
def test_a_robot_of_any_size_follows_the_same_path_at_the_same_froude_number(barrel: Robot, size: float) -> None:
    """Under gravity a path of size-fold lengths takes the root of size as long, at rpm smaller by this root."""
    root, times_s = np.sqrt(size), np.linspace(0.0, 4.0, 20)
    one = simulate(barrel, Command.constant(14.4, 33.3), times_s)
    other = simulate(scaled(barrel, size), Command.constant(14.4 / root, 33.3 / root), root * times_s)
    assert one.is_converged
    assert other.is_converged
    np.testing.assert_allclose(other.x_mm / size, one.x_mm, atol=1e-3)
    np.testing.assert_allclose(other.y_mm / size, one.y_mm, atol=1e-3)
    np.testing.assert_allclose(other.heading_rad, one.heading_rad, atol=1e-3)


@pytest.mark.parametrize("rpm", [1.0, 10_000.0])
def test_wheels_of_any_speed_move_the_robot_no_faster_than_they_roll(barrel: Robot, rpm: float) -> None:
    run = simulate(barrel, Command.constant(0.43 * rpm, rpm), np.linspace(0.0, 200.0 / rpm, 30))
    rolls_mm_s = rpm / 60 * 2 * np.pi * barrel.driving_radius_mm
    assert run.is_converged
    assert 0.3 * rolls_mm_s < np.hypot(run.u_mm_s, run.v_mm_s)[-1] < rolls_mm_s


def test_on_a_plate_tilted_by_20_degrees_the_path_depends_on_the_direction_of_descent_alone(barrel: Robot) -> None:
    """Plate and robot turned together by 90 degrees: the same path, turned; it differs from that on a level plate."""
    times_s, command = np.linspace(0.0, 6.0, 30), Command.constant(14.4, 33.3)
    level = simulate(barrel, command, times_s)
    paths = [
        simulate(
            affected(barrel, "plate-tilt", angle_deg=20.0, azimuth_deg=40.0 + turn),
            command,
            times_s,
            State(heading_rad=np.radians(turn)),
        )
        for turn in (0.0, 90.0)
    ]
    assert all(path.is_converged for path in paths)
    np.testing.assert_allclose(paths[1].x_mm, -paths[0].y_mm, atol=1e-4)
    np.testing.assert_allclose(paths[1].y_mm, paths[0].x_mm, atol=1e-4)
    assert np.hypot(paths[0].x_mm - level.x_mm, paths[0].y_mm - level.y_mm).max() > 0.1
