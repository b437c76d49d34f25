"""Derivatives that the integrator relies on, against differences; and the bend of the slip law, against the library."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.dynamics.equations import accelerations, slopes
from simulator.dynamics.model import compile_robot
from simulator.dynamics.wheel import fresh_contacts
from simulator.effects.entry import EffectEntry
from simulator.robot import load_robot
from simulator.slip.magic_formula import sine_and_cosine_of_atan, sine_of_atan

EFFECTS: list[dict[str, object]] = [
    {"id": "wheel-toe", "left_deg": 2.0, "right_deg": -1.0},
    {"id": "motor-droop", "rpm_per_uN_mm": 2e-3},
    {"id": "axle-compliance", "deg_per_mN": 1.0},
    {"id": "mass-offset", "x_mm": 0.3, "y_mm": -0.2},
    {"id": "friction-gradient", "per_mm_x": 0.01, "per_mm_y": -0.02},
    {"id": "friction-grain", "amplitude": 0.2, "direction_deg": 30.0},
    {"id": "viscous-drag", "force_mN_s_mm": 0.05, "moment_uN_mm_s": 3.0},
    {"id": "rolling-drag", "coefficient": 0.02},
]


@pytest.mark.parametrize("name", ["tire", "barrel"])
@pytest.mark.parametrize("effect", [None, *EFFECTS], ids=lambda item: str(item["id"]) if item else "nominal")
def test_derivative_by_velocity_is_that_of_the_accelerations(name: str, effect: dict[str, object] | None) -> None:
    robot = load_robot(name)
    if effect:
        robot = robot.model_copy(update={"effect": (EffectEntry.model_validate(effect),)})
    model, contacts, out = compile_robot(robot)[0], fresh_contacts(), np.zeros((4, 3))
    drive, place, step = (40.0, 20.0, 1.0, 2.0), (3.0, -2.0, 0.8, 0.6, 1.0), 1e-6
    generator = np.random.default_rng(5)
    for velocity in generator.normal([1.2, 0.1, -0.3], [0.6, 0.3, 0.3], (20, 3)):
        slopes(*velocity, drive, place, 1e-4, model, contacts, out)
        sides = [
            accelerations(*(velocity + sign * step * np.eye(3)[column]), drive, place, 1e-4, model, contacts)
            for column in range(3)
            for sign in (1, -1)
        ]
        differences = np.array([np.subtract(*sides[2 * column : 2 * column + 2]) / (2 * step) for column in range(3)]).T
        assert np.allclose(out[0], accelerations(*velocity, drive, place, 1e-4, model, contacts), rtol=1e-12)
        assert np.abs(out[1:] - differences).max() < 1e-4 * np.abs(differences).max()


@pytest.mark.parametrize("shape", [0.3, 0.8, 1.0, 1.2, 1.9])
def test_bend_is_the_library_function_to_rounding(shape: float) -> None:
    x = np.concatenate([[0.0, 1.0], 10.0 ** np.linspace(-15, 5, 400)])
    angle = shape * np.arctan(x)
    found = np.array([(sine_of_atan(value, shape), *sine_and_cosine_of_atan(value, shape)) for value in x])
    assert np.allclose(found[:, 0], np.sin(angle), rtol=4e-15, atol=0)
    assert np.array_equal(found[:, 0], found[:, 1])
    assert np.allclose(found[:, 2], np.cos(angle), rtol=0, atol=1e-15)
