"""Physics that the list of effects does not have: an honest diagnosis calls it unknown.

Each function takes a world and a size (1 is ordinary) and an angle that turns it where it has a direction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.laboratory.reference import Array, Now, Sliding, World

Outside = Callable[[World, float, float], World]


def sticking_wheel(world: World, size: float, angle_rad: float) -> World:
    """The front left wheel holds while it slides slowly, and loses 40 % of its friction in fast sliding (Stribeck)."""
    del angle_rad
    share = min(0.4 * size, 0.8)

    def law(_now: Now, sliding: Sliding) -> Array:
        factor = np.ones_like(sliding.speed_mm_s)
        factor[0] -= share / (1 + np.exp(-(sliding.speed_mm_s[0] - 0.05) / 0.01))
        return factor

    return replace(world, frictions=(*world.frictions, law))


def drive_torque_lifts(world: World, size: float, angle_rad: float) -> World:
    """The drive force of each side acts at a height: it moves load from its front to its rear wheel."""
    del angle_rad

    def law(now: Now, loads: Array, world: World) -> Array:
        shift = size * 1.5 / world.robot.wheelbase_mm * now.last_drive_mN[:2]
        return loads + np.vstack([-shift, shift])

    return replace(world, loads=(*world.loads, law))


def force_with_speed_squared(world: World, size: float, angle_rad: float) -> World:
    """A force to one side of the body that grows with the square of the speed (a trailing wire that whips)."""

    def pull(now: Now, _world: World) -> tuple[Array, Array, Array]:
        squared = 0.15 * size * np.sign(np.sin(angle_rad)) * (now.u_mm_s**2 + now.v_mm_s**2)
        return 0 * squared, squared, 0 * squared

    return replace(world, pulls=(*world.pulls, pull))


def friction_wears_off(world: World, size: float, angle_rad: float) -> World:
    """The left wheels pick up dust: their friction decays by half over some millimetres of way."""
    del angle_rad
    share = min(0.5 * size, 0.9)

    def law(now: Now, sliding: Sliding) -> Array:
        factor = np.ones_like(sliding.x_mm)
        factor[[0, 2]] -= share * (1 - np.exp(-now.travelled_mm / 5))
        return factor

    return replace(world, frictions=(*world.frictions, law))


def backlash(world: World, size: float, angle_rad: float) -> World:
    """The gear trains turn through a dead angle, 40° left and 15° right, before their wheels move."""
    del angle_rad
    return replace(world, backlash_rad=(float(np.deg2rad(40 * size)), float(np.deg2rad(15 * size))))


def moment_of_heading_twice(world: World, size: float, angle_rad: float) -> World:
    """A moment that depends on twice the heading (the earth's field on a soft-magnetic body)."""

    def pull(now: Now, _world: World) -> tuple[Array, Array, Array]:
        moment = 0.5 * size * np.sin(2 * (now.heading_rad - angle_rad))
        return 0 * moment, 0 * moment, moment

    return replace(world, pulls=(*world.pulls, pull))


def coupled_motors(world: World, size: float, angle_rad: float) -> World:
    """A common supply couples the motors: each gets 1 - b of its own command and b of the other's."""
    del angle_rad
    b = 0.03 * size
    return replace(world, commands=(*world.commands, lambda rpm: (1 - b) * rpm + b * rpm[::-1]))


def twisted_wire(world: World, size: float, angle_rad: float) -> World:
    """The wire twists as the robot turns: a moment back towards the heading that each run started with."""
    del angle_rad

    def pull(now: Now, _world: World) -> tuple[Array, Array, Array]:
        moment = -1.0 * size * (now.heading_rad - now.start_heading_rad)
        return 0 * moment, 0 * moment, moment

    return replace(world, pulls=(*world.pulls, pull))


KINDS: dict[str, Outside] = {
    law.__name__.replace("_", "-"): law
    for law in (
        sticking_wheel,
        drive_torque_lifts,
        force_with_speed_squared,
        friction_wears_off,
        backlash,
        moment_of_heading_twice,
        coupled_motors,
        twisted_wire,
    )
}
