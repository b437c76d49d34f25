"""Where a camera would see the two marks of a moving robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simulator.robot import Robot
from simulator.run import Run

if TYPE_CHECKING:
    import pandas as pd


def marks_of_run(robot: Robot, run: Run) -> pd.DataFrame:
    """Marks of a run: time_s, green_x_mm, green_y_mm, yellow_x_mm, yellow_y_mm in the plate frame, a row per time."""
    import pandas as pd

    cos, sin = np.cos(run.heading_rad), np.sin(run.heading_rad)
    columns = {"time_s": run.time_s}
    for mark, (x, y) in (("green", robot.marks.green_mm), ("yellow", robot.marks.yellow_mm)):
        columns[f"{mark}_x_mm"] = run.x_mm + cos * x - sin * y
        columns[f"{mark}_y_mm"] = run.y_mm + sin * x + cos * y
    return pd.DataFrame(columns)
