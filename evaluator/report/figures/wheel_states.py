"""State of each wheel and friction on it in a turn, to scale: the paper's Figures 20 and 21.

Drawn in the body frame with forward (x) up and left (y) to the left, as the robot is seen from above.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Rectangle

from evaluator.report.numbers import METRES, true_minus, unit_for
from evaluator.report.pages.colors import BLUE, FAINT, INK, PAPER, SOFT, VERMILLION
from evaluator.report.style import Figure, drawing
from simulator.robot import Robot
from simulator.steady import SteadyTurn

# Sizes for the paper's robot, a cube of 5 mm; for others in proportion.
PAPER_BODY_MM = 5.0
WHEEL_LENGTH_MM = 1.0  # along the axle: 0.75 mm of magnet and two yokes of 0.125 mm
LONGEST_ARROW_MM = 2.4  # length of the largest force; the scale is given by the scale bar
LONGEST_VELOCITY_MM = 1.6
ROLLS_FREELY = " The driven wheels roll freely, so their friction is lateral alone."


def wheel_states_figure(name: str, title: str, robot: Robot, turn: SteadyTurn) -> Figure:
    """Wheels with slip ratio and angle, their velocities, and friction arrows to one scale; the turn's centre."""
    unit, wheels = unit_for(robot.body.length_mm), turn.wheels
    force_unit, force_mN = ("N", 1000.0) if unit is METRES else ("mN", 1.0)
    place = robot.wheel_positions_mm()
    drawn = PAPER_BODY_MM / max(robot.body.length_mm, robot.body.width_mm)  # drawn at the size of that cube
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
    strongest_mN = float(np.hypot(along, across).max())
    forces = np.column_stack([along, across]) * LONGEST_ARROW_MM / strongest_mN
    velocities = velocity * LONGEST_VELOCITY_MM / np.hypot(*velocity.T).max()
    with drawing(name, width=4.9, height=3.9) as canvas:
        (axes,) = canvas.axes
        _body(axes, robot, turn, drawn)
        for number, (x, y) in enumerate(drawn * place):
            _arrow(axes, (x, y), velocities[number], BLUE, 1.0)
            _arrow(axes, (x, y), forces[number], VERMILLION, 2.2)
            force = f"$F_x$ = {along[number] / force_mN:+.2f}, $F_y$ = {across[number] / force_mN:+.2f} {force_unit}"
            _label(axes, number, (x, y), table, force)
        bar_mN = 10.0 ** np.floor(np.log10(strongest_mN))
        _scale_bar(axes, LONGEST_ARROW_MM * bar_mN / strongest_mN, f"{bar_mN / force_mN:g} {force_unit}")
        axes.set_aspect("equal")
        axes.set_xlim(-7.3, 7.3)
        axes.set_ylim(-6.1, 5.5)
        axes.set_axis_off()
    motion = "forward" if turn.u_mm_s > 0 else "backward"
    free = any(wheel.driven_by == "none" for wheel in robot.all_wheels)
    caption = (
        f"Moving {motion}, radius {abs(turn.radius_mm) / unit.mm:.2f} {unit.name}. Thick orange arrows: friction on "
        "each wheel; thin blue arrows: velocity of the wheel over the ground; dotted lines: radii from the centre of "
        f"the turn (cross).{ROLLS_FREELY if free else ''} View from above, front at the top."
    )
    return Figure(name, title, caption, (canvas.svg,), table)


def _on_page(x: float, y: float) -> tuple[float, float]:
    """Page coordinates of a body point: forward up, left to the left."""
    return -y, x


def _body(axes: Axes, robot: Robot, turn: SteadyTurn, drawn: float) -> None:
    length, width = drawn * robot.body.length_mm, drawn * robot.body.width_mm
    axes.add_patch(Rectangle((-width / 2, -length / 2), width, length, fc="none", ec=SOFT, lw=0.9))
    axes.text(0, length / 2 - 0.15, "front", ha="center", va="top", color=SOFT, fontsize=8)
    center = (-drawn * turn.v_mm_s / turn.yaw_rate_rad_s, drawn * turn.u_mm_s / turn.yaw_rate_rad_s)
    page = _on_page(*center)
    for wheel in robot.all_wheels:
        x, y, radius = drawn * wheel.x_mm, drawn * wheel.y_mm, drawn * wheel.radius_mm
        axes.plot(*zip(page, _on_page(x, y), strict=True), color=SOFT, lw=0.6, ls=":")
        corner = _on_page(x - radius, y + WHEEL_LENGTH_MM / 2)
        axes.add_patch(Rectangle(corner, WHEEL_LENGTH_MM, 2 * radius, fc=FAINT, ec=INK, lw=0.8))
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


def _label(axes: Axes, number: int, place: tuple[float, float], table: pd.DataFrame, force: str) -> None:
    row = table.iloc[number]
    page_x, page_y = _on_page(*place)
    side, end = np.sign(page_x), np.sign(page_y)
    text = f"{number + 1}:  s = {row['slip_ratio']:+.3f}, α = {row['slip_angle_deg']:+.1f}°\n{force}"
    axes.text(
        *(side * 4.3, end * 4.6),
        true_minus(text),
        ha="center",
        va="center",
        fontsize=8,
        bbox={"fc": PAPER, "ec": "none", "pad": 1.0, "alpha": 0.85},
    )
    axes.plot([page_x, side * 4.3], [page_y + 0.55 * end, end * 4.05], color=FAINT, lw=0.8, zorder=0)


def _scale_bar(axes: Axes, length: float, force: str) -> None:
    axes.plot([-length / 2, length / 2], [-5.7, -5.7], color=VERMILLION, lw=2.2, solid_capstyle="butt")
    axes.text(0, -5.55, force, ha="center", va="bottom", fontsize=8, color=VERMILLION)
