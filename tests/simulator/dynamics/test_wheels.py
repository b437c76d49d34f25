"""Wheels on the plate, compared with what they must do: each channel of a term, friction, motors that droop, axles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulator.dynamics import terms
from simulator.dynamics.terms import Term
from simulator.robot import load_robot
from tests.simulator.dynamics.touching import (
    COMPLIANT,
    EFFECTS,
    MOVING,
    PER_RPM,
    POSE,
    REST,
    WHEEL_X,
    WHEEL_Y,
    Vector,
    barrel,
    factors,
    forces_of,
    touched,
    with_all,
)
from tests.simulator.effect_probe import affected
from tests.simulator.plain import plain
from tests.simulator.reference import plain_rates


@pytest.mark.parametrize(
    ("channel", "basis", "expected"),
    [
        # Force at small slip is grip times steepness: it goes with load and stiffness, not with friction.
        ("load", "load", [1.25, 1.25, 1.0, 1.0]),
        ("load", "weight", [1.25, 1.25, 0.8, 0.8]),
        ("friction", "load", [1.25, 1.25, 0.8, 0.8]),
        ("friction", "weight", [1.25, 1.25, 0.8, 0.8]),
        ("friction_across", "load", [1.0, 1.25, 1.0, 0.8]),
        ("stiffness", "load", [1.0, 1.0, 1.25, 1.25]),
    ],
)
def test_load_friction_and_stiffness_change_limit_and_slope_of_friction(
    channel: str, basis: str, expected: list[float]
) -> None:
    added = Term(terms.CHANNELS[channel], terms.ONE, 0.25)
    assert factors(barrel(stiffness_basis=basis), added) == pytest.approx(expected)
    half = Term(terms.CHANNELS[channel], terms.ONE, 0.125)
    assert factors(barrel(stiffness_basis=basis), half, half) == pytest.approx(expected)  # terms add


@pytest.mark.parametrize(
    ("channel", "grips"), [("load", [0.02, 0.02]), ("friction", [0.02, 0.02]), ("friction_across", [1.0, 0.02])]
)
def test_no_term_weakens_a_wheel_below_two_per_cent(channel: str, grips: list[float]) -> None:
    assert factors(barrel(), Term(terms.CHANNELS[channel], terms.ONE, -3.0))[:2] == pytest.approx(grips)
    assert factors(barrel(), Term(terms.STIFFNESS, terms.ONE, -3.0)) == pytest.approx([1.0, 1.0, 0.02, 0.02])


def test_speed_terms_add_shares_of_the_commanded_speed_of_their_wheels() -> None:
    added = [Term(terms.SPEED, terms.ONE, share, "driving-left-right") for share in (0.1, 0.2)]
    surface = touched(barrel(), *added, rpm=(60.0, 30.0))[1][plain("wheel").SURFACE]
    assert surface == pytest.approx([60 * PER_RPM * 1.3, 30 * PER_RPM * 0.7, 0.0, 0.0])
    nominal = touched(barrel(), rpm=(60.0, -30.0))[1][plain("wheel").SURFACE]
    assert nominal == pytest.approx([60 * PER_RPM, -30 * PER_RPM, 0.0, 0.0])


def test_steer_and_drag_add_to_what_a_wheel_has() -> None:
    wheel = plain("wheel")
    robot = affected(barrel(), "wheel-toe", left_deg=3.0, right_deg=-2.0)
    added = [Term(terms.STEER, terms.ONE, math.radians(1.0)), *[Term(terms.DRAG, terms.ONE, 20.0, "left-right")] * 2]
    contacts = touched(robot, *added)[1]
    angle = np.degrees(np.arctan2(contacts[wheel.SIN_STEER], contacts[wheel.COS_STEER]))
    assert angle == pytest.approx([4.0, -1.0, 1.0, 1.0])
    assert contacts[wheel.DRAG_FORCE].tolist() == [40.0, -40.0, 40.0, -40.0]


@pytest.mark.parametrize(
    ("basis", "expected"),
    [
        ("u", 3.0 - 0.5 * WHEEL_Y),
        ("v", -1.0 + 0.5 * WHEEL_X),
        ("yaw_rate", np.full(4, 0.5)),
        ("x", 10 + math.cos(POSE[2]) * WHEEL_X - 0.5 * WHEEL_Y),
        ("y", -20 + 0.5 * WHEEL_X + math.cos(POSE[2]) * WHEEL_Y),
        ("sin_heading", np.full(4, 0.5)),
        ("time", np.full(4, 1.0)),
        ("sin_wheel_angle", [math.sin(0.4), math.sin(-1.2), 0.0, 0.0]),  # wheels that roll freely have none
        ("cos_wheel_angle", [math.cos(0.4), math.cos(-1.2), 1.0, 1.0]),
    ],
)
def test_terms_of_wheels_take_the_state_of_each_wheel(basis: str, expected: np.ndarray) -> None:
    added = Term(terms.DRAG, terms.BASES[basis], 2.0)
    contacts = touched(barrel(), added, velocity=(3.0, -1.0, 0.5), turned=(0.4, -1.2), pose=POSE)[1]
    assert contacts[plain("wheel").DRAG_FORCE] == pytest.approx(2.0 * np.asarray(expected))


def test_pull_toward_a_point_is_that_at_each_wheel() -> None:
    """A point 1000 mm ahead of the front axle: 1002 mm from the rear one's height, and the same way."""
    added = Term(terms.DRAG, terms.TOWARD_X, 5.0, point_mm=(1002.0, 2.0), falloff=1.0)
    drag = touched(barrel(), added)[1][plain("wheel").DRAG_FORCE]
    assert drag == pytest.approx([5e-2, 5e-2, 5e-2 / 1.004, 5e-2 / 1.004], rel=3e-5)


def test_direction_of_sliding_is_that_of_the_contact_in_the_plate() -> None:
    """Wheels at 60 rpm on a robot at rest slide backward; one that rolls freely slides along its axle only."""
    added = Term(terms.DRAG, terms.SLIDE_SIN2, 1.0)
    spins = touched(barrel(), added, pose=(0.0, 0.0, math.radians(20.0)))[1][plain("wheel").DRAG_FORCE]
    assert spins[:2] == pytest.approx([math.sin(math.radians(40.0))] * 2)
    slides = touched(barrel(), added, velocity=(60 * PER_RPM + 0.3, 0.4, 0.0), pose=(0.0, 0.0, math.radians(20.0)))
    drag = slides[1][plain("wheel").DRAG_FORCE]
    driven, free = math.radians(20.0) + math.atan2(0.4, 0.3), math.radians(110.0)
    assert drag == pytest.approx([math.sin(2 * driven)] * 2 + [math.sin(2 * free)] * 2, rel=1e-5)


def test_a_share_of_friction_opposes_the_sliding_with_the_grip_and_steepness_that_the_wheel_has_then() -> None:
    wheel, motion, scaled = plain("wheel"), (0.2, 0.6), (2.0, 3.0, 0.5, 0.7)

    def force(share: float) -> np.ndarray:
        robot = affected(barrel(), "sliding-friction", share=share) if share else barrel()
        model, contacts = touched(robot)
        contacts[[wheel.GRIP_X, wheel.GRIP_Y, wheel.STEEP_X, wheel.STEEP_Y], 0] = scaled
        return np.array(wheel.law(*motion, 0, contacts, REST, model))

    model, contacts = touched(barrel())
    law = [float(model[name][0]) for name in ("grip_x", "grip_y", "steep_x", "steep_y")]
    shape = [float(model[name][0]) for name in ("ratio", "shape_x", "shape_y", "decrease")]
    given = *motion, contacts[wheel.SURFACE, 0], 1.0, *np.multiply(law, scaled), *shape, REST
    turning, opposed = (plain("law").wheel_slopes(*given)[:2], plain("law").sliding_slopes(*given)[:2])
    assert abs(turning[1] / opposed[1]) > 1.2
    assert force(0.0) == pytest.approx(turning)
    assert force(1.0) == pytest.approx(opposed)
    assert force(0.4) == pytest.approx(0.6 * np.array(turning) + 0.4 * np.array(opposed))


@pytest.mark.parametrize("name", ["barrel", "tire"])
def test_nominal_accelerations_are_those_of_the_equations_in_plain_python(name: str) -> None:
    robot = load_robot(name)
    rates = plain_rates(robot, 40.0, 25.0, REST)
    for velocity in np.random.default_rng(1).normal([1.0, 0.1, -0.2], [1.0, 0.5, 0.4], (5, 3)):
        model, contacts = touched(robot, rpm=(40.0, 25.0))
        place = 0.0, 0.0, 1.0, 0.0, 0.0
        found = plain("equations").accelerations(*velocity, (40.0, 25.0, 0.0, 0.0), place, REST, model, contacts)
        assert found == pytest.approx(rates(0.0, np.array([0.0, 0.0, 0.0, *velocity]))[3:], rel=1e-9)


@pytest.mark.parametrize("velocity", MOVING)
def test_both_ways_to_work_out_friction_agree(velocity: Vector) -> None:
    model, contacts = touched(with_all(EFFECTS), velocity=velocity, rpm=(40.0, 25.0))
    one = forces_of(model, contacts, velocity)
    other = plain("contact").friction_slopes(*velocity, contacts, REST, model)[0]
    assert other == pytest.approx(one, rel=1e-12)


@pytest.mark.parametrize("velocity", MOVING)
def test_a_steered_wheel_is_the_straight_one_seen_from_a_robot_turned_as_far(velocity: Vector) -> None:
    """All wheels turned by 0.3 rad about themselves: turn velocity and force back, with the wheels' places."""
    model, contacts = touched(barrel(), rpm=(40.0, 25.0))
    steered = contacts.copy()
    steered[plain("wheel").COS_STEER], steered[plain("wheel").SIN_STEER] = math.cos(0.3), math.sin(0.3)
    steered[plain("wheel").DRAG_FORCE] = contacts[plain("wheel").DRAG_FORCE] = [5.0, -3.0, 2.0, 9.0]
    turn = np.array([[math.cos(0.3), -math.sin(0.3)], [math.sin(0.3), math.cos(0.3)]])
    back = model.copy()
    back["wheel_x"], back["wheel_y"] = turn.T @ [model["wheel_x"], model["wheel_y"]]
    u, v = turn.T @ velocity[:2]
    straight = forces_of(back, contacts, (u, v, velocity[2]))
    assert forces_of(model, steered, velocity) == pytest.approx([*(turn @ straight[:2]), straight[2]], rel=1e-9)


@pytest.mark.parametrize("velocity", MOVING)
def test_accelerations_are_all_forces_over_the_mass_wherever_the_centre_of_gravity_is(velocity: Vector) -> None:
    """Newton for the centre of gravity, Euler about the robot's centre: the mass matrix times the accelerations."""
    robot = with_all(EFFECTS)
    model, contacts = touched(robot, velocity=velocity, rpm=(40.0, 25.0))
    place = 0.0, 0.0, 1.0, 0.0, 1.0
    found = plain("equations").accelerations(*velocity, (40.0, 25.0, 0.0, 0.0), place, REST, model, contacts)
    mass, x, y = robot.body.mass_g, 0.3, -0.2
    about = robot.yaw_inertia_g_mm2 + mass * (x * x + y * y)
    matrix = np.array([[mass, 0.0, -mass * y], [0.0, mass, mass * x], [-mass * y, mass * x, about]])
    loads = np.array(plain("body").loads(*velocity, place, REST, model))
    assert matrix @ found == pytest.approx(forces_of(model, contacts, velocity) + loads, rel=1e-9)


@pytest.mark.parametrize("surface", [0.0, 1e9, -1e9, 2.0])
@pytest.mark.parametrize("u", [0.0, 1.0, 2.094, 6.0, -4.0])
def test_a_motor_droops_by_its_share_of_the_force_it_drives_with(u: float, surface: float) -> None:
    """Speed lost = rpm per µN·mm × 0.5 mm × force along the wheel, in rpm; found from any guess."""
    wheel = plain("wheel")
    robot = affected(barrel(), "motor-droop", rpm_per_uN_mm=2e-3)
    model, contacts = touched(robot, velocity=(u, 0.2, 0.1), rpm=(40.0, 40.0), surface=surface)
    for number in (0, 1):
        at_u, at_v = u - 0.1 * WHEEL_Y[number], 0.2 + 0.1 * WHEEL_X[number]
        force = wheel.law(at_u, at_v, number, contacts, REST, model)[0]
        lost = 40.0 - contacts[wheel.SURFACE, number] / PER_RPM
        assert lost == pytest.approx(2e-3 * 0.5 * force, abs=1e-9)
        assert lost * (40 * PER_RPM - at_u) > 0  # behind its command where it pulls, ahead where it is pushed
    assert contacts[wheel.DROOP].tolist() == pytest.approx([2e-3 * 0.5 * PER_RPM] * 2 + [0.0] * 2)


def test_a_motor_that_is_told_to_stand_does_not_droop() -> None:
    robot = affected(barrel(), "motor-droop", rpm_per_uN_mm=2e-3)
    contacts = touched(robot, velocity=(1.0, 0.0, 0.0), rpm=(0.0, 40.0))[1]
    assert contacts[plain("wheel").SURFACE, 0] == contacts[plain("wheel").DROOP, 0] == 0.0
    assert contacts[plain("wheel").DROOP, 1] > 0


@pytest.mark.parametrize("velocity", MOVING)
def test_axles_give_way_to_what_the_rest_of_the_robot_presses_them_with(velocity: Vector) -> None:
    """About the middle of one axle, an axle's force across has the moment that balances all others.

    Their angle is the compliance times the force across them: of the force sideways and of that forward, seen from the
    turned axle.
    """
    wheel, robot = plain("wheel"), with_all({name: COMPLIANT[name] for name in COMPLIANT if name != "motor-droop"})
    model, contacts = touched(robot, velocity=velocity, rpm=(40.0, 25.0), pose=(3.0, -2.0, 0.0))
    place = 3.0, -2.0, 1.0, 0.0, 1.0
    pressed_x, pressed_y, moment = plain("body").loads(*velocity, place, REST, model)
    del pressed_x
    forces = [np.array(wheel.wheel_response(number, *velocity, contacts, REST, model))[:2] for number in range(4)]
    along = [force[0] for force in forces]
    twist = moment - sum(y * force for y, force in zip(WHEEL_Y, along, strict=True))  # about the robot's centre
    angles = contacts[wheel.AXLE_ANGLE]
    assert angles[0] == angles[1]
    assert angles[2] == angles[3]
    for first, other_x in ((0, -2.0), (2, 2.0)):
        lever = model["wheel_x"][first] - other_x
        across = -(twist - other_x * pressed_y) / lever  # moments about (other_x, 0): the other axle's has none
        forward = along[first] + along[first + 1]
        expected = math.cos(angles[first]) * across - math.sin(angles[first]) * forward
        assert math.degrees(angles[first]) == pytest.approx(4.0 * expected / 1000.0, rel=1e-6)
        assert abs(angles[first]) > 1e-4
