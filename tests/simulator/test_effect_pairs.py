"""Effects that act together do so in the simulator as in the reference, which has none of its code."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.robot import load_robot
from simulator.run import State
from simulator.simulation import simulate
from tests.laboratory.effects import View, add_effect
from tests.laboratory.motion import simulate as simulate_reference
from tests.laboratory.reference import World

LASTS_S, LEFT_RPM, RIGHT_RPM = 3.0, -33.0, -14.0
START = (-2.0, 3.0, 3.5)
APART_MM = 0.005  # the reference, whose first steps are coarse, is 1 to 3 µm from the simulator

SIZES: dict[str, dict[str, float]] = {
    "friction-grain": {"amplitude": 0.2, "direction_deg": 40.0},
    "wheel-toe": {"left_deg": 3.0, "right_deg": -2.0},
    "axle-compliance": {"deg_per_mN": 1.0},
    "mass-offset": {"x_mm": 1.0, "y_mm": 0.8},
    "plate-tilt": {"angle_deg": 5.0, "azimuth_deg": 60.0},
    "motor-droop": {"rpm_per_uN_mm": 4e-4},
    "scrub-torque": {"radius_mm": 0.08},
    "stray-magnet": {"force_mN": 1.0, "x_mm": 15.0, "y_mm": 12.0},
    "magnet-imbalance": {"left_over_right": 0.6},
}


def end(effects: Mapping[str, Mapping[str, float]]) -> tuple[float, float, float]:
    """Where the reference says that a run ends: x, y, heading."""
    world = World()
    for effect, sizes in effects.items():
        world, _ = add_effect(world, View(), effect, sizes)
    rpm, start = np.array([[LEFT_RPM], [RIGHT_RPM]]), np.array(START)[:, None]
    found = simulate_reference(world, rpm, start, np.array([LASTS_S + 0.1]))
    paths = found.x_mm, found.y_mm, found.heading_rad
    x, y, heading = (float(np.interp(LASTS_S, found.time_s[:, 0], path[:, 0])) for path in paths)
    return x, y, heading


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("friction-grain", "wheel-toe"),
        ("friction-grain", "motor-droop"),
        ("mass-offset", "plate-tilt"),
        ("wheel-toe", "scrub-torque"),
        ("axle-compliance", "stray-magnet"),
        ("magnet-imbalance", "friction-grain"),
    ],
)
def test_two_effects_act_together_as_in_the_reference(one: str, other: str) -> None:
    reference, barrel = World().robot, load_robot("barrel")
    slip = barrel.slip.model_copy(
        update={
            "longitudinal_friction": reference.friction_x,
            "lateral_friction": reference.friction_y,
            "friction_decrease": reference.friction_decrease,
            "longitudinal_shape": reference.shape_x,
            "lateral_shape": reference.shape_y,
            "longitudinal_stiffness": reference.stiffness_x,
            "lateral_stiffness": reference.stiffness_y,
        }
    )
    effects = {effect: SIZES[effect] for effect in (one, other)}
    entries = tuple(EffectEntry.model_validate({"id": effect, **sizes}) for effect, sizes in effects.items())
    robot = barrel.model_copy(update={"slip": slip, "effect": entries})
    run = simulate(robot, Command.constant(LEFT_RPM, RIGHT_RPM), [0.0, LASTS_S], State(*START))
    x, y, heading = end(effects)
    assert np.hypot(run.x_mm[-1] - x, run.y_mm[-1] - y) < APART_MM
    assert run.heading_rad[-1] == pytest.approx(heading, abs=1e-3)
    alone = [np.subtract(end({effect: sizes})[:2], (x, y)) for effect, sizes in effects.items()]
    assert min(np.hypot(*apart) for apart in alone) > 1.5 * APART_MM  # both act
