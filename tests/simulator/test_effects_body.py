"""Laws of effects that pull at the body or weigh it otherwise, worked out on paper, with their signs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulator.dynamics.model import compile_robot
from simulator.dynamics.wheel import DRAG_FORCE, fresh_contacts
from simulator.robot import Robot, load_robot
from tests.simulator.effect_probe import affected, body_force, contacts, turned, wheel_loads
from tests.simulator.plain import plain

MASS_G, GRAVITY = 0.5, 9800.0
HALF = 2.0  # half the wheelbase and half the track of the barrel robot, mm
DRIVING_UN, DRIVEN_UN = 22050.0, 2450.0
POSE = (3.0, -2.0, math.radians(30.0))


@pytest.fixture(scope="module")
def barrel() -> Robot:
    return load_robot("barrel")


def test_tether_pull_is_the_same_in_the_body_at_every_pose(barrel: Robot) -> None:
    robot = affected(barrel, "tether-pull", x_mN=0.3, y_mN=-0.7)
    for pose in (POSE, (0.0, 0.0, 2.0)):
        assert body_force(robot, pose) == pytest.approx([300.0, -700.0, 0.0])


def test_tether_spring_pulls_toward_its_anchor_in_proportion_to_the_distance(barrel: Robot) -> None:
    """From (3, -2) the anchor (8, 10) is (5, 12) away, 13 mm: 0.02 mN/mm pull with 0.26 mN."""
    robot = affected(barrel, "tether-spring", stiffness_mN_mm=0.02, anchor_x_mm=8.0, anchor_y_mm=10.0)
    in_plate = turned(POSE[2]) @ body_force(robot, POSE)[:2]
    assert in_plate == pytest.approx([100.0, 240.0])
    assert body_force(robot, (8.0, 10.0, 1.0)) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(("exponent", "size"), [(None, 0.04), (2.0, 0.04), (0.0, 1.0), (3.0, 0.008)])
def test_stray_magnet_pulls_toward_its_point_and_falls_off(barrel: Robot, exponent: float | None, size: float) -> None:
    """From (3, -2) the point (33, 38) is (30, 40) away: 50 mm, a fifth to the power of the exponent of that at 10 mm.

    d rounded off by 2 mm is √2504 mm, longer by 1 + 4/5000.
    """
    given = {} if exponent is None else {"exponent": exponent}
    robot = affected(barrel, "stray-magnet", force_mN=0.5, x_mm=33.0, y_mm=38.0, **given)
    in_plate = turned(POSE[2]) @ body_force(robot, POSE)[:2]
    rounded = math.sqrt(2500 / 2504) ** (1 + (2.0 if exponent is None else exponent))
    assert in_plate == pytest.approx(500.0 * size * rounded * np.array([0.6, 0.8]), rel=1e-12)
    assert body_force(robot, POSE)[2] == 0


def test_stray_magnet_is_rounded_off_at_its_point_by_2_mm(barrel: Robot) -> None:
    """A distance of 2 mm counts √8 mm, and the direction 2/√8."""
    robot = affected(barrel, "stray-magnet", force_mN=0.1, x_mm=5.0, y_mm=-2.0)
    assert body_force(robot, (5.0, -2.0, 1.0)) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert body_force(robot, (3.0, -2.0, 0.0))[0] == pytest.approx(100.0 * (100 / 8) * 2 / math.sqrt(8))


def test_plate_tilt_pulls_downhill_with_the_sine_of_the_weight(barrel: Robot) -> None:
    """Half the weight of 4900 µN at 30 degrees, toward azimuth 110; the robot looks to 30, so 80 to its left."""
    robot = affected(barrel, "plate-tilt", angle_deg=30.0, azimuth_deg=110.0)
    left = math.radians(80.0)
    assert body_force(robot, POSE) == pytest.approx([2450.0 * math.cos(left), 2450.0 * math.sin(left), 0.0])


@pytest.mark.parametrize("order", [("mass-offset", "plate-tilt"), ("plate-tilt", "mass-offset")])
@pytest.mark.parametrize("heading", [0.0, 0.7, -2.0])
def test_weight_on_a_slope_turns_a_robot_whose_centre_of_gravity_is_off(
    barrel: Robot, order: tuple[str, str], heading: float
) -> None:
    """The force acts at (0.6, -0.4) of the body: moment = 0.6·F_left + 0.4·F_forward."""
    values = {"mass-offset": {"x_mm": 0.6, "y_mm": -0.4}, "plate-tilt": {"angle_deg": 5.0, "azimuth_deg": 20.0}}
    robot = barrel
    for id_ in order:
        robot = affected(robot, id_, **values[id_])
    size, downhill = MASS_G * GRAVITY * math.sin(math.radians(5.0)), math.radians(20.0) - heading
    forward, left = size * math.cos(downhill), size * math.sin(downhill)
    assert body_force(robot, (1.0, 2.0, heading)) == pytest.approx([forward, left, 0.6 * left + 0.4 * forward])


def test_centre_of_gravity_ahead_and_left_loads_the_wheels_there_by_the_levers(barrel: Robot) -> None:
    """At (0.5, 1.0) of half-lengths 2 and 2: front 5/8 and left 3/4 of the weight of 4900 µN."""
    loads = wheel_loads(affected(barrel, "mass-offset", x_mm=0.5, y_mm=1.0))
    shares = np.array([5 / 8 * 3 / 4, 5 / 8 * 1 / 4, 3 / 8 * 3 / 4, 3 / 8 * 1 / 4])
    attraction = [DRIVING_UN, DRIVING_UN, DRIVEN_UN, DRIVEN_UN]
    assert loads == pytest.approx(attraction + shares * MASS_G * GRAVITY)


def test_two_mass_offsets_add_up(barrel: Robot) -> None:
    """As two magnets glued on would: the effect of an effect file and that of a fit act on one draft."""
    from simulator.dynamics.model import record_of
    from simulator.effects.catalogue import EFFECTS
    from simulator.effects.draft import Draft

    draft = Draft(barrel)
    for x, y in ((0.5, 0.2), (-0.2, 0.3)):
        act = EFFECTS["mass-offset"].act
        assert act is not None
        act(draft, {"x_mm": x, "y_mm": y})
    assert record_of(draft).tobytes() == compile_robot(affected(barrel, "mass-offset", x_mm=0.3, y_mm=0.5)).tobytes()


def test_yaw_inertia_about_the_robots_centre_has_the_parallel_axis_term(barrel: Robot) -> None:
    """0.5 g at 0.5 mm from the centre: 0.125 g·mm² more than about the centre of gravity."""
    inertia = compile_robot(affected(barrel, "mass-offset", x_mm=0.3, y_mm=-0.4))[0]["inertia"]
    assert inertia == pytest.approx(barrel.yaw_inertia_g_mm2 + 0.125)


def test_a_push_at_the_centre_turns_a_robot_about_its_centre_of_gravity(barrel: Robot) -> None:
    """Newton and Euler at the centre of gravity (x, y): F/m moves it, and I·r' = y·F_forward - x·F_left turns."""
    x, y, forward, left = 0.6, -0.4, 300.0, 500.0
    robot = affected(affected(barrel, "mass-offset", x_mm=x, y_mm=y), "tether-pull", x_mN=0.3, y_mN=0.5)
    place = (0.0, 0.0, 1.0, 0.0, 0.0)
    model, contacts = compile_robot(robot)[0], fresh_contacts()
    u, v, r = plain("equations").accelerations(0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0), place, 1e-4, model, contacts)
    assert (u - r * y, v + r * x) == pytest.approx((forward / MASS_G, left / MASS_G))
    assert barrel.yaw_inertia_g_mm2 * r == pytest.approx(y * forward - x * left)


def test_a_centre_of_gravity_that_is_off_swings_outward(barrel: Robot) -> None:
    """Turning by r on the spot, it circles at r²·(x, y): the robot feels m·r² outward, along the line to it: no moment.

    Moving at (u, v) as well, all of the mass feels m·r·(v, -u), with the lever of the centre of gravity.
    """
    robot, r = affected(barrel, "mass-offset", x_mm=0.6, y_mm=-0.4), 2.0
    assert body_force(robot, velocity=(0.0, 0.0, r)) == pytest.approx([0.5 * 4 * 0.6, 0.5 * 4 * -0.4, 0.0])
    u, v = 3.0, -1.0
    whirl = np.array([0.5 * r * v, -0.5 * r * u])
    expected = [whirl[0] + 1.2, whirl[1] - 0.8, 0.6 * whirl[1] + 0.4 * whirl[0]]
    assert body_force(robot, velocity=(u, v, r)) == pytest.approx(expected)


def test_viscous_drag_opposes_velocity_and_yaw_rate_in_proportion(barrel: Robot) -> None:
    """0.02 mN·s/mm at (3, -1) mm/s: 60 µN backward, 20 µN to the left; 40 µN·mm·s at 0.5 rad/s: 20 µN·mm."""
    robot = affected(barrel, "viscous-drag", force_mN_s_mm=0.02, moment_uN_mm_s=40.0)
    velocity = (3.0, -1.0, 0.5)
    drag = body_force(robot, POSE, velocity) - body_force(barrel, POSE, velocity)
    assert drag == pytest.approx([-60.0, 20.0, -20.0])


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_scrub_torque_is_the_radius_times_the_whole_load_against_the_yaw_rate(barrel: Robot, way: float) -> None:
    """Weight and attraction are 4900 + 2·22050 + 2·2450 = 53900 µN; at 0.02 mm that is 1078 µN·mm, without speed."""
    robot = affected(barrel, "scrub-torque", radius_mm=0.02)
    for rate in (0.3, 3.0):
        torque = body_force(robot, velocity=(0.0, 0.0, way * rate)) - body_force(
            barrel, velocity=(0.0, 0.0, way * rate)
        )
        assert torque == pytest.approx([0.0, 0.0, -1078.0 * way], rel=1e-6)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_rolling_drag_brakes_each_driven_wheel_by_its_own_load(barrel: Robot, way: float) -> None:
    """Of 4900 µN at (0, 1) each rear wheel carries 3/8 or 1/8, beside its attraction; a 50th of that brakes it."""
    robot = affected(affected(barrel, "rolling-drag", coefficient=0.02), "mass-offset", x_mm=0.0, y_mm=1.0)
    found = contacts(robot, POSE, (3.0 * way, 0.0, 0.0), (60.0 * way, 60.0 * way))[DRAG_FORCE]
    loads = np.array([0.0, 0.0, DRIVEN_UN + 4900 * 3 / 8, DRIVEN_UN + 4900 * 1 / 8])
    assert found == pytest.approx(-way * loads / 50)
