"""Properties of a robot that its export omits, in sentences."""

from __future__ import annotations

from simulator.exchange.creep import SMALL_MM, is_in_turn
from simulator.robot import Robot


def losses(robot: Robot, left_rpm: float, right_rpm: float, kind: str = "mjcf") -> tuple[str, ...]:
    """Properties of the robot that its export ("mjcf" or "sdf") omits, one sentence each."""
    at = f"{left_rpm:g} / {right_rpm:g} rpm"
    friction = (
        f"Friction is creep in proportion to force, matched to the slip law at the turn of {at}, where the radius is "
        "that of the robot. At another ratio of the commands the radius is only similar, and starts and stops differ."
    )
    said = [
        friction,
        "Friction has no limit: a robot that is pushed creeps instead of sliding.",
        "The weight acts at the level of the plate, as in the plane model: there is no load transfer.",
    ]
    if any(wheel.attraction_mN for wheel in robot.all_wheels):
        said.append("Magnetic attraction is a constant force at each wheel, independent of the distance to the plate.")
    kept = [entry.id for entry in robot.effect if is_in_turn(robot, entry)]
    if kept:
        said.append(f"Effects ({', '.join(kept)}) act as at this turn: on loads, friction and speeds of the wheels.")
    if left_out := [entry.id for entry in robot.effect if entry.id not in kept]:
        said.append(f"Delays of the motors and errors of the measurement are left out: {', '.join(left_out)}.")
    if any(not wheel.grips for wheel in robot.all_wheels):
        said.append("Casters and balls are spheres without friction.")
    if kind == "sdf":
        said.append("The radius has not been checked in Gazebo; only the format of the file is tested.")
        if max(robot.extent_mm) < SMALL_MM:
            said.append("Gazebo computes in metres; its contacts are probably inaccurate for a robot this small.")
    return tuple(said)
