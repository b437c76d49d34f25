"""Uncertainty budget of one run (GUM, JCGM 100:2008): what each source contributes to radius, speed and heading.

Contributions are standard uncertainties; independent sources add in quadrature. Those of the measurement are in the
interval of the radius, and those of the marks on the robot that robot.toml states in [known_to]. Without a statement
they are not, nor are errors of the clock: they are the same in every run of the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.camera import Camera
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import Poses, poses_from_marks
from evaluator.turning.measure import measure_turning
from evaluator.turning.result import Turning

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Knowledge:
    """Standard uncertainties not shown by a recording: positions and height of the marks, and the clock (relative)."""

    mark_position_mm: float = 0.05
    mark_height_mm: float = 0.1
    time_base: float = 1e-4


@dataclass(frozen=True)
class Contribution:
    """Standard uncertainties of radius, speed and heading of a frame from one source.

    measured: whether it is in the interval of the radius. NaN: unknown for this run.
    """

    source: str
    radius_mm: float
    speed_mm_s: float
    heading_deg: float
    measured: bool = True


@dataclass(frozen=True)
class Budget:
    """All contributions to the uncertainty of one run, the measured values, and sums in quadrature."""

    turning: Turning
    contributions: tuple[Contribution, ...]

    def combined(self, *, measured_only: bool) -> Contribution:
        """Combined standard uncertainty; measured_only: of what the interval of the radius contains."""
        chosen = [item for item in self.contributions if item.measured or not measured_only]
        radius, speed, heading = (
            _norm([getattr(item, name) for item in chosen]) for name in ("radius_mm", "speed_mm_s", "heading_deg")
        )
        return Contribution("in the interval" if measured_only else "all together", radius, speed, heading)


def uncertainty_budget(
    marks: pd.DataFrame,
    geometry: MarkGeometry,
    camera: Camera | None = None,
    *,
    known: Knowledge,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> Budget:
    """Uncertainty budget of a run, by measuring it again with one source of uncertainty more at a time.

    marks: a marks table. geometry: with the uncertainties of its marks that are in the interval of the radius. Sources
    that need a camera are left out without one. Raises InputError as poses_from_marks does.
    """

    def measured(places: MarkGeometry, through: Camera | None) -> tuple[Poses, Turning]:
        poses = poses_from_marks(marks, places, through)
        return poses, measure_turning(poses, start_s, stop_s)

    exact, of_height = geometry.with_sigmas(), geometry.with_sigmas(0.0, known.mark_height_mm)
    placed = geometry.with_sigmas(known.mark_position_mm, known.mark_height_mm if camera else 0.0)
    steps: list[tuple[str, MarkGeometry, Camera | None, bool]] = []
    if camera is not None and geometry.height_mm is not None:
        exact_pitch = camera.with_exact_pitch()
        perfect = replace(exact_pitch, covariance=np.zeros_like(exact_pitch.covariance))
        steps += [
            ("marks, common to all frames", exact, perfect, True),
            ("lens and plane, from the gauge images", exact, exact_pitch, True),
            ("pitch of the gauge", exact, camera, True),
            ("height of the marks in robot.toml", of_height, camera, geometry.height_sigma_mm > 0),
        ]
    steps.append(("positions of the marks in robot.toml", placed, camera, geometry.place_sigma_mm > 0))
    found: list[Contribution] = []
    before = np.zeros(3)
    for source, places, through, in_interval in steps:
        poses, turning = measured(places, through)
        if not found:
            found.append(_noise(poses, turning))
        speed = turning.speed_sigma_mm_s**2 - turning.speed_random_mm_s**2
        total = np.array([turning.radius_systematic_mm**2, speed, _common_heading_deg(poses) ** 2])
        radius, speed, heading = np.sqrt(np.maximum(total - before, 0))
        found.append(Contribution(source, float(radius), float(speed), float(heading), measured=in_interval))
        before = total
    speed, radius = abs(turning.speed_mm_s) * known.time_base, 0.0 * turning.radius_mm
    found.append(Contribution("clock of the recording", radius, speed, 0.0, measured=False))
    return Budget(measured(geometry, camera)[1], tuple(found))


def _noise(poses: Poses, turning: Turning) -> Contribution:
    heading = np.degrees(np.sqrt(np.median(poses.covariance[poses.measured, 2, 2])))
    return Contribution(
        "noise of the marks, frame by frame", turning.radius_random_mm, turning.speed_random_mm_s, float(heading)
    )


def _common_heading_deg(poses: Poses) -> float:
    """Standard uncertainty of a heading by errors common to all frames; root mean square over the frames."""
    assert poses.geometry is not None  # poses of marks have one
    by_places = float(np.linalg.norm(poses.geometry.pose_shifts()[:, 2]))
    if poses.systematic is None:
        return float(np.degrees(by_places))
    shifts = poses.systematic[poses.measured, 2]
    return float(np.degrees(np.hypot(by_places, np.sqrt((shifts**2).sum(axis=1).mean()))))


def _norm(values: Sequence[float]) -> float:
    return float(np.linalg.norm(values))
