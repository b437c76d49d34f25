"""The grammar of added physics on numbers worked out by hand: bases, channels, patterns, their place in a record."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from simulator.dynamics import terms
from simulator.dynamics.model import compile_robot
from simulator.dynamics.scale import (
    DIMENSIONS,
    POINT_DEPTH_MM,
    scaled_coefficient,
    scaled_knots,
    scaled_states,
    time_unit_s,
)
from simulator.dynamics.terms import BASES, CHANNELS, Term, pattern_weights
from simulator.errors import SimulationError
from simulator.nominal_robot import four_wheels
from simulator.robot import Robot, load_robot
from tests.simulator.layouts import ball, pair, robot_with
from tests.simulator.plain import plain

FAR = (0.0, 0.0, 0.0, 2.0)  # a point, of no matter


@pytest.fixture(scope="module")
def barrel() -> Robot:
    return load_robot("barrel")


def place_basis(basis: int, x: float = 0.0, y: float = 0.0, *, point: tuple[float, float, float, float] = FAR) -> float:
    """At a heading of 30 degrees, after 7 s, with the wheel turned by 120 degrees."""
    angle = math.radians(30.0)
    value: float = plain("bases").place_basis(
        basis, x, y, math.cos(angle), math.sin(angle), 7.0, math.radians(120.0), point
    )
    return value


@pytest.mark.parametrize(
    ("basis", "forward", "backward"),
    [
        (terms.U, 3.0, -3.0),
        (terms.V, -2.0, 2.0),
        (terms.YAW, 0.5, -0.5),
        (terms.U_ABS, 9.0, -9.0),
        (terms.V_ABS, -4.0, 4.0),
        (terms.YAW_ABS, 0.25, -0.25),
        (terms.ABS_U, 3.0, 3.0),
        (terms.ABS_YAW, 0.5, 0.5),
        (terms.SIGN_U, 0.6, -0.6),  # rounded over 4 mm/s: 3/5 and 2/√20
        (terms.SIGN_V, -1 / math.sqrt(5), 1 / math.sqrt(5)),
        (terms.SIGN_YAW, 1.0, -1.0),
    ],
)
def test_velocity_bases_keep_or_lose_the_sign_of_the_motion(basis: int, forward: float, backward: float) -> None:
    value = plain("bases").velocity_basis
    assert value(basis, 3.0, -2.0, 0.5, 4.0) == pytest.approx(forward)
    assert value(basis, -3.0, 2.0, -0.5, 4.0) == pytest.approx(backward)


def test_sign_of_the_yaw_rate_is_rounded_far_below_any_that_is_measured() -> None:
    value = plain("bases").velocity_basis
    assert value(terms.SIGN_YAW, 0.0, 0.0, 1e-4, 1.0) == pytest.approx(1 / math.sqrt(2))
    assert value(terms.SIGN_YAW, 0.0, 0.0, -0.01, 1.0) == pytest.approx(-1.0, abs=1e-4)


def test_bases_of_heading_place_time_and_wheel_angle() -> None:
    found = {basis: place_basis(basis, 3.0, -2.0) for basis in range(terms.COS, terms.TOWARD_X)}
    root = math.sqrt(0.75)
    assert found == pytest.approx(
        {
            terms.COS: root,
            terms.SIN: 0.5,
            terms.COS2: 0.5,
            terms.SIN2: root,
            terms.X: 3.0,
            terms.Y: -2.0,
            terms.TIME: 7.0,
            terms.COS_ANGLE: -0.5,
            terms.SIN_ANGLE: root,
        }
    )


@pytest.mark.parametrize("falloff", [0.0, 1.0, 3.0])
def test_pull_toward_a_point_has_its_size_10_mm_away_and_falls_with_the_power(falloff: float) -> None:
    """2 mm deep: √96 mm away counts as 10 mm, and √396 mm as 20 mm."""
    for counted in (10.0, 20.0):
        away = math.sqrt(counted**2 - 4)
        point = (5.0 + 0.6 * away, 1.0 - 0.8 * away, falloff, 2.0)
        toward = [place_basis(basis, 5.0, 1.0, point=point) for basis in (terms.TOWARD_X, terms.TOWARD_Y)]
        size = (10 / counted) ** falloff * away / counted
        assert toward == pytest.approx([0.6 * size, -0.8 * size])


def test_direction_of_sliding_counts_twice_and_fades_at_rest() -> None:
    value, angle = plain("bases").slide_basis, math.radians(25.0)
    for speed, share in ((1e3, 1.0), (2.0, 0.5), (0.0, 0.0)):  # of 2 mm/s, half is rounding over 2 mm/s
        slide = speed * math.cos(angle), speed * math.sin(angle)
        assert value(terms.SLIDE_COS2, *slide, 2.0) == pytest.approx(share * math.cos(2 * angle), abs=1e-5)
        assert value(terms.SLIDE_SIN2, *slide, 2.0) == pytest.approx(share * math.sin(2 * angle), abs=1e-5)


def body_forces(robot: Robot, *added: Term) -> Sequence[float]:
    """Looking to 30 degrees at (3, -2), moving at (3, -2) mm/s and turning at 0.5 rad/s."""
    place = (3.0, -2.0, math.cos(math.radians(30.0)), 0.5, 7.0)
    model = compile_robot(robot, extra=added)[0]
    forces: Sequence[float] = plain("body").body_forces(3.0, -2.0, 0.5, place, 1e-6, model)
    return forces


@pytest.mark.parametrize(
    ("channel", "expected"),
    [
        (terms.FORCE_FORWARD, (8.0, 0.0, 0.0)),
        (terms.FORCE_LEFT, (0.0, 8.0, 0.0)),
        (terms.MOMENT, (0.0, 0.0, 8.0)),
        (terms.FORCE_PLATE_X, (8 * math.sqrt(0.75), -4.0, 0.0)),  # seen from a robot turned by 30 degrees
        (terms.FORCE_PLATE_Y, (4.0, 8 * math.sqrt(0.75), 0.0)),
    ],
)
def test_body_channels_push_where_they_say(barrel: Robot, channel: int, expected: tuple[float, ...]) -> None:
    for basis, value in ((terms.ONE, 1.0), (terms.V, -2.0), (terms.X, 3.0), (terms.COS2, 0.5)):
        assert body_forces(barrel, Term(channel, basis, 8.0)) == pytest.approx([value * part for part in expected])


def test_terms_of_the_body_add_up(barrel: Robot) -> None:
    added = (Term(terms.FORCE_FORWARD, terms.ONE, 5.0), Term(terms.FORCE_PLATE_Y, terms.ONE, 8.0))
    twice = (*added, *added)
    assert body_forces(barrel, *twice) == pytest.approx([2 * (5 + 4.0), 16 * math.sqrt(0.75), 0.0])


def flags(robot: Robot, *added: Term) -> tuple[int, ...]:
    row = compile_robot(robot, extra=added)[0]
    names = (
        "general",
        "body_varies_with_velocity",
        "wheels_vary_with_velocity",
        "varies",
        "wheels_vary",
        "body_terms",
        "wheel_terms",
    )
    return tuple(int(row[name]) for name in names)


@pytest.mark.parametrize(
    ("channel", "basis", "said"),
    [
        (terms.FORCE_LEFT, terms.ONE, (0, 0, 0, 0, 0, 1, 0)),
        (terms.FORCE_LEFT, terms.U, (0, 1, 0, 0, 0, 1, 0)),
        (terms.MOMENT, terms.SIGN_YAW, (0, 1, 0, 0, 0, 1, 0)),
        (terms.FORCE_LEFT, terms.COS, (0, 0, 0, 1, 0, 1, 0)),
        (terms.FORCE_PLATE_X, terms.ONE, (0, 0, 0, 1, 0, 1, 0)),
        (terms.FORCE_PLATE_Y, terms.ONE, (0, 0, 0, 1, 0, 1, 0)),
        (terms.SPEED, terms.ONE, (1, 0, 0, 0, 0, 0, 1)),
        (terms.FRICTION, terms.V, (1, 0, 1, 0, 0, 0, 1)),
        (terms.FRICTION_ACROSS, terms.X, (1, 0, 0, 1, 1, 0, 1)),
        (terms.FRICTION, terms.SLIDE_COS2, (1, 0, 1, 1, 1, 0, 1)),
    ],
)
def test_a_record_says_what_its_terms_depend_on(barrel: Robot, channel: int, basis: int, said: tuple[int, ...]) -> None:
    assert flags(barrel) == (0,) * 7
    assert flags(barrel, Term(channel, basis, 0.1)) == said


def test_terms_of_the_body_come_first_and_friction_last_in_a_record(barrel: Robot) -> None:
    added = [
        Term(terms.FRICTION, terms.X, 0.1, "left-right"),
        Term(terms.STEER, terms.ONE, 0.2, "front-rear"),
        Term(terms.MOMENT, terms.TOWARD_X, 0.3, point_mm=(1.0, 2.0), falloff=1.5),
    ]
    row = compile_robot(barrel, extra=added)[0]
    assert row["channel"][:3].tolist() == [terms.MOMENT, terms.STEER, terms.FRICTION]
    assert row["basis"][:3].tolist() == [terms.TOWARD_X, terms.ONE, terms.X]
    assert row["coefficient"][:4].tolist() == [0.3, 0.2, 0.1, 0.0]
    assert (row["point_x"][0], row["point_y"][0], row["falloff"][0]) == (1.0, 2.0, 1.5)
    assert row["pattern"][1].tolist() == [1, 1, -1, -1]
    assert row["pattern"][2].tolist() == [1, -1, 1, -1]


def test_forty_terms_fit_and_one_more_is_refused_with_their_number(barrel: Robot) -> None:
    term = Term(terms.MOMENT, terms.ONE, 1.0)
    assert compile_robot(barrel, extra=[term] * 40)[0]["body_terms"] == 40
    with pytest.raises(SimulationError, match="41 terms of effects; at most 40"):
        compile_robot(barrel, extra=[term] * 41)


def test_terms_leave_casters_alone() -> None:
    robot = robot_with([*pair(0.0), ball(-3.0, 0.0)], {"center_of_gravity_mm": (-1.0, 0.0)})
    row = compile_robot(robot, extra=[Term(terms.STEER, terms.ONE, 0.1)])[0]
    assert row["pattern"][0].tolist() == [1, 1, 0, 0]


@pytest.mark.parametrize(
    ("pattern", "weights"),
    [
        ("common", (1, 1, 1, 1)),
        ("left-right", (1, -1, 1, -1)),
        ("front-rear", (1, 1, -1, -1)),
        ("driving", (1, 1, 0, 0)),
        ("driving-left-right", (1, -1, 0, 0)),
        ("driven", (0, 0, 1, 1)),
        ("driven-left-right", (0, 0, 1, -1)),
        ("front-left", (1, 0, 0, 0)),
        ("front-right", (0, 1, 0, 0)),
        ("rear-left", (0, 0, 1, 0)),
        ("rear-right", (0, 0, 0, 1)),
        ((0.5, 0.1, -3.0, 2.0), (0.5, 0.1, -3.0, 2.0)),
    ],
)
def test_patterns_weigh_the_wheels(pattern: str | tuple[float, ...], weights: tuple[float, ...]) -> None:
    assert pattern_weights(pattern, four_wheels(4.0, 3.0, 0.5, 0.0, 0.0)) == weights


def test_channels_act_on_body_wheels_drive_or_camera() -> None:
    kinds = {
        name: (
            Term(channel, 0, 1.0).acts_on_wheels,
            Term(channel, 0, 1.0).is_seen_only,
            Term(channel, 0, 1.0).acts_on_drive,
        )
        for name, channel in CHANNELS.items()
    }
    wheels = {"speed", "steer", "load", "stiffness", "drag", "friction", "friction_across"}
    for name, kind in kinds.items():
        assert kind == (name in wheels, name.startswith("camera"), name.endswith("drive")), name


SPEEDS = {terms.U: 3.0, terms.V: -2.0, terms.YAW: 0.5}


@pytest.mark.parametrize("name", [name for name, basis in BASES.items() if basis < terms.SLIDE_COS2])
@pytest.mark.parametrize("channel", [terms.FORCE_FORWARD, terms.MOMENT])
def test_a_term_is_the_same_force_in_the_units_of_a_robot_of_any_size(name: str, channel: int) -> None:
    """In a unit of time of 2 the unit of length is 4: speeds count half, yaw rates twice, places a quarter."""
    basis, unit = BASES[name], 2.0
    term = Term(channel, basis, 5.0, point_mm=(300.0, 400.0), falloff=1.5)
    velocity, place = (300.0, -200.0, 0.5), (3.0, -2.0)

    def value(time: float, coefficient: float) -> float:
        length, bases = time * time, plain("bases")
        if basis == terms.ONE:
            return coefficient
        if basis < terms.COS:
            u, v, r = velocity[0] * time / length, velocity[1] * time / length, velocity[2] * time
            return coefficient * float(bases.velocity_basis(basis, u, v, r, 1e-9))
        point = (term.point_mm[0] / length, term.point_mm[1] / length, term.falloff, POINT_DEPTH_MM / length)
        at = place[0] / length, place[1] / length
        return coefficient * float(bases.place_basis(basis, *at, 0.8, 0.6, 7.0 / time, 1.0, point))

    force = value(1.0, term.coefficient)
    scaled = value(unit, scaled_coefficient(term, unit)) * (unit * unit if channel == terms.MOMENT else 1.0)
    assert scaled == pytest.approx(force, rel=1e-6)
    assert set(DIMENSIONS) <= set(BASES.values())


def test_unit_of_a_robot_is_the_power_of_two_next_to_its_size() -> None:
    square = np.array([[2.0, 2.0], [2.0, -2.0], [-2.0, 2.0], [-2.0, -2.0]])
    sizes = {1.0: 1.0, 1.9: 1.0, 2.1: 2.0, 4.0: 2.0, 7.9: 2.0, 8.1: 4.0, 0.51: 1.0, 0.49: 0.5, 0.25: 0.5}
    for size, unit in sizes.items():  # a unit of time of 2 is one of length of 4: the edge is at their geometric middle
        assert time_unit_s(size * square + [5.0, -3.0]) == unit, size


def test_states_and_commands_count_in_the_units_of_the_robot() -> None:
    """In a unit of time of 2 s that of length is 4 mm, of speed 2 mm/s, of yaw rate 0.5 rad/s, of rpm 0.5."""
    state = scaled_states(np.array([[8.0, -4.0, 0.3, 6.0, 1.0, 0.25]]), 2.0)
    assert state == pytest.approx(np.array([[2.0, -1.0, 0.3, 3.0, 0.5, 0.5]]))
    assert scaled_knots(np.array([[3.0, 10.0, -20.0]]), 2.0) == pytest.approx(np.array([[1.5, 20.0, -40.0]]))


@pytest.mark.parametrize(
    ("channel", "basis", "of_plate", "of_place"),
    [
        ("force_forward", "u", False, False),
        ("force_forward", "cos_heading", True, False),
        ("moment", "x", True, True),
        ("friction", "cos_2_slide", True, False),
        ("force_plate_y", "one", True, False),
        ("camera_x", "time", True, False),
        ("camera_y", "y_r_squared", True, True),
        ("speed", "cos_wheel_angle", False, False),
    ],
)
def test_a_term_is_of_the_plate_by_its_channel_or_by_what_it_depends_on(
    channel: str, basis: str, of_plate: bool, of_place: bool
) -> None:
    numbers = terms.CHANNELS[channel], terms.BASES[basis]
    assert terms.is_of_plate(*numbers) == of_plate
    assert terms.Term(*numbers, 1.0).depends_on_place == of_place
