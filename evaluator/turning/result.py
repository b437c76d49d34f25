"""The result of one turn: a row of turning.csv."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from evaluator.turning.motion.curvature import Z_975
from evaluator.turning.path import PointPath
from evaluator.turning.phase_table import Phase

NAN = float("nan")
OF_MARKS = {"mark_speeds_mm_s": "_speed_mm_s", "mark_radii_mm": "_radius_mm"}  # suffixes of a mark's name in the row


@dataclass(frozen=True, repr=False)
class Turning:
    """One run's row of turning.csv; NaN if a quantity is unknown, with the reason in `radius_status`.

    radius_mm: minimum turning radius of the centre, sustained for a quarter turn (sustained.py), with 95 % bounds;
    steady_radius_mm: of the steady turn as a whole. Both are NaN if the interval of the curvature includes a straight
    path. They are equal unless radius_varies; radius_variation is then the relative standard deviation of the curvature
    between quarter turns, noise subtracted. radius_random_mm, radius_systematic_mm: standard uncertainties from noise,
    reduced by more frames, and from the camera and the marks on the robot (robot.toml's known_to), reduced by better
    knowledge of these only; the bounds include both. radius_by_marks_mm: the part of the latter from the places of the
    marks, which sessions of one robot share.

    Speeds are positive forward, yaw rate and curvature positive counter-clockwise; their sigmas include both
    as well. speed_random_mm_s, yaw_rate_random_deg_s: from noise alone, for runs that share camera and robot.
    center_x_mm, center_y_mm: centre of the circle on the plate; center_wander_mm: its standard deviation between
    quarter turns, noise subtracted; rotation_x_mm, rotation_y_mm: its position in the body frame. Radii of the marks,
    of the outermost wheel and of the outermost corner (wall to wall) follow SAE J695.

    Slip ratio (u - r·phi')/max(|u|, |r·phi'|) and slip angle atan2(v, |u|) are those of the model. Their sigmas include
    noise, camera and places of the marks, but not errors of the commanded speed. other_wheels: the same for further
    wheels and for driven rear wheels.

    phases: motions of the run in order of time; a run with several motions has no radius and no speed. paths: for a
    robot with a single mark, path radius, bounds and speed of that mark. path_efficiency, speed_ripple, smoothness: see
    quantities.py.
    """

    radius_mm: float = NAN
    radius_low_mm: float = NAN
    radius_high_mm: float = NAN
    radius_status: str = "ok"
    radius_random_mm: float = NAN
    radius_systematic_mm: float = NAN
    radius_by_marks_mm: float = NAN
    steady_radius_mm: float = NAN
    steady_radius_low_mm: float = NAN
    steady_radius_high_mm: float = NAN
    radius_varies: bool = False
    radius_variation: float = NAN
    sustained_from_s: float = NAN
    sustained_to_s: float = NAN
    speed_mm_s: float = NAN
    mark_speeds_mm_s: Mapping[str, float] = field(default_factory=dict)
    yaw_rate_deg_s: float = NAN
    speed_sigma_mm_s: float = NAN
    yaw_rate_sigma_deg_s: float = NAN
    speed_random_mm_s: float = NAN
    yaw_rate_random_deg_s: float = NAN
    curvature_per_mm: float = NAN
    curvature_low_per_mm: float = NAN
    curvature_high_per_mm: float = NAN
    center_x_mm: float = NAN
    center_y_mm: float = NAN
    center_wander_mm: float = NAN
    rotation_x_mm: float = NAN
    rotation_y_mm: float = NAN
    mark_radii_mm: Mapping[str, float] = field(default_factory=dict)
    outer_wheel_radius_mm: float = NAN
    wall_to_wall_radius_mm: float = NAN
    body_slip_angle_deg: float = NAN
    body_slip_angle_sigma_deg: float = NAN
    front_left_slip_ratio: float = NAN
    front_left_slip_ratio_sigma: float = NAN
    front_right_slip_ratio: float = NAN
    front_right_slip_ratio_sigma: float = NAN
    front_left_slip_angle_deg: float = NAN
    front_left_slip_angle_sigma_deg: float = NAN
    front_right_slip_angle_deg: float = NAN
    front_right_slip_angle_sigma_deg: float = NAN
    rear_left_slip_angle_deg: float = NAN
    rear_left_slip_angle_sigma_deg: float = NAN
    rear_right_slip_angle_deg: float = NAN
    rear_right_slip_angle_sigma_deg: float = NAN
    other_wheels: Mapping[str, float] = field(default_factory=dict)
    path_efficiency: float = NAN
    speed_ripple: float = NAN
    smoothness: float = NAN
    turned_deg: float = NAN
    share_used: float = NAN
    noise_correlation: float = NAN
    residual_rms_mm: float = NAN
    start_s: float = NAN
    steady_start_s: float = NAN
    steady_stop_s: float = NAN
    stop_s: float = NAN
    start_delay_s: float = NAN
    mark_spacing_ratio: float = NAN
    mark_spacing_ratio_sigma: float = NAN
    phases: tuple[Phase, ...] = ()
    paths: Mapping[str, PointPath] = field(default_factory=dict)

    def __getattr__(self, name: str) -> float:
        """Columns of marks and of further wheels by their names in turning.csv, as NAME_speed_mm_s, NAME_radius_mm."""
        if name in self.__dict__.get("other_wheels", {}):
            return float(self.__dict__["other_wheels"][name])
        for kept, ending in OF_MARKS.items():
            found = self.__dict__.get(kept, {})
            if name.endswith(ending) and name.removesuffix(ending) in found:
                return float(found[name.removesuffix(ending)])
        raise AttributeError(name)

    def summary(self) -> str:
        """Text of one line."""
        if not math.isfinite(self.radius_mm):
            return self.radius_status
        varies = f"{self.radius_status}; " if self.radius_status != "ok" else ""
        steady = self.radius_varies and math.isfinite(self.steady_radius_mm)
        mean = f"; varies, {self.steady_radius_mm:.4g} mm on average" if steady else ""
        return (
            f"{varies}radius {self.radius_mm:.4f} mm, 95 % from {self.radius_low_mm:.4f} to {self.radius_high_mm:.4f}"
            f"{mean};"
            f" {self.turned_deg:.0f} degrees at {self.speed_mm_s:.3g} mm/s, {self.yaw_rate_deg_s:.3g} degrees/s"
        )

    def __repr__(self) -> str:
        """Text of one line."""
        return f"Turning({self.summary()})"

    def _repr_html_(self) -> str:
        """The main results as a table, for notebooks."""
        rows = {
            "radius": f"{self.radius_mm:.4f} mm",
            "95 %": f"{self.radius_low_mm:.4f} to {self.radius_high_mm:.4f} mm",
            "status": self.radius_status,
            "speed": f"{self.speed_mm_s:.4f} mm/s",
            "yaw rate": f"{self.yaw_rate_deg_s:.3f} deg/s",
            "turned": f"{self.turned_deg:.1f}°",
        }
        return f"<table>{''.join(f'<tr><th>{name}</th><td>{value}</td></tr>' for name, value in rows.items())}</table>"

    def with_scale(self, sigma: float) -> Turning:
        """Bounds, systematic parts and speed_sigma_mm_s widened by a relative uncertainty of the unit of length."""

        def wider(value: float, low: float, high: float) -> tuple[float, float]:
            reach = Z_975 * sigma * abs(value)
            return value - math.hypot(value - low, reach), value + math.hypot(high - value, reach)

        radius = wider(self.radius_mm, self.radius_low_mm, self.radius_high_mm)
        steady = wider(self.steady_radius_mm, self.steady_radius_low_mm, self.steady_radius_high_mm)
        curvature = wider(self.curvature_per_mm, self.curvature_low_per_mm, self.curvature_high_per_mm)
        return replace(
            self,
            radius_low_mm=radius[0],
            radius_high_mm=radius[1],
            radius_systematic_mm=math.hypot(self.radius_systematic_mm, sigma * self.radius_mm),
            steady_radius_low_mm=steady[0],
            steady_radius_high_mm=steady[1],
            curvature_low_per_mm=curvature[0],
            curvature_high_per_mm=curvature[1],
            speed_sigma_mm_s=math.hypot(self.speed_sigma_mm_s, sigma * self.speed_mm_s),
        )

    def to_row(self) -> dict[str, float | str | bool]:
        """Columns of turning.csv in order, after run, left_rpm and right_rpm; NAME_speed_mm_s … of the marks."""
        row: dict[str, float | str | bool] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name in OF_MARKS:
                row |= {f"{mark}{OF_MARKS[item.name]}": number for mark, number in value.items()}
            elif item.name == "other_wheels":
                row |= value
            elif item.name == "paths":
                for mark, path in value.items():
                    row |= {f"{mark}_radius_low_mm": path.low, f"{mark}_radius_high_mm": path.high}
                    row |= {f"{mark}_turned_deg": path.turned_deg, f"{mark}_radius_status": path.status}
            elif item.name != "phases":
                row[item.name] = value
        return row

    def phase_rows(self) -> list[dict[str, float | str]]:
        """Rows of phases.csv, in time: start_s, stop_s, kind, radius_mm with its bounds, speed_mm_s, turned_deg."""
        return [vars(phase).copy() for phase in self.phases]


def only_mark(row: Mapping[Any, Any]) -> str:
    """Name of the mark of a row of turning.csv or comparison.csv if the robot has a single mark; else empty."""
    ending = "_radius_low_mm"
    names = [str(name).removesuffix(ending) for name in row if str(name).endswith(ending) and name != f"steady{ending}"]
    speeds = {name: row.get(f"{name}_speed_mm_s") for name in names}
    return next((name for name, speed in speeds.items() if isinstance(speed, float) and math.isfinite(speed)), "")
