"""What an effect declares of its parameters beside the fit: the bounds that people read, and the sizes of drawings."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from simulator.effects import free_form
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Scene

# Sizes at which the catalogue draws the effects: large, so that they show in a small drawing, and possible.
DRAWN = {
    "drive-speed-mismatch": (1.1,),
    "drive-speed-scale": (1.1,),
    "motor-droop": (0.004,),
    "command-lag": (0.5, 0.5),
    "speed-limit": (20.0,) * 3,
    "acceleration-limit": (40.0,) * 3,
    "friction-across": (2.0,),
    "sliding-friction": (1.0,),
    "speed-ripple": (0.3, 90.0),
    "dead-band": (20.0,),
    "speed-drift": (0.02,),
    "magnet-imbalance": (4.0,),
    "magnet-strength": (1.0, 6.0),
    "friction-level": (3.0,),
    "wheel-toe": (4.0, -4.0),
    "rolling-drag": (0.3,),
    "scrub-torque": (0.1,),
    "axle-compliance": (1.0,),
    "mass-offset": (-1.5, 1.5),
    "plate-tilt": (20.0, 90.0),
    "tether-pull": (0.0, 3.0),
    "tether-spring": (0.1, 0.0, 30.0),
    "viscous-drag": (1.0, 1e4),
    "friction-gradient": (-0.05, 0.05),
    "friction-grain": (0.6, 90.0),
    "stray-magnet": (1.0, 8.0, 3.0, 2.0),
    "mark-offset": (0.4, 0.4, 4.0),
    "plane-scale": (1.1,),
    "time-base": (1.1,),
    "camera-tilt": (0.01, 0.01, 1.0),
    "rolling-shutter": (8.0, 8.0),
}


def test_an_effect_is_drawn_as_large_as_it_shows_within_the_bounds_of_a_fit() -> None:
    drawn = {id_: tuple(item.shown_value for item in effect.parameters) for id_, effect in EFFECTS.items()}
    assert drawn == {id_: pytest.approx(values) for id_, values in DRAWN.items()}
    for effect in EFFECTS.values():
        assert all(max(item.low, item.at_least) <= item.shown_value <= item.high for item in effect.parameters)


@pytest.mark.parametrize("id_", ["command-lag", "magnet-strength", "dead-band", "friction-level"])
def test_bounds_that_people_read_are_those_that_the_coordinates_of_a_fit_reach(id_: str) -> None:
    """A share of a delay, the balance of two axles or a logarithm has bounds of its own."""
    found = EFFECTS[id_].candidate(Scene(20.0, (30.0, 10.0)))
    told = [found.physical(ends) for ends in itertools.product(*((item.low, item.high) for item in found.coordinates))]
    for item in EFFECTS[id_].parameters:
        values = [values[item.name] for values in told]
        assert (item.low, item.high) == pytest.approx((min(values), max(values)))


@pytest.mark.parametrize("id_", ["plate-tilt", "speed-ripple", "friction-grain"])
def test_a_size_with_a_direction_is_fitted_up_to_its_bound_in_every_direction_of_its_period(id_: str) -> None:
    size, angle = EFFECTS[id_].parameters
    found = EFFECTS[id_].candidate(Scene(20.0, (30.0, 10.0)))
    ways = np.radians(np.arange(2.5, 360.0, 5.0))
    told = [found.physical((size.high * math.cos(way), size.high * math.sin(way))) for way in ways]
    assert [one[size.name] for one in told] == pytest.approx([size.high] * len(ways))
    directions = [one[angle.name] for one in told]
    assert (min(directions), max(directions)) == pytest.approx((0.0, angle.high), abs=2.6)
    assert (angle.low, angle.high, size.low) == (0.0, angle.period, 0.0)


def test_a_limit_is_stated_from_a_standstill_to_what_no_wheel_reaches() -> None:
    limits = [item for id_ in ("speed-limit", "acceleration-limit") for item in EFFECTS[id_].parameters]
    assert {(item.low, item.high) for item in limits} == {(0.0, 1e6)}


FORM = {"channel": "moment", "basis": "one", "coefficient": 1.0}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, ""),
        ({"point_mm": (1.0, 2)}, ""),
        ({"point_mm": [1.0]}, "must be two numbers"),
        ({"point_mm": [1.0, 2.0, 3.0]}, "must be two numbers"),
        ({"point_mm": [1.0, "2"]}, "must be two numbers"),
        ({"point_mm": 3.0}, "must be two numbers"),
        ({"point_mm": "12"}, "must be two numbers"),
        ({"coefficient": True}, "is not a finite number"),
        ({"coefficient": math.inf}, "is not a finite number"),
        ({"coefficient": "1"}, "is not a finite number"),
        ({"pattern": "drivn"}, "did you mean driven?"),
        ({"pattern": 3}, "it is one of common"),
        ({"basis": "cos_wheel_angle"}, "belongs to wheels, channel moment does not"),
        ({"basis": "cos_wheel_angle", "channel": "friction"}, ""),
        ({"basis": "cos_wheel_angle", "channel": "speed"}, ""),  # the first channel of the wheels
        ({"basis": "cos_wheel_angle", "channel": "camera_x"}, "belongs to wheels"),
        ({"basis": "time", "channel": "camera_x"}, ""),
        ({"basis": "left_command", "channel": "camera_y"}, "takes x, y, "),
        ({"basis": "left_command", "channel": "left_drive"}, ""),
        ({"basis": "left_command"}, "does not take basis left_command"),
        ({"basis": "one", "channel": "left_drive"}, "it takes left_command, right_command"),
        ({"coef": 1.0}, "has no parameter coef; did you mean coefficient?"),
    ],
)
def test_a_free_form_says_where_it_acts_on_what_it_depends_and_how_much(given: dict[str, object], said: str) -> None:
    found = list(free_form.faults(FORM | given))
    assert bool(found) == bool(said)
    assert said in " ".join(found)


def test_steps_of_a_fits_own_coordinates_are_those_of_effects_that_do_alike() -> None:
    """Of delays, relative speeds and forces; at a usual speed of 20 rpm, of which limits are fitted by the inverse."""
    scene = Scene(20.0, (30.0, 20.0, 10.0))

    def step(id_: str, name: str) -> float:
        return next(item.step for item in EFFECTS[id_].parameters if item.name == name)

    def steps(id_: str) -> list[float]:
        return [item.step for item in EFFECTS[id_].candidate(scene).coordinates]

    assert steps("speed-limit") == pytest.approx([step("drive-speed-scale", "factor") / 20.0] * 3)
    assert steps("acceleration-limit") == pytest.approx([step("command-lag", "dead_time_s") / 20.0] * 3)
    assert steps("tether-spring")[1:] == pytest.approx([step("tether-pull", "x_mN"), step("tether-pull", "y_mN")])
    assert steps("command-lag") == pytest.approx([step("command-lag", "dead_time_s"), 0.1])  # a tenth of the delay
    assert steps("magnet-strength") == pytest.approx(
        [step("magnet-strength", f"{axle}_factor") for axle in ("driving", "driven")]
    )
    begun = 0.5 / 20.0  # half a second
    starts = EFFECTS["acceleration-limit"].candidate(scene).starts
    assert starts[:2] == (pytest.approx((begun, begun, 0.0)), pytest.approx((0.0, 0.0, begun)))
