"""State of each wheel and friction on it in a turn, to scale: the paper's Figures 20 and 21.

Drawn in the body frame with forward (x) up and left (y) to the left, as the robot is seen from above.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Rectangle

from evaluator.report.numbers import true_minus
from evaluator.report.style import BLUE, FAINT, INK, PAPER, SOFT, VERMILLION, Figure, drawing
from simulator.robot import Robot
from simulator.steady import SteadyTurn

WHEEL_LENGTH_MM = 1.0  # along the axle: 0.75 mm of magnet and two yokes of 0.125 mm
LONGEST_ARROW_MM = 2.4  # the largest force is drawn this long; the scale bar says what a millimetre means


def wheel_states_figure(name: str, title: str, robot: Robot, turn: SteadyTurn) -> Figure:
    """Wheels with slip ratio and angle, their velocities, and friction arrows to one scale; the turn's centre."""
    place = robot.wheel_positions_mm()
    wheels = turn.wheels
    along, across = wheels.longitudinal_force_mN, wheels.lateral_force_mN
    velocity = np.array([turn.u_mm_s, turn.v_mm_s]) + turn.yaw_rate_rad_s * np.stack([-place[:, 1], place[:, 0]], 1)
    table = pd.DataFrame(
        {
            "wheel": robot.wheel_names,
            "slip_ratio": wheels.slip_ratio + 0.0,
            "slip_angle_deg": np.degrees(wheels.slip_angle_rad),
            "velocity_forward_mm_s": velocity[:, 0],
            "velocity_left_mm_s": velocity[:, 1],
            "longitudinal_force_mN": along + 0.0,
            "lateral_force_mN": across,
        }
    )
    force_scale = LONGEST_ARROW_MM / np.hypot(along, across).max()
    with drawing(name, width=4.9, height=3.9) as canvas:
        (axes,) = canvas.axes
        _body(axes, robot, turn)
        for number in range(len(place)):
            x, y = place[number]
            _arrow(axes, (x, y), velocity[number] * 1.6 / np.hypot(*velocity.T).max(), BLUE, 1.0)
            _arrow(axes, (x, y), force_scale * np.array([along[number], across[number]]), VERMILLION, 2.2)
            _label(axes, number, place[number], table)
        _scale_bar(axes, force_scale)
        axes.set_aspect("equal")
        axes.set_xlim(-7.3, 7.3)
        axes.set_ylim(-6.1, 5.5)
        axes.set_axis_off()
    motion = "forward" if turn.u_mm_s > 0 else "backward"
    caption = (
        f"Moving {motion}, radius {abs(turn.radius_mm):.2f} mm. Thick orange arrows: friction on each wheel; "
        "thin blue arrows: velocity of the wheel over the plate; dotted lines: radii from the centre of the turn "
        "(cross). The driven wheels roll freely, so their friction is lateral alone. Seen from above, front at the top."
    )
    return Figure(name, title, caption, (canvas.svg,), table)


def _on_page(x: float, y: float) -> tuple[float, float]:
    """Page coordinates of a body point: forward up, left to the left."""
    return -y, x


def _body(axes: Axes, robot: Robot, turn: SteadyTurn) -> None:
    length, width = robot.body.length_mm, robot.body.width_mm
    axes.add_patch(Rectangle((-width / 2, -length / 2), width, length, fc="none", ec=SOFT, lw=0.9))
    axes.text(0, length / 2 - 0.15, "front", ha="center", va="top", color=SOFT, fontsize=8)
    center = (-turn.v_mm_s / turn.yaw_rate_rad_s, turn.u_mm_s / turn.yaw_rate_rad_s)
    page = _on_page(*center)
    for wheel in robot.all_wheels:
        axes.plot(*zip(page, _on_page(wheel.x_mm, wheel.y_mm), strict=True), color=SOFT, lw=0.6, ls=":")
        corner = _on_page(wheel.x_mm - wheel.radius_mm, wheel.y_mm + WHEEL_LENGTH_MM / 2)
        axes.add_patch(Rectangle(corner, WHEEL_LENGTH_MM, 2 * wheel.radius_mm, fc=FAINT, ec=INK, lw=0.8))
    axes.plot(*page, marker="x", color=INK, ms=7, mew=1.6)
    axes.plot(0, 0, marker="+", color=INK, ms=7)


def _arrow(axes: Axes, start: tuple[float, float], vector: np.ndarray, color: str, width: float) -> None:
    if np.hypot(*vector) < 1e-9:
        return
    tip = _on_page(start[0] + vector[0], start[1] + vector[1])
    size = 9 if width > 2 else 7
    style: dict[str, Any] = {"color": color, "lw": width, "zorder": 5}
    arrow = FancyArrowPatch(_on_page(*start), tip, arrowstyle="-|>", mutation_scale=size, shrinkA=0, shrinkB=0, **style)
    axes.add_patch(arrow)


def _label(axes: Axes, number: int, place: np.ndarray, table: pd.DataFrame) -> None:
    row = table.iloc[number]
    page_x, page_y = _on_page(*place)
    side, end = np.sign(page_x), np.sign(page_y)
    text = (
        f"{number + 1}:  s = {row['slip_ratio']:+.3f}, α = {row['slip_angle_deg']:+.1f}°\n"
        f"$F_x$ = {row['longitudinal_force_mN']:+.2f}, $F_y$ = {row['lateral_force_mN']:+.2f} mN"
    )
    axes.text(
        *(side * 4.3, end * 4.6),
        true_minus(text),
        ha="center",
        va="center",
        fontsize=8,
        bbox={"fc": PAPER, "ec": "none", "pad": 1.0, "alpha": 0.85},
    )
    axes.plot([page_x, side * 4.3], [page_y + 0.55 * end, end * 4.05], color=FAINT, lw=0.8, zorder=0)


def _scale_bar(axes: Axes, force_scale: float) -> None:
    length = force_scale  # 1 mN
    axes.plot([-length / 2, length / 2], [-5.7, -5.7], color=VERMILLION, lw=2.2, solid_capstyle="butt")
    axes.text(0, -5.55, "1 mN", ha="center", va="bottom", fontsize=8, color=VERMILLION)
