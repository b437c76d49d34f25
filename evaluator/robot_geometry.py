"""What measurement needs to know of a robot: where its marks are, and its outline and wheels.

Measurement never sees the model: only these few lengths pass from robot.toml to it.
"""

from __future__ import annotations

from evaluator.pose import MarkGeometry
from evaluator.turning import RobotShape
from simulator.robot import Robot


def mark_geometry(robot: Robot) -> MarkGeometry:
    """Where the marks are: body frame and height above the plate, mm."""
    marks = robot.marks
    return MarkGeometry(green_mm=marks.green_mm, yellow_mm=marks.yellow_mm, height_mm=marks.height_mm)


def robot_shape(robot: Robot) -> RobotShape:
    """Outline and wheels, body frame, mm."""
    return RobotShape(
        wheel_positions_mm=tuple((float(x), float(y)) for x, y in robot.wheel_positions_mm()),
        wheel_radius_mm=robot.wheels.radius_mm,
        length_mm=robot.body.length_mm,
        width_mm=robot.body.width_mm,
    )
