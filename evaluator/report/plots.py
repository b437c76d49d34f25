"""Plots for notebooks: a run, a turn, a camera and a diagnosis on matplotlib axes.

Each draws into the given axes or into new ones, and returns them, in millimetres of the plate frame.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from evaluator.errors import InputError
from evaluator.report.pages.colors import INK
from evaluator.report.style import MEASURED, SIMULATED, THEORY

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from calibration.camera import Camera
    from evaluator.pose import Poses
    from evaluator.turning import Turning
    from simulator.run import Run

GRID = 21  # lines of the grid of a camera's field in each direction


def plot_run(run: Run | Poses, axes: Axes | None = None, *, label: str | None = None) -> Axes:
    """Draw the path of the robot's centre: a simulated Run dashed, measured Poses solid; the start is marked.

    Raises InputError for a table of marks, which has no path of the centre.
    """
    if not hasattr(run, "heading_rad"):
        raise InputError("plot_run draws poses or a simulated run; compute poses with evaluator.poses_from_marks first")
    axes = _axes(axes)
    series = SIMULATED if hasattr(run, "u_mm_s") else MEASURED
    axes.plot(run.x_mm, run.y_mm, series.line, color=series.color, label=label)
    known = np.flatnonzero(np.isfinite(run.x_mm))
    if len(known):
        axes.plot(run.x_mm[known[0]], run.y_mm[known[0]], "o", color=series.color, ms=5)
    return _plane(axes, label)


def plot_turn(poses: Poses, turning: Turning, axes: Axes | None = None) -> Axes:
    """Draw measured poses with the circle of their sustained minimum turning radius, if they turn."""
    axes = plot_run(poses, axes, label="path of the centre")
    if np.isfinite([turning.radius_mm, turning.center_x_mm, turning.center_y_mm]).all():
        angle, radius = np.linspace(0.0, 2.0 * np.pi, 361), abs(turning.radius_mm)
        x, y = turning.center_x_mm + radius * np.cos(angle), turning.center_y_mm + radius * np.sin(angle)
        said = f"radius {radius:.3f} mm, 95 % {turning.radius_low_mm:.3f} to {turning.radius_high_mm:.3f}"
        axes.plot(x, y, THEORY.line, color=INK, label=said)
    return _plane(axes, "circle")


def plot_camera(camera: Camera, axes: Axes | None = None, *, height_mm: float = 6.5) -> Axes:
    """Draw a regular grid of the image on a plane above the plate: field of view and distortion."""
    axes = _axes(axes)
    width, height = camera.size_px
    across, down = np.linspace(0, width - 1, GRID), np.linspace(0, height - 1, GRID)
    image = np.stack(np.meshgrid(across, down), axis=-1)
    plane = camera.plate_from_image(image.reshape(-1, 2), height_mm).reshape(GRID, GRID, -1)
    for lines in (plane, plane.swapaxes(0, 1)):
        for line in lines:
            axes.plot(line[:, 0], line[:, 1], color=MEASURED.color, lw=0.7)
    axes.set_title(f"field of the camera, {height_mm:g} mm above the plate")
    return _plane(axes, None)


def plot_diagnosis(content: Any, axes: Axes | None = None) -> Axes:
    """Draw the gap between measurement and model before and after a diagnosis, beside the noise floor.

    content: result of `evaluator.diagnose`, or the content of diagnosis.json. Held-out runs are shown separately.
    """
    axes = _axes(axes)
    gap = getattr(content, "content", content)["gap"]
    names = [(when, runs) for when in ("before", "after") for runs in ("fit", "held_out") if runs in gap.get(when, {})]
    for place, (when, runs) in enumerate(names):
        series = SIMULATED if when == "before" else MEASURED
        value = gap[when][runs]
        if value is not None:
            axes.bar(place, value, color=series.color, alpha=1.0 if runs == "fit" else 0.6)
    axes.axhline(gap["noise_floor"], ls=THEORY.line, color=INK, label="noise floor")
    axes.set_xticks(range(len(names)), [f"{when}\n{runs.replace('_', ' ')}" for when, runs in names])
    axes.set_ylabel(f"gap, {gap['unit']} RMS")
    axes.legend(frameon=False)
    return axes


def _axes(axes: Axes | None) -> Axes:
    if axes is not None:
        return axes
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained")[1]


def _plane(axes: Axes, label: str | None) -> Axes:
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, mm")
    axes.set_ylabel("y, mm")
    if label is not None:
        axes.legend(frameon=False)
    return axes
