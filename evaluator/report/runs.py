"""Data of the report: the tables of an analysis and the curves of every run, read from the output folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.frames import plate_from_body
from evaluator.mark_geometry import MarkGeometry
from evaluator.marks import mark_names, read_marks
from evaluator.report.numbers import MILLIMETRES, LengthUnit, command_text, number, unit_for
from evaluator.turning import only_mark
from evaluator.workflow import Analysis, Outputs
from simulator.robot import Robot

Array = NDArray[np.float64]

STRAIGHT_DEG = 1.0  # change of heading over a run below which a turn is not visible in a figure


@dataclass(frozen=True)
class RunView:
    """One analysed run, or one phase of a run with a log: its row of turning.csv and of comparison.csv, and its curves.

    Curves are read on first use. run: id in the experiment. unit: of its lengths. from_poses: its marks were computed
    from given poses, not observed. only_mark: name and place (mm) on the robot of its single mark; radius, speed and
    path are then those of this mark. by_places_mm: standard uncertainty of the radius from the places of the marks on
    the robot, which its interval does not contain.
    """

    run: str
    group: str
    turning: dict[str, Any]
    comparison: dict[str, Any]
    outputs: Outputs
    unit: LengthUnit = MILLIMETRES
    from_poses: bool = False
    only_mark: tuple[str, tuple[float, float]] | None = None
    by_places_mm: float = 0.0

    @property
    def id(self) -> str:
        """Name for people: the run, with the number of its phase."""
        phase = self.value("phase")
        return f"{self.run} ({phase:.0f})" if np.isfinite(phase) else self.run

    @property
    def left_rpm(self) -> float:
        """Command of the left driving wheel."""
        return float(self.turning["left_rpm"])

    @property
    def right_rpm(self) -> float:
        """Command of the right driving wheel."""
        return float(self.turning["right_rpm"])

    @property
    def difference_rpm(self) -> float:
        """Difference of rotational frequency as on the paper's axes: of the absolute values, never negative."""
        return abs(self.left_rpm - self.right_rpm)

    @property
    def backward(self) -> bool:
        """Driven backward."""
        return self.left_rpm + self.right_rpm < 0

    @property
    def straight(self) -> bool:
        """Both sides have the same command."""
        return self.left_rpm == self.right_rpm

    @property
    def turns(self) -> bool:
        """It turns visibly and has a radius; very large circles count as straight."""
        return bool(np.isfinite(self.value("radius_mm")) and abs(self.value("turned_deg")) > STRAIGHT_DEG)

    @property
    def command(self) -> str:
        """The command as text, with a true minus sign."""
        return f"{command_text(self.left_rpm, self.right_rpm)} rpm"

    def value(self, name: str, table: str = "turning") -> float:
        """A number of the run's row; NaN if the table has none."""
        value = getattr(self, table).get(name)
        return float("nan") if value is None else float(value)

    def length(self, name: str, table: str = "turning") -> str:
        """A length of the run's row, mm, in the unit of the report, to a thousandth of it."""
        return number(self.value(name, table) / self.unit.mm, 3)

    @cached_property
    def marks(self) -> pd.DataFrame:
        """Marks over time."""
        return self._of_phase(read_marks(self.outputs.marks(self.run)))

    @property
    def mark_names(self) -> tuple[str, ...]:
        """Observed marks of the robot, without corners of tags; none for given poses."""
        return () if self.from_poses else tuple(name for name in mark_names(self.marks) if "_corner" not in name)

    @cached_property
    def poses(self) -> pd.DataFrame:
        """Poses over time."""
        return self._of_phase(pd.read_csv(self.outputs.poses(self.run)))

    @cached_property
    def simulated(self) -> pd.DataFrame:
        """The simulated counterpart over time."""
        table = self._of_phase(pd.read_csv(self.outputs.simulated(self.run)))
        if self.only_mark is None:
            return table
        places = np.broadcast_to(self.only_mark[1], (len(table), 2))
        pose = table["x_mm"].to_numpy(), table["y_mm"].to_numpy(), np.radians(table["heading_deg"].to_numpy())
        x, y = plate_from_body(places, *pose).T
        return table.assign(x_mm=x, y_mm=y)

    def _of_phase(self, table: pd.DataFrame) -> pd.DataFrame:
        """The rows of a table within the phase; all rows if the run has no phases."""
        begin, end = self.value("phase_start_s"), self.value("phase_stop_s")
        if not np.isfinite(begin):
            return table
        # Times in tables have nine digits; the tolerance keeps the first and last row of a phase.
        slack = 1e-6 * max(1.0, abs(end))
        return table[table["time_s"].between(begin - slack, end + slack)].reset_index(drop=True)

    @cached_property
    def thumbnails(self) -> list[dict[str, Any]]:
        """Small frames of the video (time_s, jpeg as base64), none for a run given as marks."""
        path = self.outputs.thumbnails(self.run)
        if not path.is_file():
            return []
        thumbnails: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
        return thumbnails


def views_of(analysis: Analysis, robot: Robot) -> list[RunView]:
    """Every run that could be analysed, in the order of the experiment."""
    poses = {run.id for run in analysis.experiment.run if run.poses is not None}
    unit = unit_for(robot.body.length_mm)
    measured = _records(analysis.turning)
    compared = [{} for _ in measured] if analysis.comparison is None else _records(analysis.comparison)
    both = zip(measured, compared, strict=True)
    return [
        RunView(
            *(
                str(row["run"]),
                str(row["group"]),
                _of_mark(row, mark),
                _of_mark(compared, mark),
                analysis.outputs,
                unit,
            ),
            from_poses=row["run"] in poses,
            only_mark=(mark, robot.points_mm[mark]) if mark else None,
            by_places_mm=0.0 if mark or row["run"] in poses else _by_places_mm(robot, row),
        )
        for row, compared in both
        if row["run"] not in analysis.faults
        for mark in [only_mark(row)]
    ]


def _by_places_mm(robot: Robot, row: dict[str, Any]) -> float:
    """Standard uncertainty of the radius from the places of the marks, if robot.toml does not state it; else 0.

    It is that along the line to the centre of rotation. Marks that the run does not show determine no pose.
    """
    if robot.known_to.states("mark_position_mm"):
        return 0.0  # it is in the interval
    towards = np.radians(90.0 + np.nan_to_num(row.get("body_slip_angle_deg") or 0.0))
    seen = [name for name in robot.points_mm if np.isfinite(row.get(f"{name}_speed_mm_s") or np.nan)]
    geometry = MarkGeometry(robot.points_mm)
    geometry = geometry.only(seen) if len(seen) > 1 else geometry
    shifts = geometry.with_sigmas(robot.known_to.mark_position_mm).pose_shifts()
    return float(np.linalg.norm(shifts[:, :2] @ [np.cos(towards), np.sin(towards)]))


def _of_mark(row: dict[str, Any], mark: str) -> dict[str, Any]:
    """A row with the path of the only mark in place of that of the robot's centre."""
    own = {
        before + name.removeprefix(f"{before}{mark}_"): value
        for before in ("", "simulated_")
        for name, value in row.items()
        if mark and name.startswith(f"{before}{mark}_")
    }
    return row | own


def unit_of(runs: Sequence[RunView]) -> LengthUnit:
    """The unit of lengths of some runs, which are of one robot."""
    return runs[0].unit if runs else MILLIMETRES


def column(runs: Sequence[RunView], name: str, table: str = "turning") -> Array:
    """A column over some runs, (runs,); NaN where a run has no value."""
    return np.array([run.value(name, table) for run in runs])


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]
