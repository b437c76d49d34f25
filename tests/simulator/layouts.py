"""Robots of other layouts than the paper's, for tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from simulator.robot import Robot, load_robot


def robot_with(wheels: Sequence[Mapping[str, Any]], body: Mapping[str, Any] | None = None) -> Robot:
    """The barrel robot with these [[wheel]], and these keys of [body] changed."""
    barrel = load_robot("barrel").model_dump(exclude={"wheels", "magnetic_attraction", "wheel"}, exclude_none=True)
    return Robot.model_validate({**barrel, "body": {**barrel["body"], **(body or {})}, "wheel": list(wheels)})


def listed(robot: Robot) -> Robot:
    """A robot of [wheels] and [magnetic_attraction] with its wheels as a list."""
    content = robot.model_dump(exclude={"wheels", "magnetic_attraction", "wheel"}, exclude_none=True)
    return Robot.model_validate({**content, "wheel": [wheel.model_dump() for wheel in robot.all_wheels]})


def pair(x_mm: float, half_mm: float = 2.0, driven: bool = True, **more: Any) -> list[dict[str, Any]]:
    """A left and a right wheel of radius 0.5 mm on one axle."""
    return [
        {
            "name": f"{side}_{x_mm:g}",
            "x_mm": x_mm,
            "y_mm": half_mm if side == "left" else -half_mm,
            "radius_mm": 0.5,
            "driven_by": side if driven else "none",
            **more,
        }
        for side in ("left", "right")
    ]


def ball(x_mm: float, y_mm: float, name: str = "ball", **more: Any) -> dict[str, Any]:
    """A ball support."""
    return {"name": name, "x_mm": x_mm, "y_mm": y_mm, "radius_mm": 0.5, "support": "ball", **more}
