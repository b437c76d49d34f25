"""Sign-sensitive closed forms of effects: which way, and by how much where a text-book says it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.laboratory import outside
from tests.laboratory.effects import PHYSICAL, SEEN, View, add_effect
from tests.laboratory.motion import simulate, surface_speeds_mm_s
from tests.laboratory.reference import Array, Now, Robot, World, forces, weight_shares_mN
from tests.laboratory.test_reference import drive, radius_mm


def at(x: float = 0.0, y: float = 0.0, heading: float = 0.0, u: float = 0.0, v: float = 0.0, spin: float = 0.0) -> Now:
    one = np.ones(1)
    return Now(
        0 * one, x * one, y * one, heading * one, 0 * one, 0 * one, u * one, v * one, spin * one, np.zeros((4, 1))
    )


def pull(effect: str, now: Now, **parameters: float) -> Array:
    world, _ = add_effect(World(), View(), effect, parameters)
    return np.concatenate(world.pulls[0](now, world))


def sideways(effect: str, **parameters: float) -> float:
    """How far a straight run forward ends to the left."""
    world, _ = add_effect(World(), View(), effect, parameters)
    return float(drive(world, 40, 40, 2.0).y_mm[-1, 0])


def test_plate_tilt_pulls_downhill_with_its_share_of_the_weight() -> None:
    downhill = 4.9 * np.sin(np.deg2rad(2))
    assert pull("plate-tilt", at(heading=np.pi / 2), angle_deg=2, azimuth_deg=90) == pytest.approx([downhill, 0, 0])
    assert sideways("plate-tilt", angle_deg=8, azimuth_deg=90) > 0.005


def test_tether_spring_pulls_toward_its_anchor() -> None:
    force = pull("tether-spring", at(x=10, heading=np.pi), stiffness_mN_mm=0.02, anchor_x_mm=30, anchor_y_mm=0)
    assert force == pytest.approx([-0.4, 0, 0])


def test_tether_pull_is_fixed_in_the_body() -> None:
    assert pull("tether-pull", at(heading=1.0), x_mN=0.1, y_mN=-0.2) == pytest.approx([0.1, -0.2, 0])


def test_stray_magnet_attracts_with_the_stated_force() -> None:
    far = pull("stray-magnet", at(), force_mN=1.0, x_mm=20, y_mm=0)
    d = np.hypot(20, 2)
    assert far == pytest.approx([(10 / d) ** 2 * 20 / d, 0, 0])


def test_viscous_drag_opposes_motion() -> None:
    drag = pull("viscous-drag", at(u=2, v=-1, spin=0.5), force_mN_s_mm=0.1, moment_uN_mm_s=200)
    assert drag == pytest.approx([-0.2, 0.1, -0.1])


def test_compliant_axles_make_backward_turns_half_a_percent_tighter() -> None:
    world, _ = add_effect(World(), View(), "axle-compliance", {"deg_per_mN": 1.1})
    ratio = radius_mm(drive(world, -33.3, -14.4)) / radius_mm(drive(world, 33.3, 14.4))
    assert 0.97 < ratio < 0.9995


def test_a_faster_left_wheel_turns_right() -> None:
    assert sideways("drive-speed-mismatch", left_over_right=1.02) < -0.003


def test_wheels_toed_to_the_left_lead_left() -> None:
    assert sideways("wheel-toe", left_deg=1.0, right_deg=1.0) > 0.01


def test_offset_weight_loads_the_wheels_on_its_side_and_no_more_in_sum() -> None:
    world, _ = add_effect(World(), View(), "mass-offset", {"x_mm": 0.5, "y_mm": 0.2})
    shares = weight_shares_mN(world)
    assert shares.sum() == pytest.approx(4.9)
    assert shares @ World().robot.wheels_mm == pytest.approx(4.9 * np.array([0.5, 0.2]))


@pytest.mark.parametrize(
    ("effect", "parameters"),
    [("rolling-drag", {"coefficient": 0.05}), ("scrub-torque", {"radius_mm": 0.05})],
)
def test_drag_of_contacts_opposes_motion_forward_and_backward(effect: str, parameters: dict[str, float]) -> None:
    world, _ = add_effect(World(), View(), effect, parameters)
    for sense in (1, -1):
        now, speeds = at(u=sense * 2.0, spin=sense * 0.5), np.array([[sense * 1.0], [sense * 3.0]])
        bare, dragged = forces(World(), now, speeds), forces(world, now, speeds)
        extra = (
            dragged.force_x_mN - bare.force_x_mN
            if effect == "rolling-drag"
            else dragged.moment_mN_mm - bare.moment_mN_mm
        )
        assert extra[0] * sense < 0


def test_droop_slows_the_motor_that_carries_the_load_and_widens_turns() -> None:
    world, _ = add_effect(World(), View(), "motor-droop", {"rpm_per_uN_mm": 5e-4})
    assert radius_mm(drive(world, 33.3, 14.4)) > 1.01 * radius_mm(drive(World(), 33.3, 14.4))


def test_commands_are_changed_as_defined() -> None:
    rpm, times = np.array([[10.0, 40.0], [10.0, 40.0]]), np.array([[0.0, 0.0], [1.0, 1.0]])

    def speeds(effect: str, **parameters: float) -> Array:
        world, _ = add_effect(World(), View(), effect, parameters)
        return surface_speeds_mm_s(world, rpm, times, np.array([9.0, 9.0]))[0][-1]

    full = speeds("drive-speed-scale", factor=1.0)
    assert speeds("dead-band", rpm=12) == pytest.approx(full * [0, 1])
    assert speeds("speed-drift", per_run=0.01) == pytest.approx(full * [1, 1.01])
    assert speeds("command-lag", dead_time_s=0.2, time_constant_s=0.4) == pytest.approx(full * (1 - np.exp(-2)))


def test_friction_depends_on_place_and_on_direction_of_sliding() -> None:
    """Wheels slide to the left: forces to the right, by a factor that the place or the grain gives."""
    speeds = np.zeros((2, 1))

    def ratio(effect: str, now: Now, **parameters: float) -> float:
        world, _ = add_effect(World(), View(), effect, parameters)
        return float((forces(world, now, speeds).force_y_mN / forces(World(), now, speeds).force_y_mN)[0])

    assert ratio("friction-gradient", at(x=10, v=1.0), per_mm_x=0.01, per_mm_y=0.0) == pytest.approx(1.1, abs=0.03)
    assert ratio("friction-grain", at(v=1.0), amplitude=0.2, direction_deg=90) == pytest.approx(1.2, abs=0.05)
    assert ratio("friction-grain", at(v=-1.0), amplitude=0.2, direction_deg=90) == pytest.approx(1.2, abs=0.05)
    assert ratio("friction-grain", at(v=1.0), amplitude=0.2, direction_deg=0) == pytest.approx(0.8, abs=0.05)


def test_marks_are_seen_where_the_definitions_put_them() -> None:
    robot = Robot(green_mm=(-1.0, 2.0), yellow_mm=(-1.0, -2.0))
    pose = np.array([[10.0], [0.0], [np.pi / 2]])

    def green(effect: str, **parameters: float) -> Array:
        _, view = add_effect(World(), View(), effect, parameters)
        return view.marks_mm(robot, pose)[:2, 0]

    assert green("plane-scale", factor=1.0) == pytest.approx([8, -1])
    assert green("plane-scale", factor=1.1) == pytest.approx([8.8, -1.1])
    assert green("mark-offset", x_mm=0.5, y_mm=0.0, angle_deg=90) == pytest.approx([11, -1.5])
    assert green("camera-tilt", per_mm_x=0.001, per_mm_y=0.0)[0] == pytest.approx(8 * 1.008, rel=1e-3)


def test_rows_that_are_exposed_later_show_the_robot_further_on() -> None:
    """20 mm from the origin along y at 10 mm/s along x; a mark that moves along y is met a hundredth later."""
    _, view = add_effect(World(), View(), "rolling-shutter", {"x_ms_per_mm": 0.0, "y_ms_per_mm": 1.0})
    robot, since = Robot(green_mm=(0.0, 0.0), yellow_mm=(0.0, -20.0)), np.array([0.0, 1.0])

    def along(x: float, y: float) -> Array:
        return view.filmed_mm(robot, lambda t: np.stack([x * t, 20 + y * t, 0 * t]), since)

    assert along(10.0, 0.0) == pytest.approx(np.array([[0.2, 10.2], [20, 20], [0, 10], [0, 0]]))
    assert along(0.0, 10.0)[1, 0] == pytest.approx(20 / 0.99)


@pytest.mark.parametrize("kind", outside.KINDS)
def test_outside_physics_moves_the_robot(kind: str) -> None:
    world = outside.KINDS[kind](World(), 1.0, 0.7)
    commands, pose, lasts = np.array([[33.3, 60.0], [14.4, 60.0]]), np.zeros((3, 2)), np.array([2.0, 2.0])
    bare, changed = simulate(World(), commands, pose, lasts), simulate(world, commands, pose, lasts)
    assert np.hypot(changed.x_mm - bare.x_mm, changed.y_mm - bare.y_mm).max() > 1e-3


def test_every_effect_of_the_contract_is_there() -> None:
    assert len(PHYSICAL) + len(SEEN) == 27
