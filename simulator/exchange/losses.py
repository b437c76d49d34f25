"""What a robot loses on its way to another simulator, in sentences."""

from __future__ import annotations

from simulator.robot import Robot

SMALL_MM = 100.0


def losses(robot: Robot, left_rpm: float, right_rpm: float, kind: str = "mjcf") -> tuple[str, ...]:
    """What an exported robot ("mjcf" or "sdf") does not have of the robot, a sentence each."""
    at = f"{left_rpm:g} / {right_rpm:g} rpm"
    friction = (
        f"Friction is creep in proportion to force, matched to the slip law at the turn of {at}: there the radius is "
        "the robot's. At another ratio of the commands it is near that, and starts and stops differ."
    )
    said = [
        friction,
        "There is no limit of friction: a robot that is pushed away creeps instead of sliding.",
        "The weight acts at the level of the plate, as in the plane model: driving shifts no load between the wheels.",
    ]
    if any(wheel.attraction_mN for wheel in robot.all_wheels):
        said.append("Magnetic attraction is a constant force at each wheel, however far the plate is.")
    if any(not wheel.grips for wheel in robot.all_wheels):
        said.append("Casters and balls are spheres without friction.")
    if kind == "sdf":
        said.append("No radius was checked in Gazebo: nothing but the file's form is tested here.")
        if max(robot.extent_mm) < SMALL_MM:
            said.append("Gazebo computes in metres: for a robot this small its contacts are unlikely to hold.")
    return tuple(said)
