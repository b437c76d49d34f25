"""The data of Figures 7 to 14, 18, 20 and 21: one table a figure, columns with their units."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simulator.command import Command
from simulator.paper.machines import PUBLISHED_TURNS, TIRE_PEAK_FRICTION, TURN_RPM, machine_of, tire_machine
from simulator.robot import Robot, load_robot
from simulator.simulation import simulate
from simulator.steady import SteadyTurn, steady_turn

if TYPE_CHECKING:
    import pandas as pd

LEFT_RPM = tuple(range(20, 51, 5))  # Figure 13
DIFFERENCES_RPM = np.arange(2.5, 36.0, 2.5)  # assumed: the paper does not list them; ratios from 0.1 to 0.7
RATIO_RANGE = (0.1, 0.7)  # of slower to faster wheel in Figure 13
PROTOTYPE_RPM = (14.4, 33.3)  # left, right of Figures 19 to 21


def radius_mm(robot: Robot, left_rpm: float, right_rpm: float) -> float:
    """Turning radius of the robot's centre, mm: the steady radius, which the model reaches at once, is the minimum."""
    return abs(steady_turn(robot, left_rpm, right_rpm).radius_mm)


def trajectories(figure: str) -> pd.DataFrame:
    """Figure 9 or 10: case, time_s, x_mm, y_mm of one full circle from rest, right wheel 100 and left 70 rpm."""
    import pandas as pd

    runs = []
    for turn in PUBLISHED_TURNS:
        names = [name for name in turn.case.split(", ") if name.startswith(figure)]
        if names:
            robot = machine_of(turn)
            rate = abs(steady_turn(robot, *reversed(TURN_RPM)).yaw_rate_rad_s)
            times = np.linspace(0.0, 2 * np.pi / rate, 361)
            run = simulate(robot, Command.constant(*reversed(TURN_RPM)), times)
            runs.append(pd.DataFrame({"case": names[0], "time_s": times, "x_mm": run.x_mm, "y_mm": run.y_mm}))
    return pd.concat(runs, ignore_index=True)


def tire_against_magnetic() -> pd.DataFrame:
    """Figure 11: right_rpm and radius_mm of each wheel at 100 rpm left, attraction 22.05 and 2.45 mN."""
    import pandas as pd

    barrel = load_robot("barrel")
    pull = (barrel.magnetic_attraction.driving_wheel_mN, barrel.magnetic_attraction.driven_wheel_mN)
    robots = {
        "tire, friction 0.3": tire_machine(*pull),
        f"tire, friction {TIRE_PEAK_FRICTION}": tire_machine(*pull, friction=TIRE_PEAK_FRICTION),
        "column": load_robot("column"),
        "barrel": barrel,
    }
    rows = [
        {"wheel": name, "right_rpm": right, "radius_mm": radius_mm(robot, 100.0, right)}
        for name, robot in robots.items()
        for right in (60.0, 70.0, 80.0)
    ]
    return pd.DataFrame(rows)


def straight_speeds() -> pd.DataFrame:
    """Figure 12: rpm and speed_mm_s of the barrel robot driving straight, at the end of a run of 2 s from rest."""
    import pandas as pd

    robot = load_robot("barrel")
    rows = []
    for rpm in np.arange(10.0, 101.0, 10.0):
        run = simulate(robot, Command.constant(rpm, rpm), np.linspace(0.0, 2.0, 21))
        rows.append({"rpm": rpm, "speed_mm_s": float(np.hypot(run.u_mm_s[-1], run.v_mm_s[-1]))})
    return pd.DataFrame(rows)


def turning_map(robot: Robot) -> pd.DataFrame:
    """Figures 13, 14: left_rpm, difference_rpm, ratio and radius_mm at 20 to 50 rpm left, ratios 0.1 to 0.7."""
    import pandas as pd

    rows = []
    for left in LEFT_RPM:
        for difference in DIFFERENCES_RPM:
            ratio = difference / left
            if RATIO_RANGE[0] <= ratio <= RATIO_RANGE[1]:
                radius = radius_mm(robot, left, left - difference)
                rows.append({"left_rpm": left, "difference_rpm": difference, "ratio": ratio, "radius_mm": radius})
    return pd.DataFrame(rows)


def prototype_turns() -> pd.DataFrame:
    """Figures 18 and 22 (simulation): wheel, left_rpm, difference_rpm, radius_mm of the prototype."""
    import pandas as pd

    rows = []
    for figure, left, differences in (("18", 33.0, (4.0, 19.0, 28.0)), ("22", 33.3, (4.8, 19.4, 28.5))):
        for wheel in ("barrel", "column"):
            for difference in differences:
                radius = radius_mm(load_robot(wheel), left, left - difference)
                row = {"figure": figure, "wheel": wheel, "left_rpm": left, "difference_rpm": difference}
                rows.append(row | {"radius_mm": radius})
    return pd.DataFrame(rows)


def prototype_turn(direction: int) -> SteadyTurn:
    """The turn of Figures 20 (direction 1, forward to the left) and 21 (direction -1, backward), barrel wheels."""
    left, right = PROTOTYPE_RPM
    return steady_turn(load_robot("barrel"), direction * left, direction * right)
