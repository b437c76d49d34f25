"""Simulated observation of the marks of a moving robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.effects import free_form
from simulator.effects.catalogue import EFFECTS, effect_values
from simulator.effects.view import View
from simulator.robot import Robot
from simulator.run import Run

if TYPE_CHECKING:
    import pandas as pd


def marks_of_run(robot: Robot, run: Run) -> pd.DataFrame:
    """Marks of a run: time_s, then NAME_x_mm, NAME_y_mm of every mark in the plate frame, a row per time.

    Observation effects of the robot are applied to positions and times.
    """
    import pandas as pd

    view = view_of(robot)
    columns = {"time_s": run.time_s * view.time_factor}
    for name, place in zip(robot.points_mm, seen_of_run(view, run), strict=True):
        columns |= {f"{name}_x_mm": place[:, 0], f"{name}_y_mm": place[:, 1]}
    return pd.DataFrame(columns)


def seen_of_run(view: View, run: Run) -> tuple[NDArray[np.float64], ...]:
    """Measured points (n, 2) of a run, mm, in the order of view.places_mm."""
    states = run.x_mm, run.y_mm, run.heading_rad, run.u_mm_s, run.v_mm_s, run.yaw_rate_rad_s
    return view.marks_of_path(np.column_stack(states), run.time_s)


def view_of(robot: Robot, places_mm: Sequence[tuple[float, float]] | None = None) -> View:
    """The view of the robot's marks, or of points of its body at places_mm, with its observation effects."""
    view = View(tuple(robot.points_mm.values() if places_mm is None else places_mm))
    for entry in robot.effect:
        if entry.id == free_form.ID:
            term = free_form.term_of(entry.given)
            view.errors += (term,) if term.is_seen_only else ()
        elif see := EFFECTS[entry.id].view:
            see(view, effect_values(entry))
    return view
