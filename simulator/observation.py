"""Where a camera would see the two marks of a moving robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects import free_form
from simulator.effects.catalogue import EFFECTS, effect_values
from simulator.effects.view import View
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


def view_of(robot: Robot) -> View:
    """How the robot's marks are seen, with its observation effects."""
    view = View(robot.marks.green_mm, robot.marks.yellow_mm)
    for entry in robot.effect:
        if entry.id == free_form.ID:
            term = free_form.term_of(entry.given)
            view.errors += (term,) if term.is_seen_only else ()
        elif see := EFFECTS[entry.id].view:
            see(view, effect_values(entry))
    return view
