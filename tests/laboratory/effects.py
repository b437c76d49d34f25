"""The effects of the file contract, each written from its one-line definition there and from text-book laws.

Every function takes a world, or what a camera sees of it, and the parameters that the contract names, and returns the
world or the view with the effect added. Where the contract leaves a choice open, the docstring says which one is made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tests.laboratory.reference import Array, FrictionFactor, Now, Pull, Robot, Sliding, World

LENS = tuple((i, j) for i in range(4) for j in range(4) if 2 <= i + j <= 3)  # powers of x and y: bent and cubic
LENS_MM = 45.0  # from the middle of the plate to where they are 1
SETTLED = 6  # rounds in which a mark and the row that sees it agree: each leaves a hundredth of the difference


@dataclass(frozen=True)
class View:
    """What the camera and the clock make of marks: factors of time and length, keystone per mm, marks of the robot.

    rows_s_per_mm: time at which the rows of a frame are exposed, per mm along x and y.

    lens_mm: errors of place that a calibration left, rows x and y, at the powers LENS of the place in LENS_MM.
    """

    time_factor: float = 1.0
    scale: float = 1.0
    keystone_per_mm: tuple[float, float] = (0.0, 0.0)
    rows_s_per_mm: tuple[float, float] = (0.0, 0.0)
    mark_shift_mm: tuple[float, float] = (0.0, 0.0)
    mark_turn_rad: float = 0.0
    lens_mm: Array = field(default_factory=lambda: np.zeros((2, len(LENS))))

    def marks_mm(self, robot: Robot, pose: Array) -> Array:
        """Where marks appear in the plate frame: green x, y, yellow x, y, (4, times). pose: x, y, heading, (3, times).

        Keystone is a homography: a point at p appears at p / (1 - k·p), so that straight lines stay straight.
        """
        x, y, heading = pose
        c, s = np.cos(heading), np.sin(heading)
        turn, seen = self.mark_turn_rad, []
        for mark in (robot.green_mm, robot.yellow_mm):
            bx = np.cos(turn) * mark[0] - np.sin(turn) * mark[1] + self.mark_shift_mm[0]
            by = np.sin(turn) * mark[0] + np.cos(turn) * mark[1] + self.mark_shift_mm[1]
            px, py = self.scale * (x + c * bx - s * by), self.scale * (y + s * bx + c * by)
            shrink = 1 - self.keystone_per_mm[0] * px - self.keystone_per_mm[1] * py
            place = np.stack([px, py]) / shrink
            powers = [(place[0] / LENS_MM) ** i * (place[1] / LENS_MM) ** j for i, j in LENS]
            seen += list(place + np.tensordot(self.lens_mm, np.stack(powers), axes=1))
        return np.stack(seen)

    def filmed_mm(self, robot: Robot, pose_at: Callable[[Array], Array], since_s: Array) -> Array:
        """Marks as in marks_mm, each at the moment when its own row is exposed; pose_at gives poses at times."""
        seen = self.marks_mm(robot, pose_at(since_s))
        if not any(self.rows_s_per_mm):
            return seen
        for _ in range(SETTLED):
            x_delay, y_delay = self.rows_s_per_mm
            late = x_delay * seen[::2] + y_delay * seen[1::2]
            seen = np.concatenate(
                [self.marks_mm(robot, pose_at(since_s + late[k]))[2 * k : 2 * k + 2] for k in range(len(late))]
            )
        return seen


def _with_command(world: World, change: Callable[[Array], Array]) -> World:
    return replace(world, commands=(*world.commands, change))


def _with_pull(world: World, pull: Pull) -> World:
    return replace(world, pulls=(*world.pulls, pull))


def _with_friction(world: World, law: FrictionFactor) -> World:
    return replace(world, frictions=(*world.frictions, law))


def _times(first: tuple[float, ...], second: tuple[float, ...]) -> tuple[float, float, float, float]:
    a, b, c, d = np.multiply(first, second)
    return (float(a), float(b), float(c), float(d))


def in_body(now: Now, x: Array | float, y: Array | float) -> tuple[Array, Array]:
    """A vector of the plate frame in the body frame."""
    c, s = np.cos(now.heading_rad), np.sin(now.heading_rad)
    return c * x + s * y, c * y - s * x


def drive_speed_mismatch(world: World, left_over_right: float) -> World:
    """Left over right surface speed at equal command; shared evenly, so that the mean stays."""
    left = 2 * left_over_right / (1 + left_over_right)
    return _with_command(world, lambda rpm: rpm * np.array([[left], [2 - left]]))


def drive_speed_scale(world: World, factor: float) -> World:
    """Both surface speeds off by one factor."""
    return _with_command(world, lambda rpm: rpm * factor)


def motor_droop(world: World, rpm_per_uN_mm: float) -> World:
    """Rotation falls in proportion to the torque that the ground puts on the wheel."""
    return replace(world, droop_rpm_per_uN_mm=rpm_per_uN_mm)


def command_lag(world: World, dead_time_s: float, time_constant_s: float) -> World:
    """Dead time, then a first-order lag, of switching on and off."""
    return replace(world, dead_time_s=dead_time_s, lags_s=(*world.lags_s, time_constant_s))


def speed_ripple(world: World, amplitude: float, phase_deg: float) -> World:
    """Surface speed × (1 + amplitude · sin(rotation angle since the start + phase)), both wheels alike."""
    return replace(world, ripple=(amplitude, np.deg2rad(phase_deg)))


def dead_band(world: World, rpm: float) -> World:
    """No rotation below a command; above it the motor turns as commanded."""
    return _with_command(world, lambda command: np.where(np.abs(command) < rpm, 0.0, command))


def speed_drift(world: World, per_run: float) -> World:
    """Speed × (1 + per_run · number of the run in the file, the first counting 0)."""
    return _with_command(world, lambda rpm: rpm * (1 + per_run * np.arange(rpm.shape[1])))


def magnet_imbalance(world: World, left_over_right: float) -> World:
    """Left over right attraction of the driving wheels; their sum stays."""
    left = 2 * left_over_right / (1 + left_over_right)
    return replace(world, attraction=_times(world.attraction, (left, 2 - left, 1.0, 1.0)))


def magnet_strength(world: World, driving_factor: float, driven_factor: float) -> World:
    """Attraction of driving and of driven wheels off by a factor each."""
    factors = (driving_factor, driving_factor, driven_factor, driven_factor)
    return replace(world, attraction=_times(world.attraction, factors))


def friction_level(world: World, factor: float) -> World:
    """Both friction coefficients off by a factor; stiffness stays."""
    return _with_friction(world, lambda _now, sliding: np.full_like(sliding.x_mm, factor))


def wheel_toe(world: World, left_deg: float, right_deg: float) -> World:
    """Driving wheels turned about the vertical, counter-clockwise."""
    return replace(world, toe_rad=(float(np.deg2rad(left_deg)), float(np.deg2rad(right_deg)), 0.0, 0.0))


def rolling_drag(world: World, coefficient: float) -> World:
    """Driven wheels resist rolling with coefficient × load."""
    return replace(world, rolling_drag=coefficient)


def scrub_torque(world: World, radius_mm: float) -> World:
    """Each contact patch resists spinning about the vertical with radius × load, against the sense of the turn."""
    return replace(world, scrub_radius_mm=radius_mm)


def axle_compliance(world: World, deg_per_mN: float) -> World:
    """Each axle turns as a whole, counter-clockwise for a force to the left on its two wheels together."""
    return replace(world, compliance_rad_per_mN=float(np.deg2rad(deg_per_mN)))


def mass_offset(world: World, x_mm: float, y_mm: float) -> World:
    """Centre of gravity off the middle: weight shares shift, inertia and the pull of a slope act there."""
    return replace(world, centre_of_gravity_mm=(x_mm, y_mm))


def plate_tilt(world: World, angle_deg: float, azimuth_deg: float) -> World:
    """The weight pulls downhill at the centre of gravity."""
    pull, way = np.sin(np.deg2rad(angle_deg)), np.deg2rad(azimuth_deg)

    def downhill(now: Now, world: World) -> tuple[Array, Array, Array]:
        x, y = in_body(now, world.robot.weight_mN * pull * np.cos(way), world.robot.weight_mN * pull * np.sin(way))
        at_x, at_y = world.centre_of_gravity_mm
        return x, y, at_x * y - at_y * x

    return _with_pull(world, downhill)


def tether_pull(world: World, x_mN: float, y_mN: float) -> World:
    """A force fixed in the body, at its centre."""
    return _with_pull(world, lambda now, _world: (0 * now.x_mm + x_mN, 0 * now.x_mm + y_mN, 0 * now.x_mm))


def tether_spring(world: World, stiffness_mN_mm: float, anchor_x_mm: float, anchor_y_mm: float) -> World:
    """A spring without slack between the centre of the robot and an anchor on the plate."""

    def spring(now: Now, _world: World) -> tuple[Array, Array, Array]:
        x, y = stiffness_mN_mm * (anchor_x_mm - now.x_mm), stiffness_mN_mm * (anchor_y_mm - now.y_mm)
        return (*in_body(now, x, y), 0 * now.x_mm)

    return _with_pull(world, spring)


def viscous_drag(world: World, force_mN_s_mm: float, moment_uN_mm_s: float) -> World:
    """Force against the velocity of the centre, moment against the yaw rate (per rad/s)."""

    def drag(now: Now, _world: World) -> tuple[Array, Array, Array]:
        moment = -moment_uN_mm_s * 1e-3 * now.yaw_rate_rad_s
        return -force_mN_s_mm * now.u_mm_s, -force_mN_s_mm * now.v_mm_s, moment

    return _with_pull(world, drag)


def friction_gradient(world: World, per_mm_x: float, per_mm_y: float) -> World:
    """Friction × (1 + per_mm · place of the wheel on the plate)."""
    return _with_friction(world, lambda _now, s: np.maximum(1 + per_mm_x * s.x_mm + per_mm_y * s.y_mm, 0.05))


def friction_grain(world: World, amplitude: float, direction_deg: float) -> World:
    """Friction × (1 + amplitude · cos 2(direction of sliding - direction)): grinding marks are lines."""

    def grain(_now: Now, sliding: Sliding) -> Array:
        return 1 + amplitude * np.cos(2 * (sliding.direction_rad - np.deg2rad(direction_deg)))

    return _with_friction(world, grain)


def stray_magnet(world: World, force_mN: float, x_mm: float, y_mm: float, exponent: float = 2.0) -> World:
    """Attraction force_mN · (10 mm / d)^exponent towards a point, d = sqrt(distance² + (2 mm)²)."""

    def attract(now: Now, _world: World) -> tuple[Array, Array, Array]:
        x, y = x_mm - now.x_mm, y_mm - now.y_mm
        d = np.sqrt(x**2 + y**2 + 2.0**2)
        force = force_mN * (10 / d) ** exponent
        return (*in_body(now, force * x / d, force * y / d), 0 * d)

    return _with_pull(world, attract)


def mark_offset(view: View, x_mm: float, y_mm: float, angle_deg: float) -> View:
    """Marks turned about the robot's centre, then moved, in the body frame."""
    return replace(view, mark_shift_mm=(x_mm, y_mm), mark_turn_rad=float(np.deg2rad(angle_deg)))


def plane_scale(view: View, factor: float) -> View:
    """Lengths read off the images are true lengths × factor."""
    return replace(view, scale=view.scale * factor)


def time_base(view: View, factor: float) -> View:
    """Times read off the recording are true times × factor, counted from the start of the motors."""
    return replace(view, time_factor=view.time_factor * factor)


def camera_tilt(view: View, per_mm_x: float, per_mm_y: float) -> View:
    """Keystone: the scale changes across the image."""
    return replace(view, keystone_per_mm=(per_mm_x, per_mm_y))


def rolling_shutter(view: View, x_ms_per_mm: float, y_ms_per_mm: float) -> View:
    """Rows of a frame are exposed one after another; the row through the origin at the time of the frame."""
    return replace(view, rows_s_per_mm=(x_ms_per_mm / 1000, y_ms_per_mm / 1000))


PHYSICAL = {
    law.__name__.replace("_", "-"): law
    for law in (
        drive_speed_mismatch,
        drive_speed_scale,
        motor_droop,
        command_lag,
        speed_ripple,
        dead_band,
        speed_drift,
        magnet_imbalance,
        magnet_strength,
        friction_level,
        wheel_toe,
        rolling_drag,
        scrub_torque,
        axle_compliance,
        mass_offset,
        plate_tilt,
        tether_pull,
        tether_spring,
        viscous_drag,
        friction_gradient,
        friction_grain,
        stray_magnet,
    )
}
SEEN = {
    law.__name__.replace("_", "-"): law for law in (mark_offset, plane_scale, time_base, camera_tilt, rolling_shutter)
}


def add_effect(world: World, view: View, effect: str, parameters: Mapping[str, float]) -> tuple[World, View]:
    """Add an effect by its id."""
    if effect in SEEN:
        return world, SEEN[effect](view, **parameters)
    return PHYSICAL[effect](world, **parameters), view
