"""Derivatives of what wheels do, compared with differences: responses of a wheel, accelerations, loads."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulator.dynamics.model import compile_robot
from tests.simulator.dynamics.touching import (
    COMPLIANT,
    EFFECTS,
    MOVING,
    REST,
    Vector,
    barrel,
    touched,
    with_all,
)
from tests.simulator.layouts import pair, robot_with
from tests.simulator.plain import plain

SLIDING = {"sliding-friction": {"share": 0.4}, "wheel-toe": {"left_deg": 20.0, "right_deg": -30.0}}


@pytest.mark.parametrize("velocity", MOVING)
def test_responses_of_a_wheel_are_the_derivatives_of_its_force(velocity: Vector) -> None:
    wheel, (model, contacts), step = plain("wheel"), touched(barrel(), rpm=(40.0, 25.0)), 1e-6
    contacts[wheel.DRAG_FORCE, 0] = 2000.0

    def response(u: float = 0.0, v: float = 0.0, angle: float = 0.0) -> np.ndarray:
        contacts[wheel.COS_STEER, 0], contacts[wheel.SIN_STEER, 0] = math.cos(0.3 + angle), math.sin(0.3 + angle)
        found = wheel.wheel_response(0, velocity[0] + u, velocity[1] + v, velocity[2], contacts, REST, model)
        return np.array(found)

    here = response()
    for columns, change in (([2, 4], {"u": step}), ([3, 5], {"v": step}), ([6, 7], {"angle": step})):
        ahead, behind = response(**change)[:2], response(**{name: -value for name, value in change.items()})[:2]
        slope = (ahead - behind) / (2 * step)
        assert here[columns] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("all_driven", [False, True])
@pytest.mark.parametrize("effects", [EFFECTS, COMPLIANT, SLIDING, {"mass-offset": EFFECTS["mass-offset"]}])
@pytest.mark.parametrize("velocity", MOVING)
def test_slopes_are_the_derivatives_of_the_accelerations(
    velocity: Vector, effects: dict[str, dict[str, float]], all_driven: bool
) -> None:
    """Within what the compiled ones are held to, of effects that act at once."""
    if effects is COMPLIANT:  # differences take the place of slopes where terms feel the velocity: rolling drag does
        effects = {name: values for name, values in COMPLIANT.items() if name != "rolling-drag"}
    robot = with_all(effects, robot_with([*pair(2.0), *pair(-2.0)]) if all_driven else None)
    model, contacts = touched(robot, velocity=velocity, rpm=(40.0, 25.0))
    drive, place, step, out = (40.0, 25.0, 0.0, 0.0), (3.0, -2.0, 0.8, 0.6, 1.0), 1e-6, np.zeros((4, 3))
    equations = plain("equations")
    equations.slopes(*velocity, drive, place, REST, model, contacts, out)
    here = equations.accelerations(*velocity, drive, place, REST, model, contacts)
    assert out[0] == pytest.approx(here, rel=1e-8)
    sides = [
        equations.accelerations(*(velocity + sign * step * np.eye(3)[column]), drive, place, REST, model, contacts)
        for column in range(3)
        for sign in (1, -1)
    ]
    differences = np.array([np.subtract(*sides[2 * column : 2 * column + 2]) / (2 * step) for column in range(3)]).T
    assert np.abs(out[1:] - differences).max() < 1e-4 * np.abs(differences).max()


@pytest.mark.parametrize("offset", [{}, {"mass-offset": EFFECTS["mass-offset"]}])
@pytest.mark.parametrize("drag", [{}, {"viscous-drag": EFFECTS["viscous-drag"]}])
def test_slopes_of_the_loads_are_their_derivatives_whether_terms_feel_the_velocity_or_not(
    offset: dict[str, dict[str, float]], drag: dict[str, dict[str, float]]
) -> None:
    model, place, step = compile_robot(with_all({**offset, **drag}))[0], (3.0, -2.0, 0.8, 0.6, 1.0), 1e-5
    body, velocity = plain("body"), np.array([1.2, -0.7, 0.9])
    here, found = body.loads_slopes(*velocity, place, REST, model)
    assert here == pytest.approx(body.loads(*velocity, place, REST, model))
    for column, row in enumerate(np.eye(3)):
        ahead, behind = (body.loads(*(velocity + sign * step * row), place, REST, model) for sign in (1, -1))
        assert np.array(found[column]) == pytest.approx(
            np.subtract(ahead, behind) / (2 * step), rel=1e-5, abs=2e-3
        )  # rounding
