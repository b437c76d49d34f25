"""Uncertainty budget of one run (GUM, JCGM 100:2008): what each source contributes to radius, speed and heading.

Contributions are standard uncertainties; independent sources add in quadrature. Those of the measurement are in the
interval of the radius. Errors of robot.toml and the clock are not: they are the same in every run of the robot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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

    measured: whether it is part of the measurement and of the interval of the radius. NaN: unknown for this run.
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
        """Combined standard uncertainty; measured_only: of the measurement, without robot.toml and clock."""
        chosen = [item for item in self.contributions if item.measured or not measured_only]
        radius, speed, heading = (
            _norm([getattr(item, name) for item in chosen]) for name in ("radius_mm", "speed_mm_s", "heading_deg")
        )
        return Contribution("measurement" if measured_only else "all together", radius, speed, heading)


def uncertainty_budget(
    marks: pd.DataFrame,
    geometry: MarkGeometry,
    camera: Camera | None = None,
    *,
    known: Knowledge,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> Budget:
    """Uncertainty budget of a run, by measuring it again with one source changed at a time.

    marks: a marks table. Sources that need a camera or columns in px are left out without these.
    Raises InputError as poses_from_marks does.
    """

    def measured(places: MarkGeometry, seen: pd.DataFrame, through: Camera | None) -> tuple[Poses, Turning]:
        poses = poses_from_marks(seen, places, through)
        return poses, measure_turning(poses, start_s, stop_s)

    poses, turning = measured(geometry, marks, camera)
    found = [_noise(poses, turning)]
    if camera is not None and geometry.height_mm is not None:
        found += _of_camera(lambda through: measured(geometry, marks, through), camera)
    moved = [measured(places, marks, camera) for places in _moved(geometry, known.mark_position_mm)]
    found.append(_between("positions of the marks in robot.toml", (poses, turning), moved))
    if camera is not None and geometry.height_mm is not None and _placed(marks, geometry):
        higher = _at_height(marks, geometry, camera, geometry.height_mm + known.mark_height_mm)
        changed = measured(geometry, higher, camera)
        found.append(_between("height of the marks in robot.toml", (poses, turning), [changed]))
    speed, radius = abs(turning.speed_mm_s) * known.time_base, 0.0 * turning.radius_mm
    found.append(Contribution("clock of the recording", radius, speed, 0.0, measured=False))
    return Budget(turning, tuple(found))


def _noise(poses: Poses, turning: Turning) -> Contribution:
    heading = np.degrees(np.sqrt(np.median(poses.covariance[poses.measured, 2, 2])))
    return Contribution(
        "noise of the marks, frame by frame", turning.radius_random_mm, turning.speed_random_mm_s, float(heading)
    )


def _of_camera(through: Callable[[Camera], tuple[Poses, Turning]], camera: Camera) -> list[Contribution]:
    """Contributions of tracking errors common to all frames, of the gauge images, and of the gauge's pitch.

    Each camera has one source of uncertainty less than the previous one; the contributions are the differences of the
    squares.
    """
    exact = camera.with_exact_pitch()
    perfect = replace(exact, covariance=np.zeros_like(exact.covariance))
    names = ("marks, common to all frames", "lens and plane, from the gauge images", "pitch of the gauge")
    found, before = [], np.zeros(3)
    for name, one in zip(names, (perfect, exact, camera), strict=True):
        poses, turning = through(one)
        speed = turning.speed_sigma_mm_s**2 - turning.speed_random_mm_s**2
        total = np.array([turning.radius_systematic_mm**2, speed, _common_heading_deg(poses) ** 2])
        radius, speed, heading = np.sqrt(np.maximum(total - before, 0))
        found.append(Contribution(name, float(radius), float(speed), float(heading)))
        before = total
    return found


def _common_heading_deg(poses: Poses) -> float:
    """Standard uncertainty of a heading by errors common to all frames; root mean square over the frames."""
    if poses.systematic is None:
        return 0.0
    shifts = poses.systematic[poses.measured, 2]
    return float(np.degrees(np.sqrt((shifts**2).sum(axis=1).mean())))


def _moved(geometry: MarkGeometry, sigma_mm: float) -> list[MarkGeometry]:
    """Geometries with one coordinate of one mark changed by its uncertainty, for every coordinate and mark."""
    return [
        MarkGeometry({**geometry.places_mm, name: (x + dx, y + dy)}, height_mm=geometry.height_mm)
        for name, (x, y) in geometry.places_mm.items()
        for dx, dy in ((sigma_mm, 0.0), (0.0, sigma_mm))
    ]


def _between(source: str, here: tuple[Poses, Turning], changed: list[tuple[Poses, Turning]]) -> Contribution:
    """Differences between changed measurements and the actual one, added in quadrature."""
    poses, turning = here
    radius = [other.radius_mm - turning.radius_mm for _, other in changed]
    speed = [other.speed_mm_s - turning.speed_mm_s for _, other in changed]
    heading = [np.degrees(np.nanmedian(other.heading_rad - poses.heading_rad)) for other, _ in changed]
    return Contribution(source, _norm(radius), _norm(speed), _norm(heading), measured=False)


def _norm(values: Sequence[float]) -> float:
    return float(np.linalg.norm(values))


def _placed(marks: pd.DataFrame, geometry: MarkGeometry) -> bool:
    return all(f"{name}_x_px" in marks for name in geometry.seen_in(marks).names)


def _at_height(marks: pd.DataFrame, geometry: MarkGeometry, camera: Camera, height_mm: float) -> pd.DataFrame:
    """The marks mapped to a plane of another height."""
    result = marks.copy()
    for name in geometry.seen_in(marks).names:
        points = camera.plate_from_image(marks[[f"{name}_x_px", f"{name}_y_px"]].to_numpy(float), height_mm)
        result[[f"{name}_x_mm", f"{name}_y_mm"]] = points
    return result
