"""Every effect under the symmetries of the plane: a mirrored world moves mirrored, a turned world turned.

A sign, an axis or a side that is wrong in one part of an effect breaks one of them, whatever its formula.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from simulator.command import Command
from simulator.effects.catalogue import BUILT_IN
from simulator.observation import marks_of_run
from simulator.robot import Robot, load_robot
from simulator.run import State
from simulator.simulation import simulate
from tests.simulator.effect_probe import affected, turned

Values = dict[str, float]
TIME_S = np.linspace(0.0, 1.5, 40)
START, LEFT_RPM, RIGHT_RPM = (9.0, -4.0, 0.6), 40.0, 22.0
# Values at which an effect is plain to see; of the others, twenty of their steps.
VALUES: dict[str, Values] = {
    "plate-tilt": {"angle_deg": 6.0, "azimuth_deg": 40.0},
    "friction-grain": {"amplitude": 0.5, "direction_deg": 25.0},
    "tether-spring": {"stiffness_mN_mm": 0.2, "anchor_x_mm": 20.0, "anchor_y_mm": 7.0},
    "stray-magnet": {"force_mN": 3.0, "x_mm": 15.0, "y_mm": 5.0, "exponent": 2.0},
    "speed-ripple": {"amplitude": 0.2, "phase_deg": 70.0},
    "dead-band": {"rpm": 30.0},
    "speed-limit": {"wheel_rpm": 35.0, "ahead_rpm": 25.0, "turn_rpm": 6.0},
    "camera-tilt": {"per_mm_x": 0.004, "per_mm_y": -0.003, "perspective": 1.0},
    "rolling-shutter": {"x_ms_per_mm": 4.0, "y_ms_per_mm": -3.0},
    "command-lag": {"dead_time_s": 0.1, "time_constant_s": 0.2},
    "acceleration-limit": {"ahead_rpm_s": 60.0, "turn_rpm_s": 25.0},
}


def values_of(effect: str) -> Values:
    of_steps = {p.name: p.absent + (20 + 7 * k) * p.step for k, p in enumerate(BUILT_IN[effect].parameters)}
    return VALUES.get(effect, of_steps)


def negated(*names: str) -> Callable[[Values], Values]:
    return lambda values: {name: -value if name in names else value for name, value in values.items()}


def inverted(values: Values) -> Values:
    return {"left_over_right": 1 / values["left_over_right"]}


MIRRORED: dict[str, Callable[[Values], Values]] = {
    "drive-speed-mismatch": inverted,
    "magnet-imbalance": inverted,
    "wheel-toe": lambda values: {"left_deg": -values["right_deg"], "right_deg": -values["left_deg"]},
    "mass-offset": negated("y_mm"),
    "plate-tilt": negated("azimuth_deg"),
    "tether-pull": negated("y_mN"),
    "tether-spring": negated("anchor_y_mm"),
    "friction-gradient": negated("per_mm_y"),
    "friction-grain": negated("direction_deg"),
    "stray-magnet": negated("y_mm"),
    "mark-offset": negated("y_mm", "angle_deg"),
    "camera-tilt": negated("per_mm_y"),
    "rolling-shutter": negated("y_ms_per_mm"),
}
ANGLE_DEG = 35.0


def turned_vector(x: str, y: str) -> Callable[[Values], Values]:
    def turn(values: Values) -> Values:
        both = turned(np.radians(ANGLE_DEG)) @ [values[x], values[y]]
        return values | {x: float(both[0]), y: float(both[1])}

    return turn


def further(name: str) -> Callable[[Values], Values]:
    return lambda values: values | {name: values[name] + ANGLE_DEG}


TURNED: dict[str, Callable[[Values], Values]] = {
    "plate-tilt": further("azimuth_deg"),
    "friction-grain": further("direction_deg"),
    "tether-spring": turned_vector("anchor_x_mm", "anchor_y_mm"),
    "stray-magnet": turned_vector("x_mm", "y_mm"),
    "friction-gradient": turned_vector("per_mm_x", "per_mm_y"),
    "camera-tilt": turned_vector("per_mm_x", "per_mm_y"),
    "rolling-shutter": turned_vector("x_ms_per_mm", "y_ms_per_mm"),
}


@pytest.fixture(scope="module")
def barrel() -> Robot:
    return load_robot("barrel")


def seen(robot: Robot, start: tuple[float, float, float], left_rpm: float, right_rpm: float) -> np.ndarray:
    """Marks (n, 2, 2) of a run, green and yellow."""
    run = simulate(robot, Command.constant(left_rpm, right_rpm, 0.1), TIME_S, State(*start), run_index=2)
    return marks_of_run(robot, run).to_numpy()[:, 1:].reshape(-1, 2, 2)


@pytest.mark.parametrize("effect", sorted(BUILT_IN))
def test_mirrored_world_moves_mirrored(effect: str, barrel: Robot) -> None:
    values = values_of(effect)
    robot = affected(barrel, effect, **values)
    other = affected(barrel, effect, **MIRRORED.get(effect, dict)(values))
    x, y, heading = START
    here = seen(robot, START, LEFT_RPM, RIGHT_RPM)
    there = seen(other, (x, -y, -heading), RIGHT_RPM, LEFT_RPM)
    np.testing.assert_allclose(there[:, ::-1] * [1.0, -1.0], here, atol=2e-5)  # the left mark is on the right there
    plain = seen(barrel, START, LEFT_RPM, RIGHT_RPM)
    assert effect == "time-base" or np.abs(here - plain).max() > 2e-4  # ten times what is asked for


@pytest.mark.parametrize("effect", sorted(BUILT_IN))
def test_turned_world_moves_turned(effect: str, barrel: Robot) -> None:
    values, turn = values_of(effect), turned(np.radians(ANGLE_DEG))
    assert (effect in TURNED) == BUILT_IN[effect].of_plate
    robot = affected(barrel, effect, **values)
    other = affected(barrel, effect, **TURNED.get(effect, dict)(values))
    place = turn @ START[:2]
    here = seen(robot, START, LEFT_RPM, RIGHT_RPM)
    there = seen(other, (place[0], place[1], START[2] + np.radians(ANGLE_DEG)), LEFT_RPM, RIGHT_RPM)
    np.testing.assert_allclose(there, here @ turn.T, atol=2e-5)
