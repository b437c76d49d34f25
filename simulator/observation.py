"""Where a camera would see the two marks of a moving robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.catalogue import view_of
from simulator.robot import Robot
from simulator.run import Run

if TYPE_CHECKING:
    import pandas as pd


def marks_of_run(robot: Robot, run: Run) -> pd.DataFrame:
    """Marks of a run: time_s, green_x_mm, green_y_mm, yellow_x_mm, yellow_y_mm in the plate frame, a row per time.

    Observation effects of the robot are applied, to places and to times.
    """
    import pandas as pd

    view = view_of(robot)
    green, yellow = view.marks(run.x_mm, run.y_mm, run.heading_rad, run.time_s)
    return pd.DataFrame(
        {
            "time_s": run.time_s * view.time_factor,
            "green_x_mm": green[:, 0],
            "green_y_mm": green[:, 1],
            "yellow_x_mm": yellow[:, 0],
            "yellow_y_mm": yellow[:, 1],
        }
    )
