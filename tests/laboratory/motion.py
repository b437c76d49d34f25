"""Motion of the reference robot: many runs side by side, by implicit steps on the full equations of motion.

Slip relaxes within some 50 µs, a run lasts 10 s. So every step solves mass × (change of velocity / step) = forces
at its end by Newton's method: implicit Euler for the velocity, whose inertial part is 1e-4 of the friction. The pose
follows by the trapezoidal rule. `simulate_in_full` solves the same equations with SciPy's Radau, as a check.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.interpolate import CubicHermiteSpline

from tests.laboratory.reference import MM_S_PER_RPM_MM, Array, Now, World, forces, inertia_mN

STEP_S = 1 / 60  # paths change by less than 0.5 µm with half of it (tested)
FIRST_STEP_S = 2e-4
STANDING_MM_S = 0.05  # static friction holds a robot whose wheels turn slower than 1 rpm; moves paths by 0.4 µm
UNBALANCED_MN = 1e-7  # of forces of some mN
SHORTEST_LAG_S = 1e-3  # a jump of speed would keep Newton's method from its balance; session.py takes it back out
ROUNDINGS_MM_S = (0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4)
DROOP_LAG_S = 5e-3  # a load slows a motor as fast as a command speeds it up


@dataclass(frozen=True)
class Motion:
    """Poses of all runs on their own times (time since the motors were switched on), each (times, runs)."""

    time_s: Array
    x_mm: Array
    y_mm: Array
    heading_rad: Array
    velocity: Array  # u, v, yaw rate in the body frame, (times, 3, runs)

    def pose_at(self, run: int, time_s: Array) -> Array:
        """x, y, heading at given times, (3, times); the robot stands before the first and after the last node."""
        nodes = self.time_s[:, run]
        u, v, spin = self.velocity[:, :, run].T
        heading = self.heading_rad[:, run]
        slopes = u * np.cos(heading) - v * np.sin(heading), u * np.sin(heading) + v * np.cos(heading), spin
        values = self.x_mm[:, run], self.y_mm[:, run], heading
        inside = np.clip(time_s, nodes[0], nodes[-1])
        return np.stack([CubicHermiteSpline(nodes, a, b)(inside) for a, b in zip(values, slopes, strict=True)])


def simulate(world: World, command_rpm: Array, start_pose: Array, stop_s: Array) -> Motion:
    """Drive all runs. command_rpm: left, right, (2, runs); start_pose: x, y, heading, (3, runs); stop_s: (runs,)."""
    times = _times(stop_s, world.dead_time_s + 8 * max((SHORTEST_LAG_S, *world.lags_s)))
    surface, powered = surface_speeds_mm_s(world, command_rpm, times, stop_s)
    runs = len(stop_s)
    pose, velocity = start_pose.astype(float).copy(), np.zeros((3, runs))
    extra = np.zeros((2 * bool(world.compliance_rad_per_mN) + 2 * bool(world.droop_rpm_per_uN_mm), runs))
    travelled, drive, before = np.zeros(runs), np.zeros((4, runs)), np.zeros((3, runs))
    poses, velocities = [pose], [velocity]
    newton = _Newton()
    for k in range(1, len(times)):
        step = times[k] - times[k - 1]
        last = times[k - 1] - times[k - 2] if k > 1 else step
        slope = _plate_rate(pose[2], velocity)
        guess = pose + step * (slope + step / (2 * last) * (slope - before))

        def residual(
            unknown: Array,
            world: World = world,
            k: int = k,
            step: Array = step,
            guess: Array = guess,
            old: Array = velocity,
            extra: Array = extra,
        ) -> tuple[Array, Array]:
            now = Now(times[k], *guess, start_pose[2], travelled, *unknown[:3], last_drive_mN=drive)  # noqa: B023
            return _residual(world, now, unknown, old, step, surface[k], powered[k], extra)

        growth = np.abs(surface[k]).max(axis=0) / np.maximum(np.abs(surface[k - 1]).max(axis=0), 1e-12)
        guess_velocity = velocity * np.where(growth < 1e3, growth, 1.0)  # the slip law knows no scale of velocity
        rolling = np.vstack([_rolling(world, surface[k]), extra])
        unknown, drive = newton.solve(residual, world, np.vstack([guess_velocity, extra]), rolling)
        before, velocity, extra = slope, unknown[:3], unknown[3:]
        pose = pose + step / 2 * (slope + _plate_rate(guess[2], velocity))
        travelled = travelled + step * np.hypot(velocity[0], velocity[1])
        poses.append(pose)
        velocities.append(velocity)
    x, y, heading = np.stack(poses, axis=1)
    return Motion(times, x, y, heading, np.stack(velocities))


def surface_speeds_mm_s(world: World, command_rpm: Array, times: Array, stop_s: Array) -> tuple[Array, Array]:
    """Surface speeds of the front wheels, and how far their motors are switched on (0 to 1), (times, 2, runs)."""
    rpm = np.asarray(command_rpm, dtype=float)
    for change in world.commands:
        rpm = change(rpm)
    after_off = np.repeat((times - stop_s)[:, None, :], 2, axis=1)
    response = _step_response(world, np.repeat(times[:, None, :], 2, axis=1)) - _step_response(world, after_off)
    rotation = rpm * response  # (times, 2, runs)
    angle = cumulative_trapezoid(rotation * MM_S_PER_RPM_MM, times[:, None, :], axis=0, initial=0.0)
    for side, dead in enumerate(world.backlash_rad):
        if dead:  # the gear train turns through its backlash before the wheel moves
            idle = dead / np.maximum(np.abs(rpm[side]) * MM_S_PER_RPM_MM, 1e-9)
            late = _step_response(world, times - idle) - _step_response(world, times - stop_s)
            rotation[:, side] = rpm[side] * np.maximum(late, 0.0)
    amplitude, phase = world.ripple
    surface = rotation * MM_S_PER_RPM_MM * world.robot.wheel_radius_mm * (1 + amplitude * np.sin(angle + phase))
    return surface, response * (rpm != 0)


def _step_response(world: World, since_s: Array) -> Array:
    """Rotation over command after a step: dead time, then first-order lags one after the other."""
    since = np.asarray(since_s) - world.dead_time_s
    lags = [lag for lag in world.lags_s if lag > 0] or [SHORTEST_LAG_S]
    lags = [lag * (1 + 1e-6 * i) for i, lag in enumerate(lags)]  # equal lags would divide by zero
    positive = np.maximum(since, 0.0)
    total = np.ones_like(positive)
    for i, lag in enumerate(lags):
        weight = np.prod([lag / (lag - other) for j, other in enumerate(lags) if j != i])
        total -= weight * np.exp(-positive / lag)
    return np.where(since > 0, total, 0.0)


def _times(stop_s: Array, run_down_s: float) -> Array:
    """Nodes per run: small steps after switching on and off, STEP_S between, (times, runs); then the robot stands."""
    ramp = np.concatenate([[0.0], np.cumsum(FIRST_STEP_S * 1.35 ** np.arange(14))])
    middle = max(int(np.ceil((stop_s.max() - ramp[-1]) / STEP_S)), 2)
    share = np.linspace(0, 1, middle + 1)[1:]
    parts = [np.repeat(ramp[:, None], len(stop_s), axis=1), ramp[-1] + share[:, None] * (stop_s - ramp[-1])]
    parts.append(stop_s + (ramp[1:] * run_down_s / ramp[-1])[:, None])
    return np.concatenate(parts)


def _rolling(world: World, surface: Array) -> Array:
    """Velocity at which no wheel slips along and the rear wheels do not slide sideways: a first guess, (3, runs)."""
    spin = (surface[1] - surface[0]) / world.robot.track_mm
    return np.stack([surface.mean(axis=0), spin * world.robot.wheelbase_mm / 2, spin])


def _plate_rate(heading: Array, velocity: Array) -> Array:
    """Body velocity turned into the plate frame."""
    u, v, spin = velocity
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([u * c - v * s, u * s + v * c, spin])


def _residual(
    world: World, now: Now, unknown: Array, old: Array, step: Array, surface: Array, powered: Array, extra: Array
) -> tuple[Array, Array]:
    """What the unknowns (velocity, then axle turns, then drooped surface speeds) leave unbalanced; and wheel forces."""
    at, turn = 3, None
    if world.compliance_rad_per_mN:
        turn, at = unknown[3:5], 5
    speeds = surface + unknown[at:] if world.droop_rpm_per_uN_mm else surface
    balance = forces(world, now, speeds, turn)
    acting = np.stack([balance.force_x_mN, balance.force_y_mN, balance.moment_mN_mm])
    rows = [inertia_mN(world, (unknown[:3] - old) / step, unknown[:3]) - acting]
    if turn is not None:  # an axle turns by the lateral force on its two wheels together
        together = np.stack([balance.across_mN[:2].sum(axis=0), balance.across_mN[2:].sum(axis=0)])
        rows.append(turn - world.compliance_rad_per_mN * together)
    if world.droop_rpm_per_uN_mm:  # torque in uN mm; the gear holds a motor that is not commanded
        radius = world.robot.wheel_radius_mm
        fall = world.droop_rpm_per_uN_mm * 1000 * radius * balance.along_mN[:2]
        towards = -powered * fall * MM_S_PER_RPM_MM * radius
        before = extra[at - 3 :]
        rows.append(unknown[at:] - before - step / (step + DROOP_LAG_S) * (towards - before))
    stands = np.abs(surface).max(axis=0) < STANDING_MM_S
    return np.where(stands, unknown, np.vstack(rows)), balance.along_mN * ~stands


class _Newton:
    """Newton's method for all runs at once, with a Jacobian by differences that is kept while it serves."""

    inverse: Array | None = None

    def solve(self, residual, world: World, guess: Array, other_guess: Array) -> tuple[Array, Array]:  # noqa: ANN001
        """The unknowns that leave nothing unbalanced, and the longitudinal wheel forces there."""
        value, along = residual(guess)
        other, _ = residual(other_guess)
        unknown = np.where(_norm(other) < _norm(value), other_guess, guess)
        for start in (unknown, other_guess, guess, 0 * guess):
            found, along, left = self._iterated(residual, start)
            if not left.any():
                return found, along
            self.inverse = None
            found, along, left = self._iterated(residual, _relaxed(residual, start, 400))
            if not left.any():
                return found, along
            found = start
            for rest in ROUNDINGS_MM_S:  # the corners of friction at rest, rounded off less and less
                self.inverse = None
                found = _relaxed(lambda at, rest=rest: residual(at, replace(world, rest_mm_s=rest)), found, 60)
            found, along, left = self._iterated(residual, found)
            if not left.any():
                return found, along
        raise ArithmeticError(f"forces do not balance: {left.max():.3g} mN is left")

    def _iterated(self, residual, unknown: Array) -> tuple[Array, Array, Array]:  # noqa: ANN001
        value, along = residual(unknown)
        left = _norm(value)
        for _ in range(25):
            open_ = left > UNBALANCED_MN
            if not open_.any():
                return unknown, along, 0 * left
            fresh = self.inverse is None or self.inverse.shape[1] != len(unknown)
            if fresh:
                self.inverse = np.linalg.inv(_jacobian(residual, unknown, value))
            change = -np.einsum("rij,jr->ir", self.inverse, value) * open_
            if fresh and (np.abs(change) < 1e-13 + 1e-11 * np.abs(unknown)).all():
                return unknown, along, 0 * left  # rounding is all that is left
            trial, along = residual(unknown + change)
            slow = open_ & (_norm(trial) > 0.1 * left)
            if slow.any():
                self.inverse = None
                if not fresh:
                    continue  # a Jacobian from elsewhere misled: again from the same place
            unknown, value = unknown + change, trial
            left = _norm(value)
        return unknown, along, left


def _relaxed(residual, unknown: Array, most: int) -> Array:  # noqa: ANN001
    """Near the balance: motion from the guess under the forces, by linear implicit steps.

    The step of a run starts at 1 µs and grows as its imbalance falls (switched evolution relaxation).
    """
    rows, runs = unknown.shape
    mass = np.diag(np.r_[1e-3, 1e-3, 4e-3, np.zeros(rows - 3)])  # about the robot's own: mN per mm/s²
    step = np.full(runs, 1e-6)
    value, _ = residual(unknown)
    for _ in range(most):
        left = _norm(value)
        open_ = left > UNBALANCED_MN
        if not open_.any():
            break
        matrix = mass / step[:, None, None] + _jacobian(residual, unknown, value)
        change = -np.linalg.solve(matrix, value.T[..., None])[..., 0].T
        trial, _ = residual(unknown + change * open_)
        ratio = left / np.maximum(_norm(trial), 1e-12)
        accepted = open_ & (ratio > 0.8)
        unknown = np.where(accepted, unknown + change, unknown)
        value = np.where(accepted, trial, value)
        step = np.where(accepted, step * np.clip(ratio, 1.2, 5), step / 4)
    return unknown


def _jacobian(residual, unknown: Array, value: Array) -> Array:  # noqa: ANN001
    """Derivatives by differences, (runs, rows, unknowns)."""
    columns = []
    for i in range(len(unknown)):
        moved = unknown.copy()
        small = 1e-8 + 1e-6 * np.abs(unknown[i])
        moved[i] += small
        columns.append((residual(moved)[0] - value) / small)
    return np.stack(columns, axis=-1).transpose(1, 0, 2)


def _norm(value: Array) -> Array:
    return np.sqrt((value**2).sum(axis=0))


def simulate_in_full(world: World, command_rpm: tuple[float, float], start_pose: Array, stop_s: float) -> Array:
    """The pose of one run at stop_s by SciPy's Radau on the full equations; no compliance, no droop, no history."""
    nothing = np.zeros(1)

    def derivative(time: float, state: Array) -> Array:
        pose, velocity = state[:3, None], state[3:, None]
        surface = surface_speeds_mm_s(
            world, np.array(command_rpm)[:, None], np.array([[0.0], [time]]), np.array([stop_s + 1.0])
        )[0][1]
        now = Now(np.array([time]), *pose, nothing, nothing, *velocity, last_drive_mN=np.zeros((4, 1)))
        balance = forces(world, now, surface)
        acting = np.concatenate([balance.force_x_mN, balance.force_y_mN, balance.moment_mN_mm])
        mass = np.stack([inertia_mN(world, row[:, None], 0 * velocity)[:, 0] for row in np.eye(3)], axis=1)
        rest = inertia_mN(world, np.zeros((3, 1)), velocity)[:, 0]
        return np.concatenate([_plate_rate(pose[2], velocity)[:, 0], np.linalg.solve(mass, acting - rest)])

    state = np.concatenate([start_pose, np.zeros(3)])
    solved = solve_ivp(derivative, (0.0, stop_s), state, method="Radau", rtol=1e-7, atol=1e-9)
    return solved.y[:3, -1]
