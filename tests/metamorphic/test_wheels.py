"""Wheels listed in another order and called by other names move a robot as before."""

from __future__ import annotations

import numpy as np
import pytest

from simulator import Command, load_robot, simulate

COUNTS = {"six_driven": 6, "four_driven": 4, "two_driven_caster": 3}


@pytest.mark.parametrize("robot", COUNTS)
@pytest.mark.parametrize("seed", [1, 2])
def test_wheels_relabelled_and_in_another_order_give_the_same_motion_and_forces(robot: str, seed: int) -> None:
    usual = load_robot(robot)
    order = np.random.default_rng(seed).permutation(COUNTS[robot])
    assert len(usual.wheel) == len(order)
    wheels = tuple(usual.wheel[k].model_copy(update={"name": f"w{k}"}) for k in order)
    times_s, command = np.linspace(0.0, 3.0, 31), Command.steps([(0.0, 30.0, 12.0), (1.5, -20.0, 25.0)])
    one = simulate(usual, command, times_s)
    other = simulate(usual.model_copy(update={"wheel": wheels}), command, times_s)
    span_mm = float(np.ptp(np.hypot(one.x_mm, one.y_mm)))
    assert span_mm > 1.0
    for name in ("x_mm", "y_mm"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name), atol=1e-6 * span_mm)
    np.testing.assert_allclose(other.heading_rad, one.heading_rad, atol=1e-6)
    assert other.wheel_names == tuple(f"w{k}" for k in order)
    forces = one.lateral_force_mN
    np.testing.assert_allclose(other.lateral_force_mN, forces[:, order], atol=1e-4 * np.abs(forces).max())
